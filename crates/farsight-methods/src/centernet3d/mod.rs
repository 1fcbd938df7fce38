//! CenterNet for 3D boxes ("ddd", Zhou, Wang and Krähenbühl 2019): keypoints at the centres of 2D boxes, with depth,
//! size, heading in two bins, and the 2D box.
//!
//! Where SMOKE looks for the projected centre of the 3D box, this looks for the centre of the 2D box and takes it for
//! the same: a control of what that difference is worth.

pub mod codec;
pub mod config;
pub mod decode;
pub mod network;
pub mod targets;
#[cfg(feature = "train")]
pub mod train;

use farsight_graph::model::Model;

pub use config::CenterNet3dConfig;

/// A CenterNet for 3D boxes with its weights.
pub type CenterNet3dModel = Model<CenterNet3dConfig>;

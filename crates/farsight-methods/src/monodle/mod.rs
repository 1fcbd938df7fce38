//! `MonoDLE` (Ma et al., *Delving into Localization Errors for Monocular 3D Object Detection*, CVPR 2021): a
//! `CenterNet` whose keypoint is the projected centre of the 3D box, with the 2D box beside it, a depth that says how
//! sure it is, and a heading in twelve bins.
//!
//! What follows the authors and what differs: `docs/rivals.md`.

pub mod codec;
pub mod config;
pub mod decode;
pub mod network;
pub mod targets;
#[cfg(feature = "train")]
pub mod train;

use farsight_graph::model::Model;

pub use config::MonoDleConfig;

/// A `MonoDLE` with its weights.
pub type MonoDleModel = Model<MonoDleConfig>;

//! SSD (Liu et al. 2016) on `MobileNetV2`, as TensorFlow's object detection built it: 2D boxes of a detector that
//! learnt from photographs.
//!
//! It knows nothing of 3D. How far away something is follows from the height of its box and the usual height of its
//! class (similar triangles): a first guess, with a wide error bar, for a refiner ([`crate::refiner`]) that measures
//! from the picture.
//!
//! The network is imported, not trained here.

pub mod anchors;
pub mod config;
pub mod decode;
pub mod detector;
pub mod import;
pub mod network;
pub mod views;

use farsight_graph::model::Model;

pub use config::SsdConfig;
pub use detector::SsdDetector;

/// An SSD with its weights.
pub type SsdModel = Model<SsdConfig>;

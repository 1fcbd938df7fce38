//! The camera estimator: a small network that says what camera took an image, from the image alone: its focal length,
//! how far it looks down, how far it is rolled, and how sure it is of each.

pub mod config;
pub mod estimate;
pub mod geometry;
#[cfg(feature = "train")]
pub mod train;

use farsight_graph::model::Model;

pub use config::CameraEstimatorConfig;
pub use estimate::CameraEstimator;
pub use geometry::CameraEstimate;

/// A camera estimator with its weights.
pub type CameraEstimatorModel = Model<CameraEstimatorConfig>;

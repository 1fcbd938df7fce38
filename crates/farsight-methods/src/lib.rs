//! Methods: one folder each, with all that the method is side by side.
//!
//! A detector's folder ([`smoke`]) has its config, its graph, its targets, its decoder and, under the feature `train`,
//! its loss and its training task. Second stages that look at single objects again ([`refiner`], [`plate_reader`]) are
//! built the same way and share [`roi`]; detectors with a heatmap of stride 4 share
//! [`center_map`]. [`box_mlp`] ranges 2D boxes without a look at the image. What every detector can do stands in [`detector`].

mod batch;
pub mod box_mlp;
pub mod center_map;
pub mod centernet3d;
mod checks;
pub mod detector;
pub mod detectors;
mod file;
pub mod gs3d;
pub mod input_spec;
pub mod monodle;
pub mod oftnet;
pub mod plate_reader;
pub mod refiner;
pub mod roi;
pub mod smoke;
pub mod ssd;
#[cfg(feature = "train")]
mod tensors;
#[cfg(feature = "train")]
pub mod training;

pub use detector::{DetectError, Detector, UnfamiliarCamera};
pub use input_spec::InputSpec;

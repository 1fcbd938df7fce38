//! The plate reader: the end of each car that faces the camera is cropped from the original image, and a small network
//! says how wide the number plate on it is, and so how far away the car.

pub mod config;
pub mod geometry;
pub mod read;
#[cfg(feature = "train")]
pub mod train;

use farsight_graph::model::Model;

pub use config::PlateReaderConfig;
pub use read::PlateReader;

/// A plate reader with its weights.
pub type PlateReaderModel = Model<PlateReaderConfig>;

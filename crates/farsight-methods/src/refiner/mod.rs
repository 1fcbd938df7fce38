//! The refiner: each found object is cropped from the original image, and a small network says again, from the crop and
//! its camera alone, what it is and where.

pub mod cascade;
pub mod config;
pub mod effort;
pub mod geometry;
pub mod refine;
#[cfg(feature = "train")]
pub mod train;

use farsight_graph::model::Model;

pub use cascade::{Cascade, ScoreTrace};
pub use config::RefinerConfig;
pub use effort::Effort;
pub use refine::{Flip, Refiner};

/// A refining network with its weights.
pub type RefinerModel = Model<RefinerConfig>;

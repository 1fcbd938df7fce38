//! What the second stages share: a small network over a crop around one object (a region of interest), how it runs, and
//! how it learns.

pub mod network;
pub mod runner;
#[cfg(feature = "train")]
pub mod train;

pub use network::{ANSWER, RoiBackbone};
pub use runner::RoiRunner;

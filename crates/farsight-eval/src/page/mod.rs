//! The report page: one HTML file that holds everything, and its charts as PNG files beside it.

mod chart;
mod charts;
mod contents;
mod error;
mod html;
mod worst;
mod write;

pub use chart::{Chart, Series};
pub use contents::{Page, ShownFrame};
pub use error::PageError;
pub use worst::{WorstFrame, worst_frames};

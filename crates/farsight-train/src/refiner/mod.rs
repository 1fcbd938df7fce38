//! Training of the refining network ([`farsight_core::refine`]).

pub mod config;
mod false_alarms;
mod samples;
mod trainer;

pub use config::RefinerRun;
pub use trainer::{REFINER_FILE, RefinerTerms, train};

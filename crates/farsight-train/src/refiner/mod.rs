//! Training of the refining network ([`farsight_core::refine`]).

mod false_alarms;
mod samples;
mod trainer;

pub use trainer::{REFINER_FILE, RefinerTerms, train};

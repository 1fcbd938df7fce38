//! Training of the plate reader ([`farsight_core::plate`]).
//!
//! It learns from rendered frames, which list the plates that they show. Where none is seen, the reader learns to be unsure.

mod samples;
mod trainer;

pub use trainer::{PLATES_FILE, PlateTerms, train};

//! The training crate against reference tensors, and whole runs of it.

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test that cannot go on stops, and says so when it was skipped"
)]

mod golden_layers;
mod golden_network;
mod golden_support;
mod imported_checkpoints;
mod parts;
mod plate;
mod pruning;
mod refiner;
mod resume;
mod tiny;
mod training;

//! The training crate against reference tensors and an independent optimiser.

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test that cannot go on stops, and says so when it was skipped"
)]

mod adam;
mod golden_layers;
mod golden_msfe;
#[allow(dead_code, reason = "each test program uses a part")]
mod golden_support;
mod samplers;
mod schedule;

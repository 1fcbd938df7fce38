//! Whole runs of every method, and SMOKE's network and losses against reference tensors.

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test that cannot go on stops, and says so when it was skipped"
)]

mod camera_estimator;
mod centernet3d;
mod checkpoints;
mod configs;
mod golden_network;
#[path = "../../../farsight-train/tests/it/golden_support.rs"]
#[allow(dead_code, reason = "each test program uses a part")]
mod golden_support;
mod gs3d;
mod imported_checkpoints;
mod in_parts;
mod monodle;
mod monogrnet;
mod oftnet;
mod parts;
mod plate;
mod pruning;
mod refiner;
mod resume;
mod tiny;
mod training;
mod validation;
mod whole_runs;

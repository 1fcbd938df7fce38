//! The program and the library, as users run them: one test binary, so that it is linked once and no core waits for the
//! last test of a file.

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "the helpers of a test may panic and say that they were skipped"
)]

mod auto_camera;
mod calibrate;
mod cli;
mod demo;
mod engines;
mod eval;
#[cfg(feature = "train")]
mod experiment;
#[cfg(unix)]
mod faults;
mod figures;
mod fit;
mod formats;
mod int8;
mod lens;
mod library;
mod mistakes;
mod pitch;
mod program;
mod readme;
mod refiner;
#[cfg(feature = "rerun")]
mod rerun;
mod robustness;
mod rtsp;
mod sequences;
mod shards;
mod track;
mod video;
mod weights;

/// Counts what each thread asks for; tests run side by side.
#[global_allocator]
static ALLOCATOR: farsight_testing::Counting = farsight_testing::Counting;

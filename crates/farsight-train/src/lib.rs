//! Training on libtorch: executor, optimiser, training loop, checkpoints. It knows no method: what a step is, a method
//! says.
//!
//! The only crate that knows libtorch. `tch` calls that cannot fail for shapes the graph has checked panic instead of
//! returning an error; everything that depends on the user's files, config or data returns one.

pub mod adam;
mod average;
pub mod checkpoint;
pub mod config;
pub mod deform;
pub mod error;
pub mod executor;
pub mod fingerprint;
pub mod learner;
pub mod losses;
pub mod metrics;
pub mod parts;
pub mod runner;
pub mod samplers;
pub mod schedule;
pub mod task;
pub mod training;

/// Sets the number of threads that libtorch computes with; `None` leaves its own choice.
///
/// Results are bit-identical from run to run only for one number of threads.
pub fn set_threads(threads: Option<usize>) {
    if let Some(threads) = threads {
        tch::set_num_threads(threads.max(1) as i32);
    }
}

//! The evaluator against its rules, an independent program and plain recomputation.
#![allow(clippy::unwrap_used, clippy::float_cmp, reason = "the helpers of a test may panic; copied scores are equal")]

#[path = "../laws/mod.rs"]
mod laws;

mod ap;
mod ap_draws;
mod common;
mod files;
mod notes;
mod oracle;
mod paired;
mod ranging;
mod rules;
mod saved_inputs;
mod tracking;

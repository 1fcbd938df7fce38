//! Rendered scenes against geometry: what is drawn is what the labels say.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::print_stdout,
    reason = "the helpers of a test may panic and print"
)]

#[path = "../laws/mod.rs"]
mod laws;

mod dataset;
mod labels;
mod plates;
mod real_labels;
mod render;
mod scenes;
mod sequence;
mod support;
mod unchanged;
mod world;

//! The network as data: one description, many readers.
//!
//! [`graph::Graph`] lists typed nodes; [`build`] makes such lists from a [`config::ModelConfig`]; [`weights::Weights`] maps parameter names to
//! numbers. Everything else reads these: [`count`] here, the libtorch executor in `farsight-train`, checkpoint import in [`checkpoint`]; [`transform`] makes it
//! cheaper without changing what it computes, [`quantize`] says what of it can be in 8 bits, and [`onnx`] writes it for other engines.

pub mod build;
pub mod checkpoint;
pub mod config;
pub mod count;
pub mod graph;
pub mod init;
pub mod model;
pub mod onnx;
pub mod part;
pub mod plate;
pub mod prune;
pub mod quantize;
pub mod refiner;
pub mod transform;
pub mod weights;

//! The methods without training: laws, goldens, networks on the built-in engine, files.
// Clippy's exceptions for tests reach functions marked `#[test]`, not the helpers beside them.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)]

#[path = "../laws/mod.rs"]
mod laws;
#[path = "../../../farsight-data/tests/it/material.rs"]
mod material;

mod backbones;
mod checkpoint_fixtures;
mod checkpoint_names;
mod codec_golden;
mod detector;
mod geometry;
mod goldens;
mod networks;
mod onnx_files;
mod paper;
mod plate_reader_network;
mod pruning;
mod quantized;
mod refiner;
mod refiner_network;
mod rivals;
mod smoke_laws;
mod ssd;
mod support;
mod switches;

//! Laws, tables and goldens of the data crate, and of the shared geometry over real KITTI frames.
// Clippy's exceptions for tests reach functions marked `#[test]`, not the helpers beside them.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)]

mod dataset_laws;
mod image_bytes;
mod image_files;
mod image_formats;
mod kitti_errors;
mod kitti_real;
#[path = "../laws/mod.rs"]
mod laws;
mod loader_laws;
mod material;
mod saved_inputs;
mod transform_laws;
mod warp_golden;
mod warp_laws;

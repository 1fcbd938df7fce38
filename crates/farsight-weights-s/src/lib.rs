//! Weights of farsight-s. They are a crate of their own because the registry takes crates of at most 10 MB.

/// The detector, a model file of Farsight (safetensors).
pub const DETECTOR: &[u8] = include_bytes!("../farsight-s.safetensors");

/// SHA-256 of its weights, as Farsight computes it. A test says when it is not that of the file.
pub const DETECTOR_SHA256: &str = "8453e7c472b8381fd86f4b65bc2773385494630774e4303245fff9f9ca174c97";

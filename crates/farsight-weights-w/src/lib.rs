//! Weights of farsight-w. They are a crate of their own because the registry takes crates of at most 10 MB.

/// The detector, a model file of Farsight (safetensors).
pub const DETECTOR: &[u8] = include_bytes!("../farsight-w.safetensors");

/// SHA-256 of its weights, as Farsight computes it. A test says when it is not that of the file.
pub const DETECTOR_SHA256: &str = "d18217131af4a98644b10562046faf021027f619847d12b83324dd97e2a80827";

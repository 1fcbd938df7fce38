//! Weights of farsight-n. They are a crate of their own because the registry takes crates of at most 10 MB.

/// The detector, a model file of Farsight (safetensors).
pub const DETECTOR: &[u8] = include_bytes!("../farsight-n.safetensors");

/// SHA-256 of its weights, as Farsight computes it. A test says when it is not that of the file.
pub const DETECTOR_SHA256: &str = "e879f62c6a4f903947b0f453963dd9c959e4df92d1a6247b3485ba6bf22ef0d1";

/// The refiner that follows it, likewise.
pub const REFINER: &[u8] = include_bytes!("../farsight-n-refiner.safetensors");

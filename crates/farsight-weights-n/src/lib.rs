//! Weights of farsight-n. They are a crate of their own because the registry takes crates of at most 10 MB.

/// The detector, a model file of Farsight (safetensors).
pub const DETECTOR: &[u8] = include_bytes!("../farsight-n.safetensors");

/// SHA-256 of its weights, as Farsight computes it. A test says when it is not that of the file.
pub const DETECTOR_SHA256: &str = "6d86791fb341bbf95cb1ba82f5c4e5328e926d6bf2b0afc2529b84a02bc4d6da";

/// The refiner that follows it, likewise.
pub const REFINER: &[u8] = include_bytes!("../farsight-n-refiner.safetensors");

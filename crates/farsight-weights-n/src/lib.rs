//! Weights of farsight-n. They are a crate of their own because the registry takes crates of at most 10 MB.

/// The detector, a model file of Farsight (safetensors).
pub const DETECTOR: &[u8] = include_bytes!("../farsight-n.safetensors");

/// The refiner that follows it, likewise.
pub const REFINER: &[u8] = include_bytes!("../farsight-n-refiner.safetensors");

//! Weights of the stages after the detector, model files of Farsight (safetensors).
//!
//! They are a crate of their own because the registry takes crates of at most 10 MB.

/// The refiner of farsight-w.
pub const W_REFINER: &[u8] = include_bytes!("../farsight-w-refiner.safetensors");

/// The refiner of farsight-s.
pub const S_REFINER: &[u8] = include_bytes!("../farsight-refiner.safetensors");

/// The plate reader of farsight-s.
pub const PLATES: &[u8] = include_bytes!("../farsight-plates.safetensors");

//! Weights of the network that estimates cameras from images. They are a crate of their own because the registry takes
//! crates of at most 10 MB.

/// The estimator, a model file of Farsight (safetensors).
pub const ESTIMATOR: &[u8] = include_bytes!("../farsight-camera.safetensors");

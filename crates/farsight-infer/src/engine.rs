//! What runs a network.

use std::error::Error;

use farsight_core::HeadMaps;
use thiserror::Error;

/// Runs one network: tensor in, head maps out.
pub trait Engine {
    /// Its name as users write it, `libtorch` for instance.
    fn name(&self) -> &str;

    /// The head maps of one image, before any activation.
    ///
    /// # Shapes
    /// `input` is `[1, 3, height, width]`, planar and normalised, `input_size` its width and height in pixels, multiples of 32. The network is fully
    /// convolutional, so any such size is allowed. The maps have a quarter of each side.
    ///
    /// # Errors
    /// When the engine fails, for want of memory for instance.
    fn head_maps(&mut self, input: &[f32], input_size: [usize; 2]) -> Result<HeadMaps, EngineError>;
}

/// An engine that failed.
#[derive(Debug, Error)]
#[error("the engine {engine} failed: {source}")]
pub struct EngineError {
    /// Name of the engine.
    pub engine: String,
    /// What it says.
    pub source: Box<dyn Error + Send + Sync>,
}

//! What runs a network.

use std::error::Error;

use farsight_core::HeadMaps;
use thiserror::Error;

/// Runs one network: tensor in, head maps out.
pub trait Engine {
    /// Its name as users write it, `libtorch` for instance.
    fn name(&self) -> &str;

    /// The head maps of each image of a batch, before any activation.
    ///
    /// # Shapes
    /// `inputs` is `[batch, 3, height, width]`, planar and normalised, `input_size` its width and height in pixels, multiples of 32. The network is fully
    /// convolutional, so any such size is allowed. The maps have a quarter of each side. A network that ends before its regression head gives
    /// the features that the head reads in place of the regression.
    ///
    /// # Errors
    /// When the engine fails, for want of memory for instance.
    fn batch_head_maps(&mut self, inputs: &[f32], input_size: [usize; 2]) -> Result<Vec<HeadMaps>, EngineError>;

    /// The head maps of one image: a batch of one.
    ///
    /// # Errors
    /// As [`Engine::batch_head_maps`].
    fn head_maps(&mut self, input: &[f32], input_size: [usize; 2]) -> Result<HeadMaps, EngineError> {
        let one = self.batch_head_maps(input, input_size)?.pop();
        one.ok_or_else(|| EngineError { engine: self.name().to_owned(), source: "it gave no maps".into() })
    }
}

/// Images in a batch of this shape; a part of one counts.
pub fn batch_size(inputs: &[f32], [width, height]: [usize; 2]) -> usize {
    inputs.len().div_ceil(3 * width * height)
}

/// The maps of each image of a batch, from the two outputs `[batch, channels, height, width]` of its network.
pub fn apart(batch: usize, map_size: [usize; 2], logits: Vec<f32>, regression: Vec<f32>) -> Vec<HeadMaps> {
    if batch == 1 {
        return vec![HeadMaps { logits, regression, map_size }];
    }
    let part = |values: &[f32], image: usize| {
        let length = values.len() / batch;
        values[image * length..][..length].to_vec()
    };
    let maps = |image| HeadMaps { logits: part(&logits, image), regression: part(&regression, image), map_size };
    (0..batch).map(maps).collect()
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

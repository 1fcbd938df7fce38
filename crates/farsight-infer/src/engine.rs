//! What runs a network.

use std::error::Error;
use std::panic::{AssertUnwindSafe, catch_unwind};

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
    /// convolutional, so any such size is allowed. The maps have a quarter of each side. A network that ends before its regression head gives
    /// the features that the head reads in place of the regression.
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

/// What libraries of engines say.
pub(crate) type Failure = Box<dyn Error + Send + Sync>;

/// The answer of `work`; a panic becomes an error, because a model from a stranger may hit an assumption of the library.
pub(crate) fn unpanicked<T>(engine: &str, work: impl FnOnce() -> Result<T, Failure>) -> Result<T, EngineError> {
    let failed = |source| EngineError { engine: engine.to_owned(), source };
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(answer) => answer.map_err(failed),
        Err(_) => Err(failed("its library panicked; the model is not one that it can run".into())),
    }
}

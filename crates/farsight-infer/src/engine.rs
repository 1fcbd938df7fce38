//! What runs a network.

use std::any::Any;
use std::error::Error;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};

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

/// What libraries of engines say.
pub(crate) type Failure = Box<dyn Error + Send + Sync>;

/// How many calls of libraries are going on.
static INSIDE: AtomicUsize = AtomicUsize::new(0);

/// Whether a library of an engine is at work. A panic is then caught and becomes an [`EngineError`], so a program's panic hook need not report it.
pub fn inside_library() -> bool {
    INSIDE.load(Ordering::Relaxed) > 0
}

/// The answer of `work`; a panic becomes an error, because a model from a stranger may hit an assumption of the library.
pub(crate) fn unpanicked<T>(engine: &str, work: impl FnOnce() -> Result<T, Failure>) -> Result<T, EngineError> {
    INSIDE.fetch_add(1, Ordering::Relaxed);
    let answer = catch_unwind(AssertUnwindSafe(work));
    INSIDE.fetch_sub(1, Ordering::Relaxed);
    let answer = answer.unwrap_or_else(|panic| Err(format!("its library panicked: {}", told(&*panic)).into()));
    answer.map_err(|source| EngineError { engine: engine.to_owned(), source })
}

/// What a panic says.
fn told(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("it gives no reason")
}

#[cfg(test)]
mod tests {
    use super::unpanicked;

    #[test]
    fn a_panic_of_a_library_is_an_error() {
        let error = unpanicked("x", || -> Result<(), _> { panic!("index {} is out of range", 7) }).unwrap_err();
        assert_eq!(error.to_string(), "the engine x failed: its library panicked: index 7 is out of range");
    }
}

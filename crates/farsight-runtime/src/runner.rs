//! What runs a network: tensors in, tensors out.

use std::error::Error;

use farsight_onnx::TensorInfo;
use thiserror::Error;

/// A tensor in main memory.
#[derive(Debug, Clone, PartialEq)]
pub struct Tensor {
    /// Sizes of the axes, for maps `[batch, channels, height, width]`.
    pub shape: Vec<usize>,
    /// Values, the last axis fastest.
    pub values: Vec<f32>,
}

/// A tensor that somebody else owns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TensorView<'a> {
    /// Sizes of the axes.
    pub shape: &'a [usize],
    /// Values, the last axis fastest.
    pub values: &'a [f32],
}

impl Tensor {
    /// The part of this batch that belongs to one image.
    ///
    /// # Panics
    /// When the batch has no such image.
    pub fn image(&self, index: usize) -> TensorView<'_> {
        let length = self.shape[1..].iter().product::<usize>();
        TensorView { shape: &self.shape[1..], values: &self.values[index * length..][..length] }
    }
}

/// One network, ready to run: named tensors in, named tensors out. It knows nothing of images, cameras or methods.
pub trait Runner: Send {
    /// Name of its engine as users write it, `onnxruntime` for instance.
    fn engine(&self) -> &str;

    /// The inputs, as the file describes them. Batch, height and width of an input are free.
    fn inputs(&self) -> &[TensorInfo];

    /// The outputs, as the file describes them.
    fn outputs(&self) -> &[TensorInfo];

    /// All outputs, in the order of [`Runner::outputs`], for `inputs` by name.
    ///
    /// # Errors
    /// When an input is missing or has another shape than the network can take, or the engine fails, for want of memory
    /// for instance.
    fn run(&mut self, inputs: &[(&str, TensorView<'_>)]) -> Result<Vec<Tensor>, EngineError>;

    /// Takes back the values of an answer that was used: the next answer needs no other memory. Dropped by runners that
    /// have no use for them.
    fn recycle(&mut self, values: Vec<f32>) {
        drop(values);
    }

    /// A runner of the same network for another thread; the weights are shared where the engine can: rten, OpenVINO and
    /// libtorch do, ONNX Runtime does not. What a sharer needs for itself is made when it first runs.
    ///
    /// # Errors
    /// When the engine fails.
    fn share(&self) -> Result<Box<dyn Runner>, EngineError>;
}

/// The values given for `name`.
///
/// # Errors
/// When there are none, or not as many as their shape says.
pub(crate) fn input<'a>(
    inputs: &[(&str, TensorView<'a>)],
    name: &str,
) -> Result<TensorView<'a>, Box<dyn Error + Send + Sync>> {
    let found = inputs.iter().find(|(given, _)| *given == name).map(|(_, view)| *view);
    let view = found.ok_or_else(|| format!("no input \"{name}\""))?;
    let expected: usize = view.shape.iter().product();
    if view.values.len() != expected {
        return Err(format!("input \"{name}\" has {} values; its shape is {:?}", view.values.len(), view.shape).into());
    }
    Ok(view)
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

impl EngineError {
    /// The failure of `engine` for this reason.
    pub fn new(engine: &str, reason: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self { engine: engine.to_owned(), source: reason.into() }
    }

    /// `engine` was left out when the program was built; its cargo feature has the engine's name.
    pub fn not_built(engine: &str) -> Self {
        Self::new(engine, format!("it is not built in (cargo feature \"{engine}\")"))
    }
}

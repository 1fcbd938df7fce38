//! Running the network of a second stage on crops.

use std::path::Path;

use farsight_graph::model::{Model, NetworkConfig};
use farsight_onnx::{Facts, INPUT, OnnxError, OnnxModel, Target};
use farsight_runtime::{EngineError, Runner, TensorView};

/// So many crops, or pairs of one and its mirror image, are looked at together.
pub(crate) const BATCH: usize = 4;

/// A network over crops, ready to run.
pub struct RoiRunner {
    runner: Box<dyn Runner>,
}

/// The ONNX form of the network of a second stage; `source` is only what errors call it.
///
/// # Errors
/// When the weights do not fit the network.
pub fn onnx<C: NetworkConfig>(model: &Model<C>, target: Target, source: &Path) -> Result<OnnxModel, OnnxError> {
    OnnxModel::from_model(model, &Facts::new(model, target), target, source)
}

impl RoiRunner {
    /// The network that `runner` runs.
    pub fn new(runner: Box<dyn Runner>) -> Self {
        Self { runner }
    }

    /// The answers, of so many numbers each, for crops of `channels` x `side` x `side` that follow each other in
    /// `input`.
    ///
    /// # Errors
    /// When the engine fails.
    pub(crate) fn answers<const NUMBERS: usize>(
        &mut self,
        input: &[f32],
        channels: usize,
        side: usize,
    ) -> Result<Vec<[f64; NUMBERS]>, EngineError> {
        let shape = [input.len() / (channels * side * side), channels, side, side];
        let outputs = self.runner.run(&[(INPUT, TensorView { shape: &shape, values: input })])?;
        let answer = outputs.into_iter().next().filter(|answer| answer.values.len() == shape[0] * NUMBERS);
        let answer = answer.ok_or_else(|| EngineError::new(self.runner.engine(), "its answer has another size"))?;
        let (answers, _) = answer.values.as_chunks::<NUMBERS>();
        Ok(answers.iter().map(|answer| answer.map(f64::from)).collect())
    }

    /// The same network for another thread.
    ///
    /// # Errors
    /// When the engine fails.
    pub fn share(&self) -> Result<Self, EngineError> {
        Ok(Self { runner: self.runner.share()? })
    }
}

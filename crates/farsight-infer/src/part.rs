//! Small networks that look at cut-outs, on the built-in engine.

use farsight_net::onnx::INPUT;
use farsight_net::part::{ANSWER, PartConfig, PartModel};

use crate::EngineError;
use crate::library::unpanicked;
use crate::rten::{NAME, Network};

/// So many cut-outs, or pairs of one and its mirror image, are looked at together.
pub(crate) const BATCH: usize = 8;

/// A small network, ready to run.
pub(crate) struct PartNetwork {
    network: Network,
}

impl PartNetwork {
    /// Loads `model`, to be run by so many threads; `None` takes one for each core.
    ///
    /// # Errors
    /// When the weights do not fit the network.
    pub(crate) fn new<C: PartConfig>(model: &PartModel<C>, threads: Option<usize>) -> Result<Self, EngineError> {
        let network = unpanicked(NAME, || Network::new(model.onnx()?, INPUT, &[ANSWER.to_owned()], threads))?;
        Ok(Self { network })
    }

    /// The answers, of so many numbers each, for cut-outs of `channels` x `side` x `side` that follow each other in `input`.
    ///
    /// # Errors
    /// When the engine fails.
    pub(crate) fn answers<const NUMBERS: usize>(
        &self,
        input: &[f32],
        channels: usize,
        side: usize,
    ) -> Result<Vec<[f64; NUMBERS]>, EngineError> {
        let cutouts = input.len() / (channels * side * side);
        let values = unpanicked(NAME, || {
            let mut values = self.network.run(input, [cutouts, channels, side, side])?;
            let answer = values.pop().ok_or("no output")?;
            Ok(answer.into_shape_vec::<f32, 4>()?.1)
        })?;
        let (answers, _) = values.as_chunks::<NUMBERS>();
        Ok(answers.iter().map(|answer| answer.map(f64::from)).collect())
    }
}

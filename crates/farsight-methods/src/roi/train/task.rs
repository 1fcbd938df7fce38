//! A small network of [`farsight_graph::model`] that learns.

use farsight_graph::graph::NodeId;
use farsight_onnx::key;
use farsight_graph::model::{ANSWER, NetworkConfig, Model};
use tch::Tensor;

use super::CropRun;
use crate::checkpoint::Progress;
use crate::executor::{ExecutorError, Mode};
use crate::learner::Learner;
use crate::trainer::{Session, TrainError};

/// The network, how it learns, and where its answer stands.
pub(crate) struct PartLearner<'a, C> {
    pub(crate) run: &'a CropRun,
    pub(crate) config: &'a C,
    pub(crate) learner: Learner,
    answer: NodeId,
}

impl<'a, C: NetworkConfig> PartLearner<'a, C> {
    /// A network with the weights that the run starts or goes on with.
    pub(crate) fn start(
        run: &'a CropRun,
        config: &'a C,
        session: &Session<'_, CropRun>,
    ) -> Result<(Self, Progress), TrainError> {
        let graph = config.graph();
        let answer = graph.tap(ANSWER).ok_or_else(|| ExecutorError::Missing(ANSWER.to_owned()))?;
        let (learner, progress) = session.learner(graph)?;
        Ok((Self { run, config, learner, answer }, progress))
    }

    /// What it answers to `input` `[cut-outs, channels, side, side]`: `[cut-outs, channels]`.
    pub(crate) fn answers(&self, input: &Tensor) -> Tensor {
        self.learner.network.forward(input, Mode::Train, &[self.answer]).remove(0).flatten(1, 3)
    }

    /// What it has become after `progress` on so many frames.
    pub(crate) fn model(&self, progress: Progress, frames: usize) -> Model<C> {
        let train = &self.run.train;
        let mut weights = self.learner.weights();
        let facts = serde_json::json!({ "steps": progress.steps, "epochs": train.epochs, "seed": train.seed, "frames": frames });
        weights.metadata.insert(key::TRAINING.to_owned(), facts.to_string());
        Model { config: self.config.clone(), weights }
    }
}

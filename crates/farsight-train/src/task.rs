//! What a method says about its training.

use std::sync::Arc;

use farsight_data::{Dataset, DatasetError, ItemKey};
use farsight_graph::graph::{Graph, NodeId};
use farsight_graph::model::{Model, ModelError, NetworkConfig};
use farsight_graph::weights::Weights;
use tch::{Device, Tensor};

use crate::config::{RunConfig, TaskConfig};
use crate::error::TrainError;
use crate::metrics::Metrics;

/// Makes what a task learns from of the frame that a key stands for; shared by the loader's threads. The same key gives
/// the same sample, always.
pub type Sampler<S> = Box<dyn Fn(ItemKey) -> Result<S, DatasetError> + Send + Sync>;

/// The config of a task's run.
pub type RunOf<T> = RunConfig<<T as Task>::Model, <T as Task>::Config>;

/// A network that can learn something: what its samples are, what a step is, what becomes of its weights.
pub trait Task: Sized {
    /// The network's config.
    type Model: NetworkConfig;
    /// What the task alone has in its config.
    type Config: TaskConfig;
    /// What is prepared of one frame.
    type Sample: Send + 'static;
    /// Tensors of a batch.
    type Batch;
    /// What a step is judged by, beside its loss.
    type Metrics: Metrics;

    /// Name of the trained model in a run's folder.
    const MODEL_FILE: &'static str;

    /// The task of `run` and the graph that learns, which may have more than the model: heads for training only.
    /// `start` are the weights that the run starts from, if it starts from any.
    ///
    /// # Errors
    /// When the run cannot be trained.
    fn new(run: &RunOf<Self>, start: Option<&Weights>) -> Result<(Self, Graph), TrainError>;

    /// Makes samples of the frames of `source`.
    ///
    /// # Errors
    /// When the frames lack what the task learns from.
    fn sampler(run: &RunOf<Self>, source: Arc<dyn Dataset>) -> Result<Sampler<Self::Sample>, TrainError>;

    /// Name of a sample's frame.
    fn name(sample: &Self::Sample) -> &str;

    /// The tensors of a batch; none when there is nothing to learn from these samples.
    fn batch(&self, samples: Vec<Self::Sample>, device: Device) -> Option<Self::Batch>;

    /// The network's input, `[batch, channels, height, width]`.
    fn input(batch: &Self::Batch) -> &Tensor;

    /// What the sampler at this place between the parts of the graph ([`farsight_graph::graph::Op::Sampler`]; the first
    /// is 0) makes of the maps that are read there, `[batch, channels, height, width]`. Graphs without one never ask.
    fn sampled(&self, place: usize, maps: &[Tensor], batch: &Self::Batch) -> Tensor {
        let _ = (place, maps, batch);
        unreachable!("a task whose graph has a sampler says what it does")
    }

    /// The nodes that the loss reads.
    fn outputs(&self) -> &[NodeId];

    /// The loss of `outputs`, which are those of [`Task::outputs`], in that order.
    fn loss(&self, outputs: &[Tensor], batch: &Self::Batch) -> StepOutput<Self::Metrics>;

    /// The model with these weights, of which those of heads for training only are dropped.
    ///
    /// # Errors
    /// When they do not fit.
    fn model(&self, run: &RunOf<Self>, weights: Weights) -> Result<Model<Self::Model>, ModelError>;
}

/// What a step gives.
#[derive(Debug)]
pub struct StepOutput<M> {
    /// What is differentiated. Its value need not be the loss, its gradient is the loss's.
    pub objective: Tensor,
    /// The loss.
    pub loss: f64,
    /// What else the step is judged by.
    pub metrics: M,
    /// How many samples it learnt from.
    pub samples: usize,
}

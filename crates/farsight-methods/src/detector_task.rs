//! Training of a detector: what is the same for all methods. A method says what its network should answer to one image,
//! what a batch of such answers is, and its loss ([`DetectorLoss`]).

use std::fmt::Debug;
use std::sync::Arc;

use farsight_core::input::InputRules;
use farsight_data::{Dataset, Frame, Sample};
use farsight_graph::graph::{Graph, NodeId};
use farsight_graph::model::{Model, ModelError, NetworkConfig};
use farsight_graph::weights::Weights;
use farsight_train::config::{RunConfig, TaskConfig};
use farsight_train::executor::ExecutorError;
use farsight_train::metrics::Metrics;
use farsight_train::task::{RunOf, Sampler, StepOutput, Task};
use farsight_train::training::TrainError;
use rand_pcg::Pcg64;
use tch::{Device, Tensor};

use crate::tensors::stacked;

/// One image as the network sees it, and what it should answer.
#[derive(Debug)]
pub struct TrainSample<T> {
    id: String,
    /// `[3, height, width]`.
    input: Vec<f32>,
    /// What it should answer.
    pub(crate) targets: T,
    /// Whether what an augmented image no longer shows, depth and size, is learnt from it.
    pub(crate) regress: bool,
}

/// Tensors of a batch.
#[derive(Debug)]
pub struct TrainBatch<B> {
    /// `[batch, 3, height, width]`.
    input: Tensor,
    /// What the network should answer.
    expected: B,
}

/// What a method alone says about its training.
pub trait DetectorLoss: Debug + Sized + Send + Sync + 'static {
    /// The network's config.
    type Model: NetworkConfig;
    /// The method's table `[task]`.
    type Config: TaskConfig;
    /// What the network should answer to one image.
    type Targets: Debug + Send + 'static;
    /// The same of a batch, as tensors.
    type Batch: Debug;
    /// What a step is judged by. Its numbers add up to the loss.
    type Metrics: Metrics;

    /// The taps of the graph that the loss reads.
    const READS: &'static [&'static str] = <Self::Model as NetworkConfig>::OUTPUTS;

    /// The loss of a run.
    fn new(run: &RunConfig<Self::Model, Self::Config>) -> Self;

    /// How images become inputs.
    fn input_rules(model: &Self::Model) -> InputRules;

    /// What the network should answer to `sample`, which is `frame` as the network sees it. What is left to chance
    /// comes from `rng`.
    fn targets(&self, frame: &Frame, sample: &Sample, rng: &mut Pcg64) -> Self::Targets;

    /// The targets of several images, joined.
    fn batch(&self, samples: &[TrainSample<Self::Targets>], device: Device) -> Self::Batch;

    /// As [`Task::sampled`].
    fn sampled(&self, place: usize, maps: &[Tensor], batch: &Self::Batch) -> Tensor {
        let _ = (place, maps, batch);
        unreachable!("a method whose graph has a sampler says what it does")
    }

    /// What is differentiated, and the terms of the loss; `outputs` are those of [`DetectorLoss::READS`].
    fn loss(&self, outputs: &[Tensor], batch: &Self::Batch) -> (Tensor, Self::Metrics);
}

/// A detector, learning.
#[derive(Debug)]
pub struct DetectorTask<L> {
    loss: L,
    /// Width and height of the input, pixels.
    input: [usize; 2],
    outputs: Vec<NodeId>,
}

impl<L: DetectorLoss> Task for DetectorTask<L> {
    type Model = L::Model;
    type Config = L::Config;
    type Sample = TrainSample<L::Targets>;
    type Batch = TrainBatch<L::Batch>;
    type Metrics = L::Metrics;

    const MODEL_FILE: &'static str = "model.safetensors";

    fn new(run: &RunOf<Self>, _: Option<&Weights>) -> Result<(Self, Graph), TrainError> {
        let graph = run.model.graph();
        let output = |name: &&str| graph.tap(name).ok_or_else(|| ExecutorError::Missing((*name).to_owned()));
        let outputs = L::READS.iter().map(output).collect::<Result<_, _>>()?;
        let input = L::input_rules(&run.model).size;
        Ok((Self { loss: L::new(run), input, outputs }, graph))
    }

    fn sampler(run: &RunOf<Self>, source: Arc<dyn Dataset>) -> Result<Sampler<Self::Sample>, TrainError> {
        let (loss, rules, augmentation) = (L::new(run), L::input_rules(&run.model), run.augmentation.clone());
        Ok(Box::new(move |key| {
            let frame = source.item(key)?;
            let mut rng = key.rng();
            let sample = augmentation.draw(&mut rng, frame.image_size(), &rules).apply(&frame, &rules);
            let targets = loss.targets(&frame, &sample, &mut rng);
            let Sample { id, input, regress, .. } = sample;
            Ok(TrainSample { id, input, targets, regress })
        }))
    }

    fn name(sample: &Self::Sample) -> &str {
        &sample.id
    }

    fn batch(&self, samples: Vec<Self::Sample>, device: Device) -> Option<Self::Batch> {
        let input = stacked(samples.iter().map(|sample| &sample.input[..]), self.input, device);
        Some(TrainBatch { input, expected: self.loss.batch(&samples, device) })
    }

    fn input(batch: &Self::Batch) -> &Tensor {
        &batch.input
    }

    fn sampled(&self, place: usize, maps: &[Tensor], batch: &Self::Batch) -> Tensor {
        self.loss.sampled(place, maps, &batch.expected)
    }

    fn outputs(&self) -> &[NodeId] {
        &self.outputs
    }

    fn loss(&self, outputs: &[Tensor], batch: &Self::Batch) -> StepOutput<L::Metrics> {
        let (objective, metrics) = self.loss.loss(outputs, &batch.expected);
        let loss = metrics.named().iter().map(|(_, value)| value).sum();
        StepOutput { objective, loss, metrics, samples: batch.input.size()[0] as usize }
    }

    fn model(&self, run: &RunOf<Self>, weights: Weights) -> Result<Model<L::Model>, ModelError> {
        Model::new(run.model.clone(), weights)
    }
}

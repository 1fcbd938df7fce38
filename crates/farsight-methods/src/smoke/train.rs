//! Training of SMOKE.

pub mod loss;
pub mod samples;

use std::sync::Arc;

use farsight_data::Dataset;
use farsight_graph::graph::{Graph, NodeId};
use farsight_graph::model::{Model, ModelError, NetworkConfig, is_pruned};
use farsight_graph::weights::Weights;
use farsight_train::config::{DataConfig, RunConfig, TaskConfig};
use farsight_train::executor::ExecutorError;
use farsight_train::task::{Sampler, StepOutput, Task};
use farsight_train::training::TrainError;
use serde::{Deserialize, Serialize};
use tch::{Device, Tensor};

use super::network::{FEATURES, LOGITS, REGRESSION, SURFACE, with_surface_head};
use super::{Codec, SmokeConfig, SmokeModel};
use loss::{CORNER_DIVISOR_PER_IMAGE, CornerWeights, LossTerms, loss, surface_loss};
use samples::{SampleMaker, TrainBatch, TrainSample};

/// A run that trains SMOKE.
pub type SmokeRun = RunConfig<SmokeConfig, SmokeTaskConfig>;

/// What is SMOKE's own in a training: its loss. The defaults are official SMOKE's.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SmokeTaskConfig {
    /// Objects farther than this, metres, count in the corner loss in inverse proportion to their distance, so that
    /// relative errors are learnt rather than the guesses of the horizon; 0: all count the same, as in SMOKE.
    pub full_weight_m: f64,
    /// Factor on the orientation's part of the corner loss; 1 in SMOKE.
    pub orientation_weight: f64,
    /// Factor on the dimensions' part of the corner loss; 1 in SMOKE.
    pub dimensions_weight: f64,
    /// Weight of one more part of the corner loss, the predicted box as the image shows it, which judges apparent
    /// sizes; 0 for none, as in SMOKE.
    pub image_weight: f64,
    /// How many cells around an object's own teach the regression too, either way; 0: only its own, as in SMOKE.
    pub neighbour_cells: usize,
    /// Weight of an auxiliary loss, the depth of whatever each cell shows, which rendered scenes know; 0 for none. Its
    /// head is not part of the model.
    pub surface_weight: f64,
}

impl Default for SmokeTaskConfig {
    fn default() -> Self {
        Self {
            full_weight_m: 0.0,
            orientation_weight: 1.0,
            dimensions_weight: 1.0,
            image_weight: 0.0,
            neighbour_cells: 0,
            surface_weight: 0.0,
        }
    }
}

impl TaskConfig for SmokeTaskConfig {
    fn problem(&self, data: &DataConfig) -> Option<String> {
        let weights = [
            ("full_weight_m", self.full_weight_m),
            ("orientation_weight", self.orientation_weight),
            ("dimensions_weight", self.dimensions_weight),
            ("image_weight", self.image_weight),
            ("surface_weight", self.surface_weight),
        ];
        if self.surface_weight > 0.0 && data.rendered.is_none() {
            return Some("surface_weight needs data.rendered; other frames have no depth".to_owned());
        }
        let wrong = weights.iter().find(|(_, weight)| !(weight.is_finite() && *weight >= 0.0));
        wrong.map(|(name, weight)| format!("{name} is {weight}; expected 0 or a positive number"))
    }
}

/// SMOKE, learning.
#[derive(Debug)]
pub struct SmokeTask {
    config: SmokeTaskConfig,
    /// Width and height of the input, pixels.
    input: [usize; 2],
    codec: Codec,
    /// Logits, regression and, where it is learnt, the surface.
    outputs: Vec<NodeId>,
    is_pruned: bool,
}

impl SmokeTask {
    /// How the corner loss of a batch of `images` is weighed.
    fn corner_weights(&self, images: usize) -> CornerWeights {
        let task = &self.config;
        CornerWeights {
            divisor: CORNER_DIVISOR_PER_IMAGE * images as f64,
            full_weight_m: (task.full_weight_m > 0.0).then_some(task.full_weight_m),
            orientation: task.orientation_weight,
            dimensions: task.dimensions_weight,
            image: task.image_weight,
        }
    }
}

impl Task for SmokeTask {
    type Model = SmokeConfig;
    type Config = SmokeTaskConfig;
    type Sample = TrainSample;
    type Batch = TrainBatch;
    type Metrics = LossTerms;

    const MODEL_FILE: &'static str = "model.safetensors";

    fn new(run: &SmokeRun, start: Option<&Weights>) -> Result<(Self, Graph), TrainError> {
        // A run that starts from a pruned model has its narrower layers.
        let graph = match start.filter(|weights| is_pruned(weights)) {
            Some(weights) => SmokeModel::pruned(run.model.clone(), weights.clone())?.graph,
            None => run.model.graph(),
        };
        let is_pruned = graph != run.model.graph();
        let missing = |name: &str| ExecutorError::Missing(name.to_owned());
        let graph = if run.task.surface_weight > 0.0 {
            with_surface_head(graph, run.model.norm).ok_or_else(|| missing(FEATURES))?
        } else {
            graph
        };
        let output = |name: &str| graph.tap(name).ok_or_else(|| missing(name));
        let mut outputs = vec![output(LOGITS)?, output(REGRESSION)?];
        outputs.extend(graph.tap(SURFACE));
        let (config, codec) = (run.task.clone(), run.model.codec());
        Ok((Self { config, input: run.model.input, codec, outputs, is_pruned }, graph))
    }

    fn sampler(run: &SmokeRun, source: Arc<dyn Dataset>) -> Result<Sampler<TrainSample>, TrainError> {
        let maker = SampleMaker::new(source, &run.model, run.augmentation.clone());
        Ok(Box::new(move |key| maker.sample(key)))
    }

    fn name(sample: &TrainSample) -> &str {
        &sample.id
    }

    fn batch(&self, samples: Vec<TrainSample>, device: Device) -> Option<TrainBatch> {
        let mut batch = TrainBatch::new(samples, self.input, device);
        batch.targets = batch.targets.with_neighbours(self.config.neighbour_cells);
        Some(batch)
    }

    fn input(batch: &TrainBatch) -> &Tensor {
        &batch.input
    }

    fn outputs(&self) -> &[NodeId] {
        &self.outputs
    }

    fn loss(&self, outputs: &[Tensor], batch: &TrainBatch) -> StepOutput<LossTerms> {
        let images = batch.targets.cameras.len();
        let weights = self.corner_weights(images);
        let (mut objective, mut terms) = loss(&self.codec, &outputs[0], &outputs[1], &batch.targets, weights);
        if let (Some(predicted), Some(surface_m)) = (outputs.get(2), &batch.targets.surface_m) {
            let surface = surface_loss(predicted, surface_m, self.codec.depth.mean_m) * self.config.surface_weight;
            terms.surface = surface.double_value(&[]);
            objective += surface;
        }
        StepOutput { objective, loss: terms.total(), metrics: terms, samples: images }
    }

    fn model(&self, run: &SmokeRun, weights: Weights) -> Result<SmokeModel, ModelError> {
        if self.is_pruned { Model::pruned(run.model.clone(), weights) } else { Model::new(run.model.clone(), weights) }
    }
}

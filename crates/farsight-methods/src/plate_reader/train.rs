//! Training of a plate reader.

mod samples;

use std::sync::Arc;

use farsight_data::Dataset;
use farsight_data::annotations::Plates;
use farsight_graph::graph::{Graph, NodeId};
use farsight_graph::model::{ModelError, NetworkConfig};
use farsight_graph::weights::Weights;
use farsight_train::config::{DataConfig, RunConfig, TaskConfig};
use farsight_train::executor::ExecutorError;
use farsight_train::metrics::Metrics;
use farsight_train::task::{Sampler, StepOutput, Task};
use farsight_train::training::TrainError;
use serde::{Deserialize, Serialize};
use tch::{Device, Kind, Tensor};

use super::geometry::EXPECTED_WIDTH;
use super::{PlateReaderConfig, PlateReaderModel};
use crate::refiner::geometry::{ERROR_UNIT, LOG_UNIT, MAX_ERROR_LOG};
use crate::roi::ANSWER;
use samples::{FramePlates, PlateBatch, PlateMaker};

/// A run that trains a plate reader.
pub type PlateReaderRun = RunConfig<PlateReaderConfig, PlateReaderTaskConfig>;

/// What is a plate reader's own in a training: which vehicles it learns from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PlateReaderTaskConfig {
    /// At most so many vehicles of one frame whose plates are seen, drawn at random.
    pub objects_per_frame: usize,
    /// Vehicles whose box is lower than this are not learnt from, pixels.
    pub least_height_px: f64,
    /// At most so many vehicles of one frame whose plates are not seen teach the reader to be unsure, drawn at random.
    pub hidden_plates_per_frame: usize,
}

impl Default for PlateReaderTaskConfig {
    fn default() -> Self {
        Self { objects_per_frame: 8, least_height_px: 20.0, hidden_plates_per_frame: 1 }
    }
}

impl TaskConfig for PlateReaderTaskConfig {
    fn problem(&self, _: &DataConfig) -> Option<String> {
        let height = self.least_height_px;
        (self.objects_per_frame == 0).then(|| "objects_per_frame is 0; expected at least 1".to_owned()).or_else(|| {
            let wrong = !(height.is_finite() && height >= 0.0);
            wrong.then(|| format!("least_height_px is {height}; expected a number that is not negative"))
        })
    }
}

/// Weight of where a plate is seen (ends and height, sides of the crop) beside the likelihood of its width.
const PLACE_WEIGHT: f64 = 10.0;

/// What a step of a plate reader is judged by, beside its loss.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct PlateReaderMetrics {
    /// Mean error of the logarithm of the width, seen plates and hidden ones.
    pub width_error: f64,
    /// Mean of how far off the reader thinks it is.
    pub told_error: f64,
}

impl Metrics for PlateReaderMetrics {
    const SAMPLES: &'static str = "crops";

    fn named(&self) -> Vec<(&'static str, f64)> {
        vec![("width_error", self.width_error), ("told_error", self.told_error)]
    }

    fn zip_with(&self, other: &Self, joined: impl Fn(f64, f64) -> f64) -> Self {
        Self {
            width_error: joined(self.width_error, other.width_error),
            told_error: joined(self.told_error, other.told_error),
        }
    }
}

/// A plate reader, learning.
#[derive(Debug)]
pub struct PlateReaderTask {
    side: usize,
    answer: [NodeId; 1],
}

impl Task for PlateReaderTask {
    type Model = PlateReaderConfig;
    type Config = PlateReaderTaskConfig;
    type Sample = FramePlates;
    type Batch = PlateBatch;
    type Metrics = PlateReaderMetrics;

    const MODEL_FILE: &'static str = "plates.safetensors";

    fn new(run: &PlateReaderRun, _: Option<&Weights>) -> Result<(Self, Graph), TrainError> {
        let graph = run.model.graph();
        let answer = graph.tap(ANSWER).ok_or_else(|| ExecutorError::Missing(ANSWER.to_owned()))?;
        Ok((Self { side: run.model.side, answer: [answer] }, graph))
    }

    fn sampler(run: &PlateReaderRun, source: Arc<dyn Dataset>) -> Result<Sampler<FramePlates>, TrainError> {
        if !source.has::<Plates>() {
            return Err(TrainError::NoPlates);
        }
        let (augmentation, task) = (run.augmentation.clone(), run.task.clone());
        let maker = PlateMaker { source, augmentation, task, side: run.model.side };
        Ok(Box::new(move |key| maker.samples(key)))
    }

    fn name(sample: &FramePlates) -> &str {
        &sample.id
    }

    fn batch(&self, samples: Vec<FramePlates>, device: Device) -> Option<PlateBatch> {
        PlateBatch::new(&samples, self.side, device)
    }

    fn input(batch: &PlateBatch) -> &Tensor {
        &batch.input
    }

    fn outputs(&self) -> &[NodeId] {
        &self.answer
    }

    fn loss(&self, outputs: &[Tensor], batch: &PlateBatch) -> StepOutput<PlateReaderMetrics> {
        let answer = outputs[0].flatten(1, 3);
        let [middle, down, wider, error_log] = [0, 1, 2, 3].map(|channel| answer.select(1, channel));
        let error_log = error_log.clamp(-MAX_ERROR_LOG, MAX_ERROR_LOG);
        let off = (&wider - &batch.wider).abs();
        // The negative logarithm of the likelihood under Laplace's distribution, whose width the network says too.
        let likelihood = (&off * (LOG_UNIT / ERROR_UNIT) * (-&error_log).exp() + &error_log).mean(Kind::Float);
        let half_width = (wider * LOG_UNIT).exp() * (EXPECTED_WIDTH / 2.0);
        let place = Tensor::stack(&[&middle - &half_width, &middle + &half_width, down], 1);
        let objective = likelihood + place_error(&place, &batch.places) * PLACE_WEIGHT;
        let metrics = PlateReaderMetrics {
            width_error: LOG_UNIT * off.mean(Kind::Float).double_value(&[]),
            told_error: ERROR_UNIT * error_log.exp().mean(Kind::Float).double_value(&[]),
        };
        let (loss, samples) = (objective.double_value(&[]), batch.input.size()[0] as usize);
        StepOutput { objective, loss, metrics, samples }
    }

    fn model(&self, run: &PlateReaderRun, weights: Weights) -> Result<PlateReaderModel, ModelError> {
        PlateReaderModel::new(run.model.clone(), weights)
    }
}

/// Mean over the crops of how far off the places `[crops, 3]` are, where they are known.
fn place_error(found: &Tensor, known: &Tensor) -> Tensor {
    // What is no number would stay none when it is weighted by 0.
    let off = (found - known.nan_to_num(0.0, None, None)).abs();
    let is_known = known.isnan().logical_not();
    (off * is_known.to_kind(Kind::Float)).sum(Kind::Float) / (found.size()[0] as f64)
}

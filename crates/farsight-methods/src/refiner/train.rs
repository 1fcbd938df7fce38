//! Training of a refiner.

mod detected;
mod samples;

use std::sync::Arc;

use std::path::PathBuf;

use farsight_data::Dataset;
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

use super::geometry::{ERROR_UNIT, LOG_UNIT, MAX_ERROR_LOG, PLACE_CHANNELS};
use super::{RefinerConfig, RefinerModel};
use crate::roi::ANSWER;
use crate::roi::train::MAX_TRUNCATED;
use samples::{CropBatch, CropMaker, FrameCrops};

/// A run that trains a refiner.
pub type RefinerRun = RunConfig<RefinerConfig, RefinerTaskConfig>;

/// What is a refiner's own in a training: which objects it learns from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RefinerTaskConfig {
    /// At most so many objects of one frame, drawn at random.
    pub objects_per_frame: usize,
    /// Objects whose box is lower than this are not learnt from, pixels.
    pub least_height_px: f64,
    /// Objects of which the image's edge cuts a larger share are not learnt from.
    pub most_truncated: f64,
    /// Folder of a detector's result files for the frames of `data.root`: its false positives are the background class.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub detections: Option<PathBuf>,
    /// Share of the objects that the detector has which are cut out where it has them; the others are cut out around
    /// their true boxes with errors.
    pub detected_share: f64,
    /// At most so many false positives of one frame, drawn at random.
    pub false_positives_per_frame: usize,
}

impl Default for RefinerTaskConfig {
    fn default() -> Self {
        Self {
            objects_per_frame: 8,
            least_height_px: 20.0,
            most_truncated: MAX_TRUNCATED,
            detections: None,
            detected_share: 0.0,
            false_positives_per_frame: 3,
        }
    }
}

impl TaskConfig for RefinerTaskConfig {
    fn problem(&self, data: &DataConfig) -> Option<String> {
        if self.detections.is_some() && data.rendered.is_some() {
            return Some("detections needs data.root; a stream of scenes has no result files".to_owned());
        }
        let share = self.detected_share;
        if !(0.0..=1.0).contains(&share) {
            return Some(format!("detected_share is {share}; expected 0 to 1"));
        }
        if share > 0.0 && self.detections.is_none() {
            return Some("detected_share needs detections".to_owned());
        }
        if !(0.0..=1.0).contains(&self.most_truncated) {
            return Some(format!("most_truncated is {}; expected 0 to 1", self.most_truncated));
        }
        let height = self.least_height_px;
        (self.objects_per_frame == 0).then(|| "objects_per_frame is 0; expected at least 1".to_owned()).or_else(|| {
            let wrong = !(height.is_finite() && height >= 0.0);
            wrong.then(|| format!("least_height_px is {height}; expected a number that is not negative"))
        })
    }
}

/// Weights of the parts of the loss beside the logarithms' likelihood: apparent height (in [`ERROR_UNIT`]), centre
/// (sides), heading, kind.
const APPARENT_WEIGHT: f64 = 1.0;
const CENTER_WEIGHT: f64 = 30.0;
const HEADING_WEIGHT: f64 = 3.0;
const KIND_WEIGHT: f64 = 2.0;

/// What a step of a refiner is judged by, beside its loss.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct RefinerMetrics {
    /// Mean error of the logarithm of the depth.
    pub depth_error: f64,
    /// Share of crops that are taken for another kind of thing.
    pub kind_error: f64,
}

impl Metrics for RefinerMetrics {
    const SAMPLES: &'static str = "crops";

    fn named(&self) -> Vec<(&'static str, f64)> {
        vec![("depth_error", self.depth_error), ("kind_error", self.kind_error)]
    }

    fn zip_with(&self, other: &Self, joined: impl Fn(f64, f64) -> f64) -> Self {
        Self {
            depth_error: joined(self.depth_error, other.depth_error),
            kind_error: joined(self.kind_error, other.kind_error),
        }
    }
}

/// A refiner, learning.
#[derive(Debug)]
pub struct RefinerTask {
    side: usize,
    answer: [NodeId; 1],
}

impl Task for RefinerTask {
    type Model = RefinerConfig;
    type Config = RefinerTaskConfig;
    type Sample = FrameCrops;
    type Batch = CropBatch;
    type Metrics = RefinerMetrics;

    const MODEL_FILE: &'static str = "refiner.safetensors";

    fn new(run: &RefinerRun, _: Option<&Weights>) -> Result<(Self, Graph), TrainError> {
        let graph = run.model.graph();
        let answer = graph.tap(ANSWER).ok_or_else(|| ExecutorError::Missing(ANSWER.to_owned()))?;
        Ok((Self { side: run.model.side, answer: [answer] }, graph))
    }

    fn sampler(run: &RefinerRun, source: Arc<dyn Dataset>) -> Result<Sampler<FrameCrops>, TrainError> {
        let (augmentation, task) = (run.augmentation.clone(), run.task.clone());
        let maker = CropMaker { source, augmentation, task, side: run.model.side };
        Ok(Box::new(move |key| maker.samples(key)))
    }

    fn name(sample: &FrameCrops) -> &str {
        &sample.id
    }

    fn batch(&self, samples: Vec<FrameCrops>, device: Device) -> Option<CropBatch> {
        CropBatch::new(&samples, self.side, device)
    }

    fn input(batch: &CropBatch) -> &Tensor {
        &batch.input
    }

    fn outputs(&self) -> &[NodeId] {
        &self.answer
    }

    fn loss(&self, outputs: &[Tensor], batch: &CropBatch) -> StepOutput<RefinerMetrics> {
        let answer = outputs[0].flatten(1, 3);
        let places = PLACE_CHANNELS as i64;
        let place = answer.narrow(1, 0, places).index_select(0, &batch.objects);
        let kinds = answer.narrow(1, places, answer.size()[1] - places).index_select(0, &batch.known);
        let objective = place_loss(&place, &batch.targets) + kinds.cross_entropy_for_logits(&batch.kinds) * KIND_WEIGHT;
        let depth_error = (place.select(1, 0) - batch.targets.select(1, 0)).abs().mean(Kind::Float) * LOG_UNIT;
        let wrong = kinds.argmax(1, false).not_equal_tensor(&batch.kinds).to_kind(Kind::Float).mean(Kind::Float);
        let metrics =
            RefinerMetrics { depth_error: depth_error.double_value(&[]), kind_error: wrong.double_value(&[]) };
        let (loss, samples) = (objective.double_value(&[]), batch.input.size()[0] as usize);
        StepOutput { objective, loss, metrics, samples }
    }

    fn model(&self, run: &RefinerRun, weights: Weights) -> Result<RefinerModel, ModelError> {
        RefinerModel::new(run.model.clone(), weights)
    }
}

/// Mean over the objects of the places `answer` `[objects, 10]` against `targets` `[objects, 8]`.
///
/// Depth and sizes: the negative logarithm of the likelihood under Laplace's distribution, whose width the network says
/// too. The apparent height, height over depth, is judged once more by itself: it is what the picture shows, whatever
/// the size.
fn place_loss(answer: &Tensor, targets: &Tensor) -> Tensor {
    let channels = |tensor: &Tensor, first: i64, count: i64| tensor.narrow(1, first, count);
    let off = |first: i64, count: i64| channels(answer, first, count) - channels(targets, first, count);
    let logs = |first: i64, count: i64| off(first, count).abs() * (LOG_UNIT / ERROR_UNIT);
    let likelihood = |errors: Tensor, channel: i64| {
        let width = channels(answer, channel, 1).clamp(-MAX_ERROR_LOG, MAX_ERROR_LOG);
        (errors * (-&width).exp() + width).mean(Kind::Float)
    };
    let depth = likelihood(logs(0, 1), 8);
    let sizes = likelihood(logs(3, 3), 9);
    let apparent = (off(4, 1) - off(0, 1)).abs().mean(Kind::Float) * (LOG_UNIT / ERROR_UNIT);
    let center = off(1, 2).abs().mean(Kind::Float);
    let heading = off(6, 2).abs().mean(Kind::Float);
    depth + sizes * 2.0 + apparent * APPARENT_WEIGHT + center * CENTER_WEIGHT + heading * HEADING_WEIGHT
}

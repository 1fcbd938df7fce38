//! Training of a camera estimator.

mod samples;

use std::sync::Arc;

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

use super::geometry::{ERROR_UNIT, MAX_ERROR_LOG, NUMBERS, UNITS};
use super::{CameraEstimatorConfig, CameraEstimatorModel};
use crate::roi::ANSWER;
use samples::{CameraBatch, CameraMaker, CameraSample};

/// A run that trains a camera estimator.
pub type CameraEstimatorRun = RunConfig<CameraEstimatorConfig, CameraEstimatorTaskConfig>;

/// A camera estimator's training has nothing of its own to be said.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CameraEstimatorTaskConfig {}

impl TaskConfig for CameraEstimatorTaskConfig {
    fn problem(&self, _: &DataConfig) -> Option<String> {
        None
    }
}

/// What a step of a camera estimator is judged by, beside its loss: mean absolute errors.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct CameraEstimatorMetrics {
    /// Of the logarithm of the focal length.
    pub focal_error: f64,
    /// Of the horizon, heights of the input.
    pub horizon_error: f64,
    /// Of the roll, radians.
    pub roll_error: f64,
}

impl Metrics for CameraEstimatorMetrics {
    const SAMPLES: &'static str = "images";

    fn named(&self) -> Vec<(&'static str, f64)> {
        vec![("focal_error", self.focal_error), ("horizon_error", self.horizon_error), ("roll_error", self.roll_error)]
    }

    fn zip_with(&self, other: &Self, joined: impl Fn(f64, f64) -> f64) -> Self {
        Self {
            focal_error: joined(self.focal_error, other.focal_error),
            horizon_error: joined(self.horizon_error, other.horizon_error),
            roll_error: joined(self.roll_error, other.roll_error),
        }
    }
}

/// A camera estimator, learning.
#[derive(Debug)]
pub struct CameraEstimatorTask {
    answer: [NodeId; 1],
}

impl Task for CameraEstimatorTask {
    type Model = CameraEstimatorConfig;
    type Config = CameraEstimatorTaskConfig;
    type Sample = CameraSample;
    type Batch = CameraBatch;
    type Metrics = CameraEstimatorMetrics;

    const MODEL_FILE: &'static str = "camera.safetensors";

    fn new(run: &CameraEstimatorRun, _: Option<&Weights>) -> Result<(Self, Graph), TrainError> {
        let graph = run.model.graph();
        let answer = graph.tap(ANSWER).ok_or_else(|| ExecutorError::Missing(ANSWER.to_owned()))?;
        Ok((Self { answer: [answer] }, graph))
    }

    fn sampler(run: &CameraEstimatorRun, source: Arc<dyn Dataset>) -> Result<Sampler<CameraSample>, TrainError> {
        let maker = CameraMaker { source, augmentation: run.augmentation.clone() };
        Ok(Box::new(move |key| maker.sample(key)))
    }

    fn name(sample: &CameraSample) -> &str {
        &sample.id
    }

    fn batch(&self, samples: Vec<CameraSample>, device: Device) -> Option<CameraBatch> {
        CameraBatch::new(&samples, device)
    }

    fn input(batch: &CameraBatch) -> &Tensor {
        &batch.input
    }

    fn outputs(&self) -> &[NodeId] {
        &self.answer
    }

    /// The negative logarithm of the likelihood under Laplace distributions whose widths the network says, too.
    fn loss(&self, outputs: &[Tensor], batch: &CameraBatch) -> StepOutput<CameraEstimatorMetrics> {
        let answer = outputs[0].flatten(1, 3).view([-1, NUMBERS as i64, 2]);
        let error_log = answer.select(2, 1).clamp(-MAX_ERROR_LOG, MAX_ERROR_LOG);
        let off = (answer.select(2, 0) - &batch.numbers).abs();
        let objective = (&off / ERROR_UNIT * (-&error_log).exp() + &error_log).mean(Kind::Float);
        let mean = off.mean_dim([0_i64].as_slice(), false, Kind::Float);
        let [focal_error, horizon_error, roll_error] =
            std::array::from_fn(|i| UNITS[i] * mean.double_value(&[i as i64]));
        let (loss, samples) = (objective.double_value(&[]), batch.input.size()[0] as usize);
        StepOutput {
            objective,
            loss,
            metrics: CameraEstimatorMetrics { focal_error, horizon_error, roll_error },
            samples,
        }
    }

    fn model(&self, run: &CameraEstimatorRun, weights: Weights) -> Result<CameraEstimatorModel, ModelError> {
        CameraEstimatorModel::new(run.model.clone(), weights)
    }
}

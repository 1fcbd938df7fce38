//! Training of a refiner.

use std::path::PathBuf;

use crate::refiner::geometry::{ERROR_UNIT, LARGEST_ERROR_LOG, LOG_UNIT, PLACE_CHANNELS};
use crate::refiner::RefinerConfig;
use serde::Serialize;
use tch::{Kind, Tensor};

use super::samples::{CropBatch, CropSampler, FrameCrops};
use crate::crops::{CropRun, PartLearner};
use crate::learner::Learner;
use crate::metrics::{Lesson, Terms};
use crate::trainer::{Job, NotFinite, Observer, Pupil, Session, TrainError};

/// Name of the trained refiner in a run's folder.
pub const REFINER_FILE: &str = "refiner.safetensors";

/// Weights of the parts of the loss beside the logarithms' likelihood: apparent height (in [`ERROR_UNIT`]), centre (sides), heading, kind.
const APPARENT_WEIGHT: f64 = 1.0;
const CENTER_WEIGHT: f64 = 30.0;
const HEADING_WEIGHT: f64 = 3.0;
const KIND_WEIGHT: f64 = 2.0;

/// Trains, and writes refiner, checkpoints, metrics and the resolved config to the job's folder. Returns the path of the refiner.
///
/// # Errors
/// See [`TrainError`].
pub fn train(
    job: &Job<CropRun>,
    config: &RefinerConfig,
    observer: &mut dyn Observer<RefinerTerms>,
) -> Result<PathBuf, TrainError> {
    let run = &job.run;
    let (session, source) = Session::open(job)?;
    let sampler =
        CropSampler { source, augmentation: run.augmentation.clone(), train: run.train.clone(), side: config.side };
    let (mut refiner, progress) = PartLearner::start(run, config, &session)?;
    let progress = session.teach(&mut refiner, progress, move |key| sampler.samples(key), observer)?;
    let path = job.out.join(REFINER_FILE);
    refiner.model(progress, session.frames).write(&path)?;
    Ok(path)
}

/// What a step of a refiner is judged by, beside its loss.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct RefinerTerms {
    /// Mean error of the logarithm of the depth.
    pub depth_error: f64,
    /// Share of cut-outs that are taken for another kind of thing.
    pub kind_error: f64,
}

impl Terms for RefinerTerms {
    const SAMPLES: &'static str = "cut-outs";

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

impl Pupil for PartLearner<'_, RefinerConfig> {
    type Sample = FrameCrops;
    type Terms = RefinerTerms;

    fn learner(&mut self) -> &mut Learner {
        &mut self.learner
    }

    fn rate(&self, step: u64, total: u64) -> f64 {
        self.run.train.rate(step, total)
    }

    fn name(sample: &FrameCrops) -> &str {
        &sample.id
    }

    fn step(&mut self, samples: Vec<FrameCrops>, rate: f64) -> Result<Option<Lesson<RefinerTerms>>, NotFinite> {
        let device = self.learner.network.device();
        let Some(batch) = CropBatch::new(&samples, self.config.side, device) else { return Ok(None) };
        let answer = self.answers(&batch.input);
        let places = PLACE_CHANNELS as i64;
        let place = answer.narrow(1, 0, places).index_select(0, &batch.objects);
        let kinds = answer.narrow(1, places, answer.size()[1] - places).index_select(0, &batch.known);
        let objective = place_loss(&place, &batch.targets) + kinds.cross_entropy_for_logits(&batch.kinds) * KIND_WEIGHT;
        let loss = objective.double_value(&[]);
        if !loss.is_finite() {
            return Err(NotFinite { what: "the loss".to_owned(), value: loss });
        }
        let gradient_norm = self.learner.descend(&objective, rate)?;
        let depth_error = (place.select(1, 0) - batch.targets.select(1, 0)).abs().mean(Kind::Float) * LOG_UNIT;
        let wrong = kinds.argmax(1, false).not_equal_tensor(&batch.kinds).to_kind(Kind::Float).mean(Kind::Float);
        let terms = RefinerTerms { depth_error: depth_error.double_value(&[]), kind_error: wrong.double_value(&[]) };
        Ok(Some(Lesson { loss, terms, gradient_norm, samples: batch.input.size()[0] as usize }))
    }
}

/// Mean over the objects of the places `answer` `[objects, 10]` against `targets` `[objects, 8]`.
///
/// Depth and sizes: the negative logarithm of the likelihood under Laplace's distribution, whose width the network says too. The apparent height, height over
/// depth, is judged once more by itself: it is what the picture shows, whatever the size.
fn place_loss(answer: &Tensor, targets: &Tensor) -> Tensor {
    let channels = |tensor: &Tensor, first: i64, count: i64| tensor.narrow(1, first, count);
    let off = |first: i64, count: i64| channels(answer, first, count) - channels(targets, first, count);
    let logs = |first: i64, count: i64| off(first, count).abs() * (LOG_UNIT / ERROR_UNIT);
    let likelihood = |errors: Tensor, channel: i64| {
        let width = channels(answer, channel, 1).clamp(-LARGEST_ERROR_LOG, LARGEST_ERROR_LOG);
        (errors * (-&width).exp() + width).mean(Kind::Float)
    };
    let depth = likelihood(logs(0, 1), 8);
    let sizes = likelihood(logs(3, 3), 9);
    let apparent = (off(4, 1) - off(0, 1)).abs().mean(Kind::Float) * (LOG_UNIT / ERROR_UNIT);
    let center = off(1, 2).abs().mean(Kind::Float);
    let heading = off(6, 2).abs().mean(Kind::Float);
    depth + sizes * 2.0 + apparent * APPARENT_WEIGHT + center * CENTER_WEIGHT + heading * HEADING_WEIGHT
}

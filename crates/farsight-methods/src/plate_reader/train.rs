//! Training of a plate reader.

use std::path::PathBuf;

use crate::plate_reader::geometry::EXPECTED_WIDTH;
use crate::refiner::geometry::{ERROR_UNIT, LARGEST_ERROR_LOG, LOG_UNIT};
use crate::plate_reader::PlateConfig;
use farsight_data::annotations::Plates;
use serde::Serialize;
use tch::{Kind, Tensor};

use super::samples::{FramePlates, PlateBatch, PlateSampler};
use crate::crops::{CropRun, PartLearner};
use crate::learner::Learner;
use crate::metrics::{Lesson, Terms};
use crate::trainer::{Job, NotFinite, Observer, Pupil, Session, TrainError};

/// Name of the trained plate reader in a run's folder.
pub const PLATES_FILE: &str = "plates.safetensors";

/// Weight of where a plate is seen (ends and height, sides of the cut-out) beside the likelihood of its width.
const PLACE_WEIGHT: f64 = 10.0;

/// Trains, and writes plate reader, checkpoints, metrics and the resolved config to the job's folder. Returns the path of the plate reader.
///
/// # Errors
/// See [`TrainError`].
pub fn train(
    job: &Job<CropRun>,
    config: &PlateConfig,
    observer: &mut dyn Observer<PlateTerms>,
) -> Result<PathBuf, TrainError> {
    let run = &job.run;
    let (session, source) = Session::open(job)?;
    if !source.has::<Plates>() {
        return Err(TrainError::NoPlates);
    }
    let sampler =
        PlateSampler { source, augmentation: run.augmentation.clone(), train: run.train.clone(), side: config.side };
    let (mut reader, progress) = PartLearner::start(run, config, &session)?;
    let progress = session.teach(&mut reader, progress, move |key| sampler.samples(key), observer)?;
    let path = job.out.join(PLATES_FILE);
    reader.model(progress, session.frames).write(&path)?;
    Ok(path)
}

/// What a step of a plate reader is judged by, beside its loss.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct PlateTerms {
    /// Mean error of the logarithm of the width, seen plates and hidden ones.
    pub width_error: f64,
    /// Mean of how far off the reader thinks it is.
    pub told_error: f64,
}

impl Terms for PlateTerms {
    const SAMPLES: &'static str = "cut-outs";

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

impl Pupil for PartLearner<'_, PlateConfig> {
    type Sample = FramePlates;
    type Terms = PlateTerms;

    fn learner(&mut self) -> &mut Learner {
        &mut self.learner
    }

    fn rate(&self, step: u64, total: u64) -> f64 {
        self.run.train.rate(step, total)
    }

    fn name(sample: &FramePlates) -> &str {
        &sample.id
    }

    fn step(&mut self, samples: Vec<FramePlates>, rate: f64) -> Result<Option<Lesson<PlateTerms>>, NotFinite> {
        let device = self.learner.network.device();
        let Some(batch) = PlateBatch::new(&samples, self.config.side, device) else { return Ok(None) };
        let answer = self.answers(&batch.input);
        let [middle, down, wider, error_log] = [0, 1, 2, 3].map(|channel| answer.select(1, channel));
        let error_log = error_log.clamp(-LARGEST_ERROR_LOG, LARGEST_ERROR_LOG);
        let off = (&wider - &batch.wider).abs();
        // The negative logarithm of the likelihood under Laplace's distribution, whose width the network says too.
        let likelihood = (&off * (LOG_UNIT / ERROR_UNIT) * (-&error_log).exp() + &error_log).mean(Kind::Float);
        let half_width = (wider * LOG_UNIT).exp() * (EXPECTED_WIDTH / 2.0);
        let place = Tensor::stack(&[&middle - &half_width, &middle + &half_width, down], 1);
        let objective = likelihood + place_error(&place, &batch.places) * PLACE_WEIGHT;
        let loss = objective.double_value(&[]);
        if !loss.is_finite() {
            return Err(NotFinite { what: "the loss".to_owned(), value: loss });
        }
        let gradient_norm = self.learner.descend(&objective, rate)?;
        let terms = PlateTerms {
            width_error: LOG_UNIT * off.mean(Kind::Float).double_value(&[]),
            told_error: ERROR_UNIT * error_log.exp().mean(Kind::Float).double_value(&[]),
        };
        Ok(Some(Lesson { loss, terms, gradient_norm, samples: batch.input.size()[0] as usize }))
    }
}

/// Mean over the cut-outs of how far off the places `[cut-outs, 3]` are, where they are known.
fn place_error(found: &Tensor, known: &Tensor) -> Tensor {
    // What is no number would stay none when it is weighted by 0.
    let off = (found - known.nan_to_num(0.0, None, None)).abs();
    let is_known = known.isnan().logical_not();
    (off * is_known.to_kind(Kind::Float)).sum(Kind::Float) / (found.size()[0] as f64)
}

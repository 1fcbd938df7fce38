//! The training loop of a refiner.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use farsight_core::refine::{ERROR_UNIT, LARGEST_ERROR_LOG, LOG_UNIT, PLACE_CHANNELS};
use farsight_data::kitti::dataset::DatasetError;
use farsight_data::{Batch, Loader, LoaderConfig};
use farsight_files::write_atomically;
use farsight_net::graph::NodeId;
use farsight_net::onnx::key;
use farsight_net::refiner::{ANSWER, RefinerModel};
use serde::Serialize;
use tch::{Device, Kind, Tensor};

use super::RefinerRun;
use super::samples::{CropBatch, CropSampler, FrameCrops};
use crate::checkpoint::Progress;
use crate::executor::{ExecutorError, Mode};
use crate::learner::Learner;
use crate::trainer::{Beginning, CHECKPOINT_FILE, CONFIG_FILE, TrainError, following, metrics, prepare_folder, source};

/// Name of the trained refiner in a run's folder.
pub const REFINER_FILE: &str = "refiner.safetensors";

/// Weights of the parts of the loss beside the logarithms' likelihood: apparent height (in [`ERROR_UNIT`]), centre (sides), heading, kind.
const APPARENT_WEIGHT: f64 = 1.0;
const CENTER_WEIGHT: f64 = 30.0;
const HEADING_WEIGHT: f64 = 3.0;
const KIND_WEIGHT: f64 = 2.0;

/// A run about to happen.
#[derive(Debug)]
pub struct RefinerJob {
    /// What and how.
    pub run: RefinerRun,
    /// Folder of checkpoints, metrics and the refiner.
    pub out: PathBuf,
    /// Whether to go on with the run that is there.
    pub resume: bool,
}

/// Numbers of some steps.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RefinerRecord {
    /// Optimiser steps done.
    pub step: u64,
    /// Mean of the loss since the record before.
    pub loss: f64,
    /// Mean error of the logarithm of the depth, likewise.
    pub depth_error: f64,
    /// Share of cut-outs that were taken for another kind of thing, likewise.
    pub kind_error: f64,
    /// Learning rate of the step.
    pub learning_rate: f64,
    /// Cut-outs a second since the record before.
    pub samples_per_second: f64,
}

/// Told how a run goes.
pub trait RefinerObserver {
    /// The run starts, or goes on.
    fn begin(&mut self, beginning: Beginning);
    /// So many steps are done; the numbers are means over some of them.
    fn record(&mut self, record: &RefinerRecord);
}

/// Trains, and writes refiner, checkpoints, metrics and the resolved config to the job's folder. Returns the path of the refiner.
///
/// # Errors
/// See [`TrainError`].
pub fn train(job: &RefinerJob, observer: &mut dyn RefinerObserver) -> Result<PathBuf, TrainError> {
    let RefinerJob { run, out, resume } = job;
    let settings = &run.train;
    crate::set_threads((settings.threads > 0).then_some(settings.threads));
    let source = source(&run.data, settings.seed)?;
    let frames = if run.data.limit == 0 { source.len() } else { run.data.limit.min(source.len()) };
    prepare_folder(out, *resume)?;
    let checkpoint_path = out.join(CHECKPOINT_FILE);
    let (mut trainer, mut progress) = Trainer::start(job, Device::cuda_if_available())?;
    let resolved = toml::to_string(run)?;
    write_atomically(&out.join(CONFIG_FILE), |file| file.write_all(resolved.as_bytes()))?;
    let loader = loader(run, source, frames, progress)?;
    let batches = loader.batches_per_epoch();
    let total = batches * settings.epochs;
    let mut metrics = metrics(out, progress.steps)?;
    observer.begin(Beginning { done: progress.steps, total, taken: trainer.learner.taken });
    let mut window = Window::new();
    for batch in loader {
        let Batch { position, items } = batch.map_err(|source| TrainError::Sample { step: progress.steps, source })?;
        let rate = settings.rate(progress.steps, total);
        if let Some(batch) = CropBatch::new(&items, run.refiner.side, trainer.learner.network.device()) {
            let step = trainer.step(&batch, rate).map_err(|(what, value)| {
                let frames = items.iter().map(|frame| frame.id.clone()).collect();
                TrainError::NotFinite { step: progress.steps, what, value, frames }
            })?;
            window.add(&step);
        } else {
            trainer.learner.rest();
        }
        progress = Progress { steps: progress.steps + 1, position: following(position, batches) };
        let is_last = progress.steps == total;
        if progress.steps % settings.log_steps == 0 || is_last {
            let record = window.finish(progress.steps, rate);
            let write_error = |source| TrainError::Write { path: out.clone(), source };
            metrics.write(record.step, &record, record.scalars()).map_err(write_error)?;
            observer.record(&record);
        }
        if progress.steps % settings.checkpoint_steps == 0 || is_last {
            trainer.learner.write(&checkpoint_path, progress, &run.identity())?;
        }
    }
    trainer.learner.settle();
    let path = out.join(REFINER_FILE);
    trainer.model(run, progress, frames).write(&path)?;
    Ok(path)
}

impl RefinerRecord {
    fn scalars(&self) -> [(String, f64); 5] {
        [
            ("loss/total", self.loss),
            ("loss/depth_error", self.depth_error),
            ("loss/kind_error", self.kind_error),
            ("train/learning_rate", self.learning_rate),
            ("train/samples_per_second", self.samples_per_second),
        ]
        .map(|(name, value)| (name.to_owned(), value))
    }
}

fn loader(
    run: &RefinerRun,
    source: Box<dyn crate::sources::FrameSource>,
    frames: usize,
    progress: Progress,
) -> Result<Loader<FrameCrops, DatasetError>, TrainError> {
    let config = LoaderConfig {
        items: frames,
        batch_size: run.train.frames_per_step.min(frames),
        seed: run.train.seed,
        shuffle: true,
        drop_last: true,
        workers: run.data.workers,
        prefetch: run.data.prefetch,
        start: progress.position,
        epochs: Some(run.train.epochs),
    };
    let (augmentation, train) = (run.augmentation.clone(), run.train.clone());
    let sampler = Arc::new(CropSampler { source, augmentation, train, side: run.refiner.side });
    Ok(Loader::new(&config, move |key| sampler.samples(key))?)
}

/// A refiner that learns, and where its answer stands.
struct Trainer {
    learner: Learner,
    answer: NodeId,
}

/// What a step was like.
struct Step {
    loss: f64,
    depth_error: f64,
    kind_error: f64,
    samples: usize,
}

impl Trainer {
    /// Fresh, or from the checkpoint when the job resumes and there is one.
    fn start(job: &RefinerJob, device: Device) -> Result<(Self, Progress), TrainError> {
        let run = &job.run;
        let graph = run.refiner.graph();
        let answer = graph.tap(ANSWER).ok_or_else(|| ExecutorError::Missing(ANSWER.to_owned()))?;
        let path = job.out.join(CHECKPOINT_FILE);
        let checkpoint = (job.resume && path.exists()).then_some(path.as_path());
        let (learner, progress) = Learner::start(graph, &run.train.learner(), checkpoint, &run.identity(), device)?;
        Ok((Self { learner, answer }, progress))
    }

    /// One step of the optimiser; what is not finite, and what it is instead, when it cannot be taken.
    fn step(&mut self, batch: &CropBatch, rate: f64) -> Result<Step, (String, f64)> {
        let answer = self.learner.network.forward(&batch.input, Mode::Train, &[self.answer]).remove(0).flatten(1, 3);
        let places = PLACE_CHANNELS as i64;
        let place = answer.narrow(1, 0, places).index_select(0, &batch.objects);
        let kinds = answer.narrow(1, places, answer.size()[1] - places).index_select(0, &batch.known);
        let loss = place_loss(&place, &batch.targets) + kinds.cross_entropy_for_logits(&batch.kinds) * KIND_WEIGHT;
        let value = loss.double_value(&[]);
        if !value.is_finite() {
            return Err(("the loss".to_owned(), value));
        }
        self.learner.descend(&loss, rate).map_err(|bad| (bad.what(), bad.norm))?;
        let depth_error = (place.select(1, 0) - batch.targets.select(1, 0)).abs().mean(Kind::Float) * LOG_UNIT;
        let wrong = kinds.argmax(1, false).not_equal_tensor(&batch.kinds).to_kind(Kind::Float).mean(Kind::Float);
        Ok(Step {
            loss: value,
            depth_error: depth_error.double_value(&[]),
            kind_error: wrong.double_value(&[]),
            samples: batch.input.size()[0] as usize,
        })
    }

    fn model(&self, run: &RefinerRun, progress: Progress, frames: usize) -> RefinerModel {
        let mut weights = self.learner.network.weights();
        let facts = serde_json::json!({ "steps": progress.steps, "epochs": run.train.epochs, "seed": run.train.seed, "frames": frames });
        weights.metadata.insert(key::TRAINING.to_owned(), facts.to_string());
        RefinerModel { config: run.refiner.clone(), weights }
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

/// Sums since the last record.
struct Window {
    started: Instant,
    steps: usize,
    sums: Step,
}

impl Window {
    fn new() -> Self {
        Self {
            started: Instant::now(),
            steps: 0,
            sums: Step { loss: 0.0, depth_error: 0.0, kind_error: 0.0, samples: 0 },
        }
    }

    fn add(&mut self, step: &Step) {
        self.steps += 1;
        self.sums.loss += step.loss;
        self.sums.depth_error += step.depth_error;
        self.sums.kind_error += step.kind_error;
        self.sums.samples += step.samples;
    }

    /// The means, and a new window.
    fn finish(&mut self, step: u64, learning_rate: f64) -> RefinerRecord {
        let Self { started, steps, sums } = std::mem::replace(self, Self::new());
        let count = steps.max(1) as f64;
        RefinerRecord {
            step,
            loss: sums.loss / count,
            depth_error: sums.depth_error / count,
            kind_error: sums.kind_error / count,
            learning_rate,
            samples_per_second: sums.samples as f64 / started.elapsed().as_secs_f64(),
        }
    }
}

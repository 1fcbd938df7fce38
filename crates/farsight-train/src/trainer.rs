//! The training loop.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use farsight_core::Codec;
use farsight_data::kitti::dataset::DatasetError;
use farsight_data::loader::{ItemError, LoaderError};
use farsight_data::{Batch, KittiDataset, Loader, LoaderConfig, Position};
use farsight_files::{DurableError, write_atomically};
use farsight_net::build::{network, with_surface_head};
use farsight_net::graph::{FEATURES, Graph, LOGITS, NodeId, REGRESSION, SURFACE};
use farsight_net::model::{Model, ModelError};
use farsight_net::onnx::key;
use farsight_net::refiner::RefinerError;
use farsight_net::weights::{Weights, WeightsError};
use farsight_synth::SceneStream;
use tch::{Device, no_grad};
use thiserror::Error;

use crate::checkpoint::{CheckpointError, Progress};
use crate::config::{DataConfig, RunConfig};
use crate::executor::{ExecutorError, Mode};
use crate::learner::Learner;
use crate::loss::{CORNER_DIVISOR_PER_IMAGE, CornerWeights, LossTerms, loss, surface_loss};
use crate::metrics::{MetricsWriter, Record};
use crate::samples::{Sampler, TrainBatch, TrainSample};
use crate::sources::{FrameSource, KittiSource, RenderedSource};

pub use crate::learner::Taken;

/// Name of the checkpoint in a run's folder.
pub const CHECKPOINT_FILE: &str = "checkpoint.safetensors";

/// Name of the trained model in a run's folder.
pub const MODEL_FILE: &str = "model.safetensors";

/// Name of the resolved config in a run's folder.
pub const CONFIG_FILE: &str = "config.toml";

/// Why a training ended before its time.
#[derive(Debug, Error)]
pub enum TrainError {
    /// No data was named.
    #[error("no data; expected --data DIR, or data.root or [data.rendered] in the config")]
    NoData,
    /// The data could not be opened.
    #[error(transparent)]
    Data(#[from] DatasetError),
    /// The loader could not start.
    #[error(transparent)]
    Loader(#[from] LoaderError),
    /// A sample could not be prepared.
    #[error("step {step}: {source}")]
    Sample {
        /// The step that needed it.
        step: u64,
        /// Why.
        source: ItemError<DatasetError>,
    },
    /// The split has no frames.
    #[error("split {} has no frames; expected at least one", .0.display())]
    NoFrames(PathBuf),
    /// The start weights could not be read.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// The start weights are those of another network.
    #[error("{}: train.start_from: none of its tensors has a place in the network; expected weights of the same kind of network", .0.display())]
    NothingFits(PathBuf),
    /// The weights do not fit the network.
    #[error(transparent)]
    Network(#[from] ExecutorError),
    /// The model could not be written.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The refiner could not be written.
    #[error(transparent)]
    Refiner(#[from] RefinerError),
    /// The checkpoint could not be read or written.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// A file of the run could not be written.
    #[error("{}: {source}", path.display())]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// The system's answer.
        source: io::Error,
    },
    /// A file of the run could not be written whole.
    #[error(transparent)]
    Durable(#[from] DurableError),
    /// The config cannot be written as TOML.
    #[error("the resolved config: {0}")]
    Config(#[from] toml::ser::Error),
    /// There is a run in the folder already.
    #[error("{}: there is a run here already; use --resume to go on with it, or another --out", .0.display())]
    Occupied(PathBuf),
    /// A number is not finite. The last checkpoint is older than this and intact.
    #[error(
        "step {step}: {what} is {value}; the batch was {frames:?}. The last checkpoint is from before this step and intact"
    )]
    NotFinite {
        /// The step.
        step: u64,
        /// The loss term or the gradient.
        what: String,
        /// What it is.
        value: f64,
        /// Names of the frames in the batch.
        frames: Vec<String>,
    },
}

/// Where a run starts, or goes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Beginning {
    /// Steps that are done.
    pub done: u64,
    /// Steps in all.
    pub total: u64,
    /// How much came from `train.start_from`; none of a run without, and of one that goes on.
    pub taken: Option<Taken>,
}

/// Told how a run goes.
pub trait Observer {
    /// The run starts, or goes on.
    fn begin(&mut self, beginning: Beginning);
    /// A step is done; the numbers are its own.
    fn step(&mut self, record: &Record);
}

/// A run about to happen.
#[derive(Debug)]
pub struct Job {
    /// What and how.
    pub run: RunConfig,
    /// Folder of checkpoints, metrics and the model.
    pub out: PathBuf,
    /// Whether to go on with the run that is there.
    pub resume: bool,
}

/// Trains, and writes model, checkpoints, metrics and the resolved config to the job's folder. Returns the path of the model.
///
/// # Errors
/// See [`TrainError`].
pub fn train(job: &Job, observer: &mut dyn Observer) -> Result<PathBuf, TrainError> {
    let device = Device::cuda_if_available();
    crate::set_threads((job.run.train.threads > 0).then_some(job.run.train.threads));
    let sampler = sampler(&job.run)?;
    let frames = match job.run.data.limit {
        0 => sampler.len(),
        limit => limit.min(sampler.len()),
    };
    let checkpoint_path = job.out.join(CHECKPOINT_FILE);
    prepare_folder(&job.out, job.resume)?;
    let (mut trainer, progress) = Trainer::start(job, &checkpoint_path, device)?;
    let resolved = toml::to_string(&job.run)?;
    write_atomically(&job.out.join(CONFIG_FILE), |file| file.write_all(resolved.as_bytes()))?;
    let (sampler, epochs) = (Arc::new(sampler), job.run.train.epochs);
    let loader = loader(&job.run, &sampler, frames, progress.position, Some(epochs))?;
    let batches_per_epoch = loader.batches_per_epoch();
    let total = batches_per_epoch * epochs;
    let mut metrics = metrics(&job.out, progress.steps)?;
    observer.begin(Beginning { done: progress.steps, total, taken: trainer.learner.taken });

    let mut progress = progress;
    let mut window = Window::new();
    for batch in loader {
        let Batch { position, items } = batch.map_err(|source| TrainError::Sample { step: progress.steps, source })?;
        let mut batch = TrainBatch::new(items, job.run.model.input, device);
        batch.targets = batch.targets.with_neighbours(job.run.train.neighbour_cells);
        let record = trainer.step(&batch, progress.steps, position.epoch, total)?;
        progress = Progress { steps: progress.steps + 1, position: following(position, batches_per_epoch) };
        let record = window.add(record, batch.ids.len());
        observer.step(&record);
        if progress.steps % job.run.train.log_steps == 0 || progress.steps == total {
            let write_error = |source| TrainError::Write { path: job.out.clone(), source };
            let record = window.finish(record);
            metrics.write(record.step, &record, record.scalars()).map_err(write_error)?;
        }
        if progress.steps % job.run.train.checkpoint_steps == 0 || progress.steps == total {
            trainer.learner.write(&checkpoint_path, progress, &job.run.identity())?;
        }
    }
    trainer.learner.settle();
    if let Some(batches) = job.run.train.statistics_batches {
        let after = Position { epoch: epochs, batch: 0 };
        trainer.gather_statistics(self::loader(&job.run, &sampler, frames, after, None)?.take(batches as usize))?;
    }
    let path = job.out.join(MODEL_FILE);
    trainer.model(progress, frames)?.write(&path)?;
    Ok(path)
}

fn sampler(run: &RunConfig) -> Result<Sampler, TrainError> {
    Ok(Sampler::new(source(&run.data, run.train.seed)?, &run.model, run.augmentation.clone()))
}

/// The frames that `data` names; rendered ones from this seed.
pub(crate) fn source(data: &DataConfig, seed: u64) -> Result<Box<dyn FrameSource>, TrainError> {
    let source: Box<dyn FrameSource> = match (&data.rendered, &data.root) {
        (Some(rendered), _) => {
            let stream = SceneStream { world: rendered.world.clone(), seed };
            Box::new(RenderedSource::new(stream, rendered.frames_per_epoch))
        }
        (None, Some(root)) => Box::new(KittiSource::new(KittiDataset::open(root, Some(&data.split))?, data.cache)),
        (None, None) => return Err(TrainError::NoData),
    };
    if source.is_empty() { Err(TrainError::NoFrames(data.split.clone())) } else { Ok(source) }
}

/// Makes the folder of a run, which must not hold another one.
pub(crate) fn prepare_folder(out: &Path, resume: bool) -> Result<(), TrainError> {
    fs::create_dir_all(out).map_err(|source| TrainError::Write { path: out.into(), source })?;
    if !resume && out.join(CHECKPOINT_FILE).exists() {
        return Err(TrainError::Occupied(out.into()));
    }
    Ok(())
}

pub(crate) fn metrics(out: &Path, steps: u64) -> Result<MetricsWriter, TrainError> {
    MetricsWriter::open(out, steps).map_err(|source| TrainError::Write { path: out.into(), source })
}

type TrainLoader = Loader<TrainSample, DatasetError>;

type TrainItems = Result<Batch<TrainSample>, ItemError<DatasetError>>;

fn loader(
    run: &RunConfig,
    sampler: &Arc<Sampler>,
    frames: usize,
    start: Position,
    epochs: Option<u64>,
) -> Result<TrainLoader, LoaderError> {
    let batch_size = run.train.batch_size.min(frames);
    let config = LoaderConfig {
        items: frames,
        batch_size,
        seed: run.train.seed,
        shuffle: true,
        drop_last: true,
        workers: run.data.workers,
        prefetch: run.data.prefetch,
        start,
        epochs,
    };
    let sampler = Arc::clone(sampler);
    Loader::new(&config, move |key| sampler.sample(key))
}

/// The batch after the one at `position`.
pub(crate) fn following(position: Position, batches_per_epoch: u64) -> Position {
    if position.batch + 1 < batches_per_epoch {
        Position { batch: position.batch + 1, ..position }
    } else {
        Position { epoch: position.epoch + 1, batch: 0 }
    }
}

/// Network, optimiser and what they need to take a step.
struct Trainer<'a> {
    job: &'a Job,
    learner: Learner,
    /// Logits, regression and, where it is taught, the surface.
    outputs: Vec<NodeId>,
    is_narrowed: bool,
    codec: Codec,
}

impl<'a> Trainer<'a> {
    /// Fresh, or from the checkpoint when the job resumes and there is one.
    fn start(job: &'a Job, checkpoint_path: &Path, device: Device) -> Result<(Self, Progress), TrainError> {
        let run = &job.run;
        let graph = start_graph(run)?;
        let is_narrowed = graph != network(&run.model);
        let missing = |name: &str| ExecutorError::Missing(name.to_owned());
        let graph = if run.train.surface_weight > 0.0 {
            with_surface_head(graph, run.model.norm).ok_or_else(|| missing(FEATURES))?
        } else {
            graph
        };
        let output = |name: &str| graph.tap(name).ok_or_else(|| missing(name));
        let mut outputs = vec![output(LOGITS)?, output(REGRESSION)?];
        outputs.extend(graph.tap(SURFACE));
        let checkpoint = (job.resume && checkpoint_path.exists()).then_some(checkpoint_path);
        let (learner, progress) = Learner::start(graph, &run.train.learner(), checkpoint, &run.identity(), device)?;
        Ok((Self { job, learner, outputs, is_narrowed, codec: run.model.codec() }, progress))
    }

    /// One step of the optimiser on `batch`, the `step`-th of `total`.
    fn step(&mut self, batch: &TrainBatch, step: u64, epoch: u64, total: u64) -> Result<Record, TrainError> {
        let config = &self.job.run.train;
        let maps = self.learner.network.forward(&batch.input, Mode::Train, &self.outputs);
        let full_weight_m = (config.full_weight_m > 0.0).then_some(config.full_weight_m);
        let divisor = CORNER_DIVISOR_PER_IMAGE * batch.ids.len() as f64;
        let weights = CornerWeights {
            divisor,
            full_weight_m,
            orientation: config.orientation_weight,
            dimensions: config.dimensions_weight,
            image: config.image_weight,
        };
        let (mut objective, mut terms) = loss(&self.codec, &maps[0], &maps[1], &batch.targets, weights);
        if let (Some(predicted), Some(surface_m)) = (maps.get(2), &batch.targets.surface_m) {
            let surface = surface_loss(predicted, surface_m, self.codec.depth.mean_m) * config.surface_weight;
            terms.surface = surface.double_value(&[]);
            objective += surface;
        }
        check_terms(&terms, step, batch)?;

        let learning_rate = config.learning_rate * config.schedule.factor(step, total, config.warm_up_steps);
        let descended = self.learner.descend(&objective, learning_rate);
        let gradient_norm = descended.map_err(|bad| not_finite(step, bad.what(), bad.norm, batch))?;
        let (loss, samples_per_second) = (terms.total(), 0.0);
        Ok(Record { step: step + 1, epoch, loss, terms, learning_rate, gradient_norm, samples_per_second })
    }

    /// Takes the statistics of batch norm anew, as means over `batches`: those gathered while learning are of the last dozens of steps only.
    fn gather_statistics(&self, batches: impl Iterator<Item = TrainItems>) -> Result<(), TrainError> {
        let network = &self.learner.network;
        let device = network.device();
        for (done, batch) in batches.enumerate() {
            let step = done as u64;
            let items = batch.map_err(|source| TrainError::Sample { step, source })?.items;
            let batch = TrainBatch::new(items, self.job.run.model.input, device);
            let mode = Mode::Gather { share: 1.0 / (step + 1) as f64 };
            no_grad(|| network.forward(&batch.input, mode, &self.outputs));
        }
        Ok(())
    }

    fn model(&self, progress: Progress, frames: usize) -> Result<Model, ModelError> {
        let run = &self.job.run;
        let mut weights = self.learner.network.weights();
        let facts = serde_json::json!({
            "steps": progress.steps,
            "epochs": run.train.epochs,
            "batch_size": run.train.batch_size,
            "seed": run.train.seed,
            "frames": frames,
            "data": if run.data.rendered.is_some() { "rendered scenes".into() } else { run.data.split.display().to_string() },
        });
        weights.metadata.insert(key::TRAINING.to_owned(), facts.to_string());
        if self.is_narrowed {
            Model::narrowed(run.model.clone(), weights)
        } else {
            Model::new(run.model.clone(), weights)
        }
    }
}

/// The network of the config, or the narrower one of the same kind that the run starts from.
fn start_graph(run: &RunConfig) -> Result<Graph, TrainError> {
    if let Some(path) = &run.train.start_from {
        let weights = Weights::read(path)?;
        if Model::marks_narrowed(&weights) {
            return Ok(Model::narrowed(run.model.clone(), weights)?.graph);
        }
    }
    Ok(network(&run.model))
}

fn check_terms(terms: &LossTerms, step: u64, batch: &TrainBatch) -> Result<(), TrainError> {
    match terms.named().into_iter().find(|(_, value)| !value.is_finite()) {
        Some((name, value)) => Err(not_finite(step, format!("loss term \"{name}\""), value, batch)),
        None => Ok(()),
    }
}

fn not_finite(step: u64, what: String, value: f64, batch: &TrainBatch) -> TrainError {
    TrainError::NotFinite { step, what, value, frames: batch.ids.clone() }
}

/// Means over the steps since the last record that was written.
struct Window {
    started: Instant,
    samples: usize,
    steps: usize,
    sums: LossTerms,
}

impl Window {
    fn new() -> Self {
        Self { started: Instant::now(), samples: 0, steps: 0, sums: LossTerms::ZERO }
    }

    /// Counts `record`, of a batch of `samples`, and gives it the speed so far.
    fn add(&mut self, record: Record, samples: usize) -> Record {
        self.samples += samples;
        self.steps += 1;
        self.sums = self.sums.zip_with(&record.terms, |sum, term| sum + term);
        Record { samples_per_second: self.samples as f64 / self.started.elapsed().as_secs_f64(), ..record }
    }

    /// `last` with the means of the window, and a new window.
    fn finish(&mut self, last: Record) -> Record {
        let count = self.steps.max(1) as f64;
        let terms = self.sums.zip_with(&LossTerms::ZERO, |sum, _| sum / count);
        *self = Self::new();
        Record { loss: terms.total(), terms, ..last }
    }
}

//! The training loop of detector, refiner and plate reader: data in order, steps, metrics, checkpoints, going on where a run was killed.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use farsight_data::loader::{ItemError, LoaderError};
use farsight_data::{
    Batch, CachedDataset, Dataset, DatasetError, ItemKey, Loader, LoaderConfig, Position, open_labelled,
};
use farsight_files::{DurableError, write_atomically};
use farsight_graph::graph::Graph;
use farsight_graph::model::ModelError;
use farsight_graph::model::ModelError;
use farsight_graph::weights::WeightsError;
use farsight_synth::{SceneDataset, SceneStream};
use serde::Serialize;
use tch::Device;
use thiserror::Error;

use crate::adam::BadGradient;
use crate::checkpoint::{CheckpointError, Progress};
use crate::config::DataConfig;
use crate::executor::ExecutorError;
use crate::learner::{Learner, LearnerSettings};
use crate::metrics::{Lesson, MetricsWriter, Record, Terms, Window};

pub use crate::learner::Taken;

/// Name of the checkpoint in a run's folder.
pub const CHECKPOINT_FILE: &str = "checkpoint.safetensors";

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
    /// The data set does not list the number plates that its images show.
    #[error(
        "no plates in the data set; expected data that `farsight synth` rendered, which a plate reader learns from"
    )]
    NoPlates,
    /// The start weights could not be read.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// The start weights are those of another network.
    #[error("{}: train.start_from: none of its tensors has a place in the network; expected weights of the same kind of network", .0.display())]
    NothingFits(PathBuf),
    /// The start weights lack a tensor that is not to start anew.
    #[error(
        "{}: tensor \"{name}\" {found}; expected shape {expected:?}, or the start of its name in train.start_without",
        path.display()
    )]
    StartTensor {
        /// The file.
        path: PathBuf,
        /// The tensor.
        name: String,
        /// What was found.
        found: String,
        /// Its shape in the network.
        expected: Vec<usize>,
    },
    /// A part of the network is named that it does not have.
    #[error("train.{field} names \"{prefix}\"; expected how the name of a tensor of the network starts")]
    Prefix {
        /// The field of the config.
        field: &'static str,
        /// What it names.
        prefix: String,
    },
    /// Every tensor is frozen.
    #[error("train.freeze names the whole network; expected something left to learn")]
    AllFrozen,
    /// The weights do not fit the network.
    #[error(transparent)]
    Network(#[from] ExecutorError),
    /// The model could not be written.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The refiner or plate reader could not be written.
    #[error(transparent)]
    Part(#[from] ModelError),
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

/// A run about to happen.
#[derive(Debug)]
pub struct Job<R> {
    /// What and how.
    pub run: R,
    /// Folder of checkpoints, metrics and what was trained.
    pub out: PathBuf,
    /// Whether to go on with the run that is there.
    pub resume: bool,
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
pub trait Observer<T> {
    /// The run starts, or goes on.
    fn begin(&mut self, beginning: Beginning);
    /// A step is done; the numbers are its own.
    fn step(&mut self, record: &Record<T>);
}

/// A config as the loop sees it.
pub trait Run: Serialize {
    /// Where the frames come from.
    fn data(&self) -> &DataConfig;
    /// How the run goes through them.
    fn pace(&self) -> Pace;
    /// How the network starts and learns.
    fn learner(&self) -> LearnerSettings;
    /// The run without what does not change its steps.
    fn identity(&self) -> Self;
}

/// How a run goes through its frames.
#[derive(Debug, Clone, Copy)]
pub struct Pace {
    pub epochs: u64,
    /// Frames a step.
    pub batch_size: usize,
    /// Seed of the order of the frames, and of rendered ones.
    pub seed: u64,
    pub log_steps: u64,
    pub checkpoint_steps: u64,
    /// Threads of libtorch; 0 for its own choice.
    pub threads: usize,
}

/// A kind of network that can be taught.
pub trait Pupil {
    /// What is prepared of a frame.
    type Sample: Send + 'static;
    /// What a step is judged by.
    type Terms: Terms;

    fn learner(&mut self) -> &mut Learner;

    /// The learning rate of a step, of so many in all.
    fn rate(&self, step: u64, total: u64) -> f64;

    /// Name of the frame.
    fn name(sample: &Self::Sample) -> &str;

    /// One step of the optimiser; none when there is nothing to learn from these samples.
    fn step(&mut self, samples: Vec<Self::Sample>, rate: f64) -> Result<Option<Lesson<Self::Terms>>, NotFinite>;
}

/// A number that is not finite.
#[derive(Debug)]
pub struct NotFinite {
    /// The loss term or the gradient.
    pub what: String,
    pub value: f64,
}

impl From<BadGradient> for NotFinite {
    fn from(bad: BadGradient) -> Self {
        Self { what: bad.what(), value: bad.norm }
    }
}

/// A job whose data are open and whose folder is there.
#[derive(Debug)]
pub struct Session<'a, R> {
    job: &'a Job<R>,
    pace: Pace,
    /// Frames in an epoch.
    pub frames: usize,
}

impl<'a, R: Run> Session<'a, R> {
    /// Opens the data, which are returned too, and makes the folder.
    pub fn open(job: &'a Job<R>) -> Result<(Self, Arc<dyn Dataset>), TrainError> {
        let (data, pace) = (job.run.data(), job.run.pace());
        crate::set_threads((pace.threads > 0).then_some(pace.threads));
        let source = dataset(data, pace.seed)?;
        let frames = if data.limit == 0 { source.len() } else { data.limit.min(source.len()) };
        prepare_folder(&job.out, job.resume)?;
        Ok((Self { job, pace, frames }, source))
    }

    fn checkpoint_path(&self) -> PathBuf {
        self.job.out.join(CHECKPOINT_FILE)
    }

    /// A network that learns: fresh, or from the checkpoint when the job resumes and there is one.
    pub fn learner(&self, graph: Graph) -> Result<(Learner, Progress), TrainError> {
        let path = self.checkpoint_path();
        let checkpoint = (self.job.resume && path.exists()).then_some(path.as_path());
        let run = &self.job.run;
        Learner::start(graph, &run.learner(), checkpoint, &run.identity(), Device::cuda_if_available())
    }

    /// Batches of what `sample` makes of the frames.
    pub fn loader<S: Send + 'static>(
        &self,
        start: Position,
        epochs: Option<u64>,
        sample: impl Fn(ItemKey) -> Result<S, DatasetError> + Send + Sync + 'static,
    ) -> Result<Loader<S, DatasetError>, LoaderError> {
        let DataConfig { workers, prefetch, .. } = *self.job.run.data();
        let config = LoaderConfig {
            items: self.frames,
            batch_size: self.pace.batch_size.min(self.frames),
            seed: self.pace.seed,
            shuffle: true,
            drop_last: true,
            workers,
            prefetch,
            start,
            epochs,
        };
        Loader::new(&config, sample)
    }

    /// Teaches `pupil` what is left of the run after `progress`, and writes checkpoints, metrics and the resolved config. In the end the network has the
    /// weights that the run is for.
    pub fn teach<P: Pupil>(
        &self,
        pupil: &mut P,
        mut progress: Progress,
        sample: impl Fn(ItemKey) -> Result<P::Sample, DatasetError> + Send + Sync + 'static,
        observer: &mut dyn Observer<P::Terms>,
    ) -> Result<Progress, TrainError> {
        let Job { run, out, .. } = self.job;
        let write_error = |source| TrainError::Write { path: out.clone(), source };
        let resolved = toml::to_string(run)?;
        write_atomically(&out.join(CONFIG_FILE), |file| file.write_all(resolved.as_bytes()))?;
        let loader = self.loader(progress.position, Some(self.pace.epochs), sample)?;
        let batches = loader.batches_per_epoch();
        let total = batches * self.pace.epochs;
        let mut metrics = MetricsWriter::open(out, progress.steps).map_err(write_error)?;
        observer.begin(Beginning { done: progress.steps, total, taken: pupil.learner().taken });

        let mut window = Window::new();
        for batch in loader {
            let Batch { position, items } =
                batch.map_err(|source| TrainError::Sample { step: progress.steps, source })?;
            let rate = pupil.rate(progress.steps, total);
            let lesson = step(pupil, items, progress.steps, rate)?;
            progress = Progress { steps: progress.steps + 1, position: following(position, batches) };
            if let Some(lesson) = &lesson {
                observer.step(&window.add(lesson, progress.steps, position.epoch, rate));
            }
            let is_due = |every: u64| progress.steps.is_multiple_of(every) || progress.steps == total;
            if is_due(self.pace.log_steps) {
                metrics.write(&window.finish(progress.steps, position.epoch, rate)).map_err(write_error)?;
            }
            if is_due(self.pace.checkpoint_steps) {
                pupil.learner().write(&self.checkpoint_path(), progress, &run.identity())?;
            }
        }
        pupil.learner().settle();
        Ok(progress)
    }
}

/// One step, which counts even when there is nothing to learn.
fn step<P: Pupil>(
    pupil: &mut P,
    samples: Vec<P::Sample>,
    step: u64,
    rate: f64,
) -> Result<Option<Lesson<P::Terms>>, TrainError> {
    let frames: Vec<String> = samples.iter().map(|sample| P::name(sample).to_owned()).collect();
    let lesson = pupil.step(samples, rate).map_err(|NotFinite { what, value }| TrainError::NotFinite {
        step,
        what,
        value,
        frames,
    })?;
    if lesson.is_none() {
        pupil.learner().rest();
    }
    Ok(lesson)
}

/// The frames that `data` names; rendered ones from this seed.
fn dataset(data: &DataConfig, seed: u64) -> Result<Arc<dyn Dataset>, TrainError> {
    let dataset: Arc<dyn Dataset> = match (&data.rendered, &data.root) {
        (Some(rendered), _) => {
            let stream = SceneStream { config: rendered.world.clone(), seed };
            Arc::new(SceneDataset::new(stream, rendered.frames_per_epoch))
        }
        (None, Some(root)) => open_labelled(root, Some(&data.split))?,
        (None, None) => return Err(TrainError::NoData),
    };
    if dataset.is_empty() {
        return Err(TrainError::NoFrames(data.split.clone()));
    }
    Ok(if data.cache { Arc::new(CachedDataset::new(dataset)) } else { dataset })
}

/// Makes the folder of a run, which must not hold another one.
fn prepare_folder(out: &Path, resume: bool) -> Result<(), TrainError> {
    fs::create_dir_all(out).map_err(|source| TrainError::Write { path: out.into(), source })?;
    if !resume && out.join(CHECKPOINT_FILE).exists() {
        return Err(TrainError::Occupied(out.into()));
    }
    Ok(())
}

/// The batch after the one at `position`.
fn following(position: Position, batches_per_epoch: u64) -> Position {
    if position.batch + 1 < batches_per_epoch {
        Position { batch: position.batch + 1, ..position }
    } else {
        Position { epoch: position.epoch + 1, batch: 0 }
    }
}

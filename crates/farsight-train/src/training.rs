//! The training loop, whatever the method: data in order, steps, metrics, checkpoints, validation, going on where a run
//! was killed.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use farsight_data::loader::LoaderError;
use farsight_data::{
    Batch, CachedDataset, Dataset, DatasetError, ItemKey, Loader, LoaderConfig, Position, open_labelled,
};
use farsight_files::{FolderLock, remove_stale_scratch, write_atomically};
use farsight_graph::graph::Graph;
use farsight_graph::model::{Model, ModelError};
use farsight_graph::weights::Weights;
use farsight_onnx::key;
use farsight_synth::{SceneDataset, SceneStream};
use tch::{Device, Tensor, no_grad};

use crate::checkpoint::{self, Progress};
use crate::config::{DataConfig, PrecisionChoice, RunConfig, ValidateConfig};
use crate::executor::{Mode, Precision, has_bf16};
use crate::fingerprint::Fingerprint;
use crate::learner::Learner;
use crate::metrics::{Metrics, MetricsWriter, Step, StepSummary, Window};
use crate::task::{RunOf, Sampler, StepOutput, Task};

pub use crate::error::TrainError;
pub use crate::parts::Loaded;

/// Name of the checkpoint in a run's folder.
pub const CHECKPOINT_FILE: &str = "checkpoint.safetensors";

/// Name of the model so far in a run's folder, while it is validated.
pub const VALIDATED_FILE: &str = "validated.safetensors";

/// Name of the resolved config in a run's folder.
pub const CONFIG_FILE: &str = "config.toml";

/// Steps that say how fast a precision is, and those before them, in which libraries make up their minds.
const TIMED_STEPS: usize = 3;
const WARM_STEPS: usize = 2;

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
pub struct Start {
    /// Steps that are done.
    pub done: u64,
    /// Steps in all.
    pub total: u64,
    /// How much came from `train.start_from`; none of a run without, and of one that goes on.
    pub loaded: Option<Loaded>,
    /// In which numbers it computes.
    pub precision: Precision,
    /// Whether the device only emulates these numbers, and is many times slower than in single precision.
    pub is_emulated: bool,
}

/// Told how a run goes, and asked to measure.
pub trait Callback {
    /// Part `number`, from 1, of `of` parts begins; a run that has none says nothing.
    fn on_part(&mut self, name: &str, number: usize, of: usize) {
        let _ = (name, number, of);
    }

    /// The run starts, or goes on.
    fn on_start(&mut self, start: Start);

    /// A run goes on with other data than it began with, as `differences` say: whether it may.
    fn accepts_other_data(&mut self, differences: &[String]) -> bool {
        let _ = differences;
        false
    }

    /// A step is done; the numbers are its own.
    fn on_step(&mut self, step: &StepSummary);

    /// Whether the run is to stop at a checkpoint now, with [`TrainError::Stopped`]; asked after every step but the
    /// last.
    fn stops(&mut self) -> bool {
        false
    }

    /// The model so far stands in the file `model`: what it is worth on the frames of `config`, by name. It belongs to
    /// so many steps.
    ///
    /// # Errors
    /// What kept it from being measured; the run ends.
    fn validate(&mut self, step: u64, model: &Path, config: &ValidateConfig) -> Result<Vec<(String, f64)>, String>;
}

/// Trains, and writes model, checkpoints, metrics and the resolved config to the job's folder. Returns the path of the
/// model.
///
/// # Errors
/// See [`TrainError`].
pub fn fit<T: Task>(job: &Job<RunOf<T>>, callback: &mut dyn Callback) -> Result<PathBuf, TrainError> {
    fit_on::<T>(job, dataset(&job.run.data, job.run.train.seed)?, callback)
}

/// [`fit`] on the frames of `source`, whatever the job's config says of data: those of a program, or in memory.
///
/// # Errors
/// See [`TrainError`].
pub fn fit_on<T: Task>(
    job: &Job<RunOf<T>>,
    source: Arc<dyn Dataset>,
    callback: &mut dyn Callback,
) -> Result<PathBuf, TrainError> {
    let Job { run, out, resume } = job;
    let train = &run.train;
    crate::set_threads((train.threads > 0).then_some(train.threads));
    if let Some(ValidateConfig { root, split, .. }) = &run.validate {
        // What cannot be measured on is told before the first step.
        open_labelled(root, Some(split))?;
    }
    if source.is_empty() {
        return Err(TrainError::NoFrames(source.name().into()));
    }
    let frames = if run.data.limit == 0 { source.len() } else { run.data.limit.min(source.len()) };
    let data = Fingerprint::of(&*source, frames)?;
    let sampler = Arc::new(T::sampler(run, source)?);
    let _lock = prepare_folder(out, *resume)?;
    check_data(&out.join(CHECKPOINT_FILE), *resume, &data, callback)?;
    let start = train.start_from.as_deref().map(Weights::read).transpose()?;
    let (task, graph) = T::new(run, start.as_ref())?;
    let asked = Trainer { job, task, frames, data, sampler };
    let precision = asked.precision(&graph)?;
    // From here on the run says what it computes in.
    let mut run = run.clone();
    run.train.precision = precision;
    let job = &Job { run, out: out.clone(), resume: *resume };
    let trainer = Trainer { job, ..asked };
    let (mut learner, progress) = trainer.learner(graph)?;
    let progress = trainer.run(&mut learner, progress, callback)?;
    if let Some(count) = job.run.train.statistics_batches {
        trainer.gather_statistics(&learner, count)?;
    }
    let path = out.join(T::MODEL_FILE);
    trainer.model(learner.weights(), progress)?.write(&path)?;
    Ok(path)
}

/// What the command line says about a run, beside its config.
#[derive(Debug, Clone, Default)]
pub struct FileOptions {
    /// Folder in KITTI's layout instead of the config's data.
    pub data: Option<PathBuf>,
    /// Folder of checkpoints, metrics and what was trained.
    pub out: PathBuf,
    /// Whether to go on with the run that is there.
    pub resume: bool,
}

/// [`fit`] for the config in the file `path`.
///
/// # Errors
/// See [`TrainError`].
pub fn fit_file<T: Task>(
    path: &Path,
    options: &FileOptions,
    callback: &mut dyn Callback,
) -> Result<PathBuf, TrainError> {
    let mut run: RunOf<T> = RunConfig::read(path)?;
    // What the command line names is what the user means now.
    if let Some(root) = &options.data {
        run.data.root = Some(root.clone());
        run.data.rendered = None;
    }
    let FileOptions { out, resume, .. } = options.clone();
    fit::<T>(&Job { run, out, resume }, callback)
}

/// A run whose data are open and whose folder is there.
struct Trainer<'a, T: Task> {
    job: &'a Job<RunOf<T>>,
    task: T,
    /// Frames in an epoch.
    frames: usize,
    /// What it learns from.
    data: Fingerprint,
    /// What makes the samples.
    sampler: Arc<Sampler<T::Sample>>,
}

impl<T: Task> Trainer<'_, T> {
    fn checkpoint_path(&self) -> PathBuf {
        self.job.out.join(CHECKPOINT_FILE)
    }

    /// A network that learns: fresh, or from the checkpoint when the job resumes and there is one.
    fn learner(&self, graph: Graph) -> Result<(Learner, Progress), TrainError> {
        let path = self.checkpoint_path();
        let checkpoint = (self.job.resume && path.exists()).then_some(path.as_path());
        let run = &self.job.run;
        let settings = run.train.learner(self.numbers());
        Learner::start(graph, &settings, checkpoint, &run.identity(), Device::cuda_if_available())
    }

    /// What the run computes in, once that is known.
    fn numbers(&self) -> Precision {
        self.job.run.train.precision.named().unwrap_or_default()
    }

    /// What the run is to compute in: as asked for, or as it did before, or as is fastest.
    fn precision(&self, graph: &Graph) -> Result<PrecisionChoice, TrainError> {
        let Job { run, out, resume } = self.job;
        let asked = run.train.precision;
        if asked != PrecisionChoice::Auto {
            return Ok(asked);
        }
        if *resume && self.checkpoint_path().exists() {
            let before: RunOf<T> = RunConfig::read(&out.join(CONFIG_FILE))?;
            if before.train.precision != PrecisionChoice::Auto {
                return Ok(before.train.precision);
            }
        }
        if !has_bf16(Device::cuda_if_available()) {
            return Ok(PrecisionChoice::F32);
        }
        let is_faster = self.step_time(graph, Precision::Bf16)? < self.step_time(graph, Precision::F32)?;
        Ok(if is_faster { PrecisionChoice::Bf16 } else { PrecisionChoice::F32 })
    }

    /// How long a step takes in these numbers, by the run's first batches; what they teach is forgotten.
    fn step_time(&self, graph: &Graph, precision: Precision) -> Result<Duration, TrainError> {
        let train = &self.job.run.train;
        let device = Device::cuda_if_available();
        let settings = train.learner(precision);
        let (mut learner, _) = Learner::start(graph.clone(), &settings, None, &self.job.run.identity(), device)?;
        let batches = self.loader(Position::default(), Some(train.epochs))?.take(WARM_STEPS + TIMED_STEPS);
        let mut times = Vec::new();
        for batch in batches {
            let items = batch.map_err(|source| TrainError::Sample { step: 0, source })?.items;
            let began = Instant::now();
            self.step(&mut learner, items, 0, train.rate(0, 1))?;
            times.push(began.elapsed());
        }
        times.drain(..WARM_STEPS.min(times.len().saturating_sub(1)));
        times.sort();
        Ok(times.get(times.len() / 2).copied().unwrap_or_default())
    }

    /// Batches of samples.
    fn loader(&self, start: Position, epochs: Option<u64>) -> Result<Loader<T::Sample, DatasetError>, LoaderError> {
        let RunConfig { data: DataConfig { workers, prefetch, rendered, .. }, train, .. } = &self.job.run;
        let config = LoaderConfig {
            items: self.frames,
            batch_size: train.batch_size.min(self.frames),
            seed: train.seed,
            // Views of a scene have their own order.
            shuffle: rendered.as_ref().is_none_or(|rendered| rendered.views == 1),
            drop_last: true,
            workers: *workers,
            prefetch: *prefetch,
            start,
            epochs,
        };
        let sampler = Arc::clone(&self.sampler);
        Loader::new(&config, move |key: ItemKey| sampler(key))
    }

    /// What is left of the run after `progress`: steps, checkpoints, metrics, validation. In the end the network has
    /// the weights that the run is for.
    fn run(
        &self,
        learner: &mut Learner,
        mut progress: Progress,
        callback: &mut dyn Callback,
    ) -> Result<Progress, TrainError> {
        let Job { run, out, .. } = self.job;
        let train = &run.train;
        let write_error = |source| TrainError::Write { path: out.clone(), source };
        let resolved = toml::to_string(run)?;
        write_atomically(&out.join(CONFIG_FILE), |file| file.write_all(resolved.as_bytes()))?;
        let loader = self.loader(progress.position, Some(train.epochs))?;
        let batches = loader.batches_per_epoch();
        let total = batches * train.epochs;
        let end = train.max_steps.map_or(total, |steps| steps.min(total));
        let mut metrics = MetricsWriter::open(out, progress.steps).map_err(write_error)?;
        let precision = self.numbers();
        let is_emulated = precision == Precision::Bf16 && !has_bf16(learner.network.device());
        callback.on_start(Start { done: progress.steps, total: end, loaded: learner.loaded, precision, is_emulated });

        let mut window = Window::new();
        for batch in loader.take(end.saturating_sub(progress.steps) as usize) {
            let Batch { position, items } =
                batch.map_err(|source| TrainError::Sample { step: progress.steps, source })?;
            let rate = train.rate(progress.steps, total);
            let step = self.step(learner, items, progress.steps, rate)?;
            progress = Progress { steps: progress.steps + 1, position: following(position, batches) };
            if let Some(step) = &step {
                callback.on_step(&window.add(step, progress.steps, position.epoch, rate).summary());
            }
            let is_due = |every: u64| progress.steps.is_multiple_of(every) || progress.steps == end;
            if is_due(train.log_steps) {
                metrics.write(&window.finish(progress.steps, position.epoch, rate)).map_err(write_error)?;
            }
            let stops = progress.steps < end && callback.stops();
            if stops || is_due(train.checkpoint_steps) {
                learner.write(&self.checkpoint_path(), progress, &run.identity(), &self.data)?;
            }
            if stops {
                return Err(TrainError::Stopped { step: progress.steps });
            }
            if let Some(config) = run.validate.as_ref().filter(|config| is_due(config.every_steps)) {
                let measured = self.validated(learner, progress, config, callback)?;
                metrics.write_validation(progress.steps, &measured).map_err(write_error)?;
            }
        }
        learner.use_averages();
        Ok(progress)
    }

    /// One step, which counts even when there is nothing to learn.
    fn step(
        &self,
        learner: &mut Learner,
        samples: Vec<T::Sample>,
        step: u64,
        rate: f64,
    ) -> Result<Option<Step<T::Metrics>>, TrainError> {
        let frames: Vec<String> = samples.iter().map(|sample| T::name(sample).to_owned()).collect();
        let not_finite = |what: String, value: f64| TrainError::NotFinite { step, what, value, frames: frames.clone() };
        let Some(batch) = self.task.batch(samples, learner.network.device()) else {
            learner.rest();
            return Ok(None);
        };
        let outputs = self.forward(learner, &batch, Mode::Train);
        let StepOutput { objective, loss, metrics, samples } = self.task.loss(&outputs, &batch);
        if let Some((name, value)) = metrics.named().into_iter().find(|(_, value)| !value.is_finite()) {
            return Err(not_finite(format!("loss term \"{name}\""), value));
        }
        if !loss.is_finite() {
            return Err(not_finite("the loss".to_owned(), loss));
        }
        let descended = learner.descend(&objective, rate);
        let gradient_norm = descended.map_err(|bad| not_finite(bad.what(), bad.norm))?;
        Ok(Some(Step { loss, metrics, gradient_norm, samples }))
    }

    /// What the model so far is worth.
    fn validated(
        &self,
        learner: &Learner,
        progress: Progress,
        config: &ValidateConfig,
        callback: &mut dyn Callback,
    ) -> Result<Vec<(String, f64)>, TrainError> {
        let path = self.job.out.join(VALIDATED_FILE);
        self.model(learner.final_weights(), progress)?.write(&path)?;
        callback.validate(progress.steps, &path, config).map_err(TrainError::Validate)
    }

    /// Takes the statistics of batch norm anew, as means over so many batches after the last: those gathered while
    /// learning are of the last dozens of steps only.
    fn gather_statistics(&self, learner: &Learner, count: u64) -> Result<(), TrainError> {
        let after = Position { epoch: self.job.run.train.epochs, batch: 0 };
        let mut gathered = 0;
        for (place, batch) in self.loader(after, None)?.take(count as usize).enumerate() {
            let step = place as u64;
            let items = batch.map_err(|source| TrainError::Sample { step, source })?.items;
            let Some(batch) = self.task.batch(items, learner.network.device()) else { continue };
            gathered += 1;
            let mode = Mode::Gather { share: 1.0 / f64::from(gathered) };
            no_grad(|| self.forward(learner, &batch, mode));
        }
        Ok(())
    }

    /// What the network says of a batch, where the loss reads it.
    fn forward(&self, learner: &Learner, batch: &T::Batch, mode: Mode) -> Vec<Tensor> {
        let (input, sampler) = (T::input(batch), |place, maps: &[Tensor]| self.task.sampled(place, maps, batch));
        learner.network.forward_through(std::slice::from_ref(input), &sampler, mode, self.task.outputs())
    }

    /// The model with these weights, and what is known of its training.
    fn model(&self, mut weights: Weights, progress: Progress) -> Result<Model<T::Model>, ModelError> {
        let RunConfig { train, data, .. } = &self.job.run;
        let facts = serde_json::json!({
            "steps": progress.steps,
            "epochs": train.epochs,
            "batch_size": train.batch_size,
            "seed": train.seed,
            "frames": self.frames,
            "data": if data.rendered.is_some() { "rendered scenes".into() } else { data.split.display().to_string() },
        });
        weights.metadata.insert(key::TRAINING.to_owned(), facts.to_string());
        self.task.model(&self.job.run, weights)
    }
}

/// The frames that `data` names; rendered ones from this seed.
fn dataset(data: &DataConfig, seed: u64) -> Result<Arc<dyn Dataset>, TrainError> {
    let dataset: Arc<dyn Dataset> = match (&data.rendered, &data.root) {
        (Some(rendered), _) => {
            let stream = SceneStream { config: rendered.world.clone(), seed };
            Arc::new(SceneDataset::new(stream, rendered.frames_per_epoch).with_views(rendered.views))
        }
        (None, Some(root)) => open_labelled(root, Some(&data.split))?,
        (None, None) => return Err(TrainError::NoData),
    };
    if dataset.is_empty() {
        return Err(TrainError::NoFrames(data.split.clone()));
    }
    Ok(if data.cache { Arc::new(CachedDataset::new(dataset)) } else { dataset })
}

/// Makes the folder of a run, which must not hold another one, and takes it; what a killed run left half written there
/// is removed.
fn prepare_folder(out: &Path, resume: bool) -> Result<FolderLock, TrainError> {
    let failed = |source| TrainError::Write { path: out.into(), source };
    fs::create_dir_all(out).map_err(failed)?;
    let lock = FolderLock::take(out).map_err(failed)?.ok_or_else(|| TrainError::Locked(out.into()))?;
    remove_stale_scratch(out).map_err(failed)?;
    if !resume && out.join(CHECKPOINT_FILE).exists() {
        return Err(TrainError::Occupied(out.into()));
    }
    Ok(lock)
}

/// Whether a run that goes on from the checkpoint at `path` learns from what it began with.
fn check_data(path: &Path, resume: bool, data: &Fingerprint, callback: &mut dyn Callback) -> Result<(), TrainError> {
    if !(resume && path.exists()) {
        return Ok(());
    }
    let differences = checkpoint::data_of(path)?.differences(data);
    if differences.is_empty() || callback.accepts_other_data(&differences) {
        return Ok(());
    }
    Err(TrainError::OtherData { path: path.into(), differences })
}

/// The batch after the one at `position`.
fn following(position: Position, batches_per_epoch: u64) -> Position {
    if position.batch + 1 < batches_per_epoch {
        Position { batch: position.batch + 1, ..position }
    } else {
        Position { epoch: position.epoch + 1, batch: 0 }
    }
}

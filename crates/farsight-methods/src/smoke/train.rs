//! Training of a detector.

use std::path::PathBuf;
use std::sync::Arc;

use farsight_core::Codec;
use farsight_data::loader::ItemError;
use farsight_data::{Batch, DatasetError, Position};
use farsight_graph::layers::{network, with_surface_head};
use farsight_graph::graph::{FEATURES, Graph, LOGITS, NodeId, REGRESSION, SURFACE};
use farsight_graph::model::{Model, ModelError};
use farsight_onnx::key;
use farsight_graph::weights::Weights;
use tch::{Device, no_grad};

use crate::checkpoint::Progress;
use crate::config::{DataConfig, RunConfig};
use crate::executor::{ExecutorError, Mode};
use crate::learner::{Learner, LearnerSettings};
use crate::loss::{CORNER_DIVISOR_PER_IMAGE, CornerWeights, LossTerms, loss, surface_loss};
use crate::metrics::{Lesson, Terms};
use crate::samples::{Sampler, TrainBatch, TrainSample};
use crate::trainer::{Job, NotFinite, Observer, Pace, Pupil, Run, Session, TrainError};

/// Name of the trained model in a run's folder.
pub const MODEL_FILE: &str = "model.safetensors";

/// Trains, and writes model, checkpoints, metrics and the resolved config to the job's folder. Returns the path of the model.
///
/// # Errors
/// See [`TrainError`].
pub fn train(job: &Job<RunConfig>, observer: &mut dyn Observer<LossTerms>) -> Result<PathBuf, TrainError> {
    let (session, source) = Session::open(job)?;
    let sampler = Arc::new(Sampler::new(source, &job.run.model, job.run.augmentation.clone()));
    let sample = move || {
        let sampler = Arc::clone(&sampler);
        move |key| sampler.sample(key)
    };
    let (mut detector, progress) = Detector::start(&job.run, &session)?;
    let progress = session.teach(&mut detector, progress, sample(), observer)?;
    if let Some(count) = job.run.train.statistics_batches {
        let after = Position { epoch: job.run.train.epochs, batch: 0 };
        detector.gather_statistics(session.loader(after, None, sample())?.take(count as usize))?;
    }
    let path = job.out.join(MODEL_FILE);
    detector.model(progress, session.frames)?.write(&path)?;
    Ok(path)
}

impl Run for RunConfig {
    fn data(&self) -> &DataConfig {
        &self.data
    }

    fn pace(&self) -> Pace {
        let train = &self.train;
        Pace {
            epochs: train.epochs,
            batch_size: train.batch_size,
            seed: train.seed,
            log_steps: train.log_steps,
            checkpoint_steps: train.checkpoint_steps,
            threads: train.threads,
        }
    }

    fn learner(&self) -> LearnerSettings {
        self.train.learner()
    }

    fn identity(&self) -> Self {
        Self::identity(self)
    }
}

/// A detector that learns, and what it needs to take a step.
struct Detector<'a> {
    run: &'a RunConfig,
    learner: Learner,
    /// Logits, regression and, where it is taught, the surface.
    outputs: Vec<NodeId>,
    is_narrowed: bool,
    codec: Codec,
}

impl Pupil for Detector<'_> {
    type Sample = TrainSample;
    type Terms = LossTerms;

    fn learner(&mut self) -> &mut Learner {
        &mut self.learner
    }

    fn rate(&self, step: u64, total: u64) -> f64 {
        let train = &self.run.train;
        train.learning_rate * train.schedule.factor(step, total, train.warm_up_steps)
    }

    fn name(sample: &TrainSample) -> &str {
        &sample.id
    }

    fn step(&mut self, samples: Vec<TrainSample>, rate: f64) -> Result<Option<Lesson<LossTerms>>, NotFinite> {
        let train = &self.run.train;
        let count = samples.len();
        let mut batch = TrainBatch::new(samples, self.run.model.input, self.learner.network.device());
        batch.targets = batch.targets.with_neighbours(train.neighbour_cells);
        let maps = self.learner.network.forward(&batch.input, Mode::Train, &self.outputs);
        let (mut objective, mut terms) =
            loss(&self.codec, &maps[0], &maps[1], &batch.targets, self.corner_weights(count));
        if let (Some(predicted), Some(surface_m)) = (maps.get(2), &batch.targets.surface_m) {
            let surface = surface_loss(predicted, surface_m, self.codec.depth.mean_m) * train.surface_weight;
            terms.surface = surface.double_value(&[]);
            objective += surface;
        }
        if let Some((name, value)) = terms.named().into_iter().find(|(_, value)| !value.is_finite()) {
            return Err(NotFinite { what: format!("loss term \"{name}\""), value });
        }
        let gradient_norm = self.learner.descend(&objective, rate)?;
        Ok(Some(Lesson { loss: terms.total(), terms, gradient_norm, samples: count }))
    }
}

impl<'a> Detector<'a> {
    fn start(run: &'a RunConfig, session: &Session<'_, RunConfig>) -> Result<(Self, Progress), TrainError> {
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
        let (learner, progress) = session.learner(graph)?;
        Ok((Self { run, learner, outputs, is_narrowed, codec: run.model.codec() }, progress))
    }

    /// How the corner loss of a batch of `images` is weighed.
    fn corner_weights(&self, images: usize) -> CornerWeights {
        let train = &self.run.train;
        CornerWeights {
            divisor: CORNER_DIVISOR_PER_IMAGE * images as f64,
            full_weight_m: (train.full_weight_m > 0.0).then_some(train.full_weight_m),
            orientation: train.orientation_weight,
            dimensions: train.dimensions_weight,
            image: train.image_weight,
        }
    }

    /// Takes the statistics of batch norm anew, as means over `batches`: those gathered while learning are of the last dozens of steps only.
    fn gather_statistics(
        &self,
        batches: impl Iterator<Item = Result<Batch<TrainSample>, ItemError<DatasetError>>>,
    ) -> Result<(), TrainError> {
        let network = &self.learner.network;
        let device: Device = network.device();
        for (done, batch) in batches.enumerate() {
            let step = done as u64;
            let items = batch.map_err(|source| TrainError::Sample { step, source })?.items;
            let batch = TrainBatch::new(items, self.run.model.input, device);
            let mode = Mode::Gather { share: 1.0 / (step + 1) as f64 };
            no_grad(|| network.forward(&batch.input, mode, &self.outputs));
        }
        Ok(())
    }

    fn model(&self, progress: Progress, frames: usize) -> Result<Model, ModelError> {
        let run = self.run;
        let mut weights = self.learner.weights();
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

//! What learns: a network, its optimiser and, where asked for, the running means of its weights. They start, stop and
//! go on together.

use std::path::{Path, PathBuf};

use farsight_graph::graph::Graph;
use farsight_graph::init::initial_weights;
use farsight_graph::model::ATTRIBUTION_KEY;
use farsight_graph::weights::Weights;
use serde::Serialize;
use tch::{Device, Tensor};

use crate::adam::{Adam, AdamSettings, BadGradient};
use crate::average::Averages;
use crate::checkpoint::{self, CheckpointError, Progress};
use crate::error::TrainError;
use crate::executor::{Network, Precision};
use crate::fingerprint::Fingerprint;
use crate::parts::{Loaded, Parts};

/// How a network starts and learns.
#[derive(Debug, Clone)]
pub struct LearnerSettings {
    /// The optimiser.
    pub adam: AdamSettings,
    /// Largest norm of the gradient; 0 for no limit.
    pub clip_norm: f64,
    /// Decay of the running means of the weights; none keeps none.
    pub ema_decay: Option<f64>,
    /// Numbers of the convolutions.
    pub precision: Precision,
    /// Seed of what starts at random.
    pub seed: u64,
    /// Weights to start from; what they lack starts at random.
    pub start_from: Option<PathBuf>,
    /// What does not learn like the rest.
    pub parts: Parts,
}

/// A network that learns.
#[derive(Debug)]
pub struct Learner {
    /// The network.
    pub network: Network,
    adam: Adam,
    averages: Option<Averages>,
    clip_norm: f64,
    /// Whose weights it started from, where that must be told.
    attribution: Option<String>,
    /// What it started from, when that was a file.
    pub loaded: Option<Loaded>,
}

impl Learner {
    /// Fresh, or as the checkpoint of the run with this `identity` has it, and how far that run has come.
    ///
    /// # Errors
    /// When the checkpoint cannot be read, or is of another run.
    pub fn start(
        graph: Graph,
        settings: &LearnerSettings,
        checkpoint: Option<&Path>,
        identity: &impl Serialize,
        device: Device,
    ) -> Result<(Self, Progress), TrainError> {
        let graph = settings.parts.marked(graph)?;
        let stored = checkpoint.map(|path| checkpoint::read(path, identity)).transpose()?;
        let (start, loaded) = match (&stored, &settings.start_from) {
            (Some((weights, _)), _) => (weights.clone(), None),
            (None, Some(path)) => {
                let (fresh, loaded) = (initial_weights(&graph, settings.seed), Weights::read(path)?);
                loaded.check_finite(path)?;
                let (weights, loaded) = settings.parts.load_partial(&graph, fresh, loaded, path)?;
                (weights, Some(loaded))
            }
            (None, None) => (initial_weights(&graph, settings.seed), None),
        };
        let network = Network::new(graph, &start, device, settings.precision)?;
        let adam = Adam::new(settings.adam.clone(), network.trainable_parameters());
        let attribution = start.metadata.get(ATTRIBUTION_KEY).cloned();
        let averages = settings.ema_decay.map(|decay| Averages::new(decay, &network));
        let mut learner = Self { network, adam, averages, clip_norm: settings.clip_norm, attribution, loaded };
        let mut progress = Progress::default();
        if let (Some(path), Some((weights, come_to))) = (checkpoint, stored) {
            let missing = |name| CheckpointError::Tensor { path: path.into(), name };
            learner.restore(&weights, come_to.steps).map_err(missing)?;
            progress = come_to;
        }
        Ok((learner, progress))
    }

    fn restore(&mut self, weights: &Weights, steps: u64) -> Result<(), String> {
        self.adam.restore(weights, steps)?;
        self.averages.as_mut().map_or(Ok(()), |averages| averages.restore(weights, steps))
    }

    /// One step against the gradient of `objective`. Returns its norm.
    ///
    /// # Errors
    /// When a gradient is not finite; the weights then stay as they are.
    pub fn descend(&mut self, objective: &Tensor, rate: f64) -> Result<f64, BadGradient> {
        let norm = self.adam.descend(&self.network, objective, self.clip_norm, rate)?;
        self.follow();
        Ok(norm)
    }

    /// A step without a gradient: it counts, so that a run that goes on counts as it did.
    pub fn rest(&mut self) {
        self.adam.rest();
        self.follow();
    }

    fn follow(&mut self) {
        if let Some(averages) = &mut self.averages {
            averages.follow(&self.network);
        }
    }

    /// The weights, and whose they once were.
    pub fn weights(&self) -> Weights {
        let mut weights = self.network.weights();
        let attribution = self.attribution.clone().map(|text| (ATTRIBUTION_KEY.to_owned(), text));
        weights.metadata.extend(attribution);
        weights
    }

    /// [`Learner::weights`] as a run that ended here would leave them: the running means, if they are kept.
    pub fn final_weights(&self) -> Weights {
        let mut weights = self.weights();
        if let Some(averages) = &self.averages {
            averages.replace(&mut weights);
        }
        weights
    }

    /// Writes a checkpoint, whole or not at all.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(
        &self,
        path: &Path,
        progress: Progress,
        identity: &impl Serialize,
        data: &Fingerprint,
    ) -> Result<(), CheckpointError> {
        let mut weights = self.weights();
        self.adam.store(&mut weights);
        if let Some(averages) = &self.averages {
            averages.store(&mut weights);
        }
        checkpoint::write(path, weights, progress, identity, data)
    }

    /// Puts the running means, if they were kept, in the place of the last step's weights.
    pub fn use_averages(&self) {
        if let Some(averages) = &self.averages {
            averages.use_averages(&self.network);
        }
    }
}

//! A training run in one TOML file.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use farsight_data::AugmentationConfig;
use farsight_methods::smoke::config::SmokeConfig;
use farsight_synth::SceneConfig;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::adam::AdamSettings;
use crate::executor::Precision;
use crate::learner::LearnerSettings;
use crate::parts::Parts;
use crate::schedule::Schedule;

/// A run: what to train, on what, how. Every field has a default; the defaults are the paper's recipe.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RunConfig {
    /// The network.
    pub model: SmokeConfig,
    /// Where the frames come from.
    pub data: DataConfig,
    /// How they vary.
    pub augmentation: AugmentationConfig,
    /// How the network learns.
    pub train: TrainConfig,
}

/// Where the frames come from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DataConfig {
    /// Folder in KITTI's layout; `--data` overrides it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub root: Option<PathBuf>,
    /// Rendered scenes instead of a folder.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rendered: Option<RenderedConfig>,
    /// Split: a name under `ImageSets` or a file of frame names.
    pub split: PathBuf,
    /// Train on the first so many frames of the split only; 0 for all.
    pub limit: usize,
    /// Threads that prepare samples.
    pub workers: usize,
    /// Batches prepared ahead.
    pub prefetch: usize,
    /// Keep decoded images in main memory (1.4 MB a KITTI frame): for small sets.
    pub cache: bool,
}

impl Default for DataConfig {
    fn default() -> Self {
        Self { root: None, rendered: None, split: "train".into(), limit: 0, workers: 2, prefetch: 4, cache: false }
    }
}

impl DataConfig {
    /// What of it changes the steps of a run.
    pub fn identity(&self) -> Self {
        let Self { rendered, split, limit, .. } = self.clone();
        Self { rendered, split, limit, ..Self::default() }
    }

    /// Why frames cannot be had from it, if they cannot.
    pub fn problem(&self) -> Option<String> {
        if let Some(rendered) = &self.rendered {
            if self.root.is_some() {
                return Some("data has both root and rendered; expected one of them".to_owned());
            }
            if let Some(problem) = rendered.world.problem() {
                return Some(format!("data.rendered.world.{problem}"));
            }
        }
        let counts = [("workers", self.workers), ("prefetch", self.prefetch)];
        let zero = counts.into_iter().find(|(_, count)| *count == 0);
        zero.map(|(name, _)| format!("data.{name} is 0; expected a positive number"))
    }
}

/// An endless stream of rendered scenes; their seed is the run's.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RenderedConfig {
    /// Scenes in what the schedule calls an epoch; no scene is ever seen twice.
    pub frames_per_epoch: usize,
    /// What the scenes look like and which cameras see them.
    pub world: SceneConfig,
}

impl Default for RenderedConfig {
    fn default() -> Self {
        Self { frames_per_epoch: 1000, world: SceneConfig::default() }
    }
}

/// How the network learns. The defaults are the paper's: Adam, cosine, weight decay 5e-4, 140 epochs, batch 8.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrainConfig {
    /// Passes over the data.
    pub epochs: u64,
    /// Images a step.
    pub batch_size: usize,
    /// Initial learning rate. The paper gives none; 2.5e-4 is official SMOKE's.
    pub learning_rate: f64,
    /// Weight decay.
    pub weight_decay: f64,
    /// Course of the learning rate.
    pub schedule: Schedule,
    /// Steps of linear rise before it.
    pub warm_up_steps: u64,
    /// Factor on the learning rate of biases; official SMOKE has 2, the paper is silent.
    pub bias_rate_factor: f64,
    /// Largest norm of the gradient; 0 for no limit.
    pub clip_norm: f64,
    /// Objects farther than this, metres, count in the corner loss in inverse proportion to their distance, so that relative errors are learnt rather
    /// than the guesses of the horizon; 0: all count the same, as in SMOKE.
    pub full_weight_m: f64,
    /// Factor on the orientation's part of the corner loss; 1 in SMOKE.
    pub orientation_weight: f64,
    /// Factor on the dimensions' part of the corner loss; 1 in SMOKE.
    pub dimensions_weight: f64,
    /// Weight of one more part of the corner loss, the predicted box as the image shows it, which judges apparent sizes; 0 for none, as in SMOKE.
    pub image_weight: f64,
    /// How many cells around an object's own teach the regression too, either way; 0: only its own, as in SMOKE.
    pub neighbour_cells: usize,
    /// Weight of a second lesson, the depth of whatever each cell shows, which rendered scenes know; 0 for none. Its head is not part of the model.
    pub surface_weight: f64,
    /// Numbers of the convolutions.
    pub precision: Precision,
    /// Seed of the weights, the order and the augmentation.
    pub seed: u64,
    /// Weights to start from instead of random ones (safetensors with the network's names); others start as they would.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub start_from: Option<PathBuf>,
    /// Starts of the names of tensors that start anew although `start_from` has them. With it, even empty, `start_from` must have all others.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub start_without: Option<Vec<String>>,
    /// Starts of the names of tensors that nothing moves; batch norms among them use their running statistics as they are.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub freeze: Vec<String>,
    /// Factors on the learning rate of tensors by how their names start; of several the longest start counts.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub rate_factors: BTreeMap<String, f64>,
    /// Decay of the exponential running means of the weights (EMA), which the model gets in the end; without it those of the last step.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ema_decay: Option<f64>,
    /// Batches after the last step over which the statistics of batch norm are taken anew; without it they are those of the last dozens of steps.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub statistics_batches: Option<u64>,
    /// Steps between checkpoints; one is also written at the end.
    pub checkpoint_steps: u64,
    /// Steps between lines of the metrics.
    pub log_steps: u64,
    /// Threads of libtorch; 0 for its own choice.
    pub threads: usize,
}

impl Default for TrainConfig {
    fn default() -> Self {
        Self {
            epochs: 140,
            batch_size: 8,
            learning_rate: 2.5e-4,
            weight_decay: 5e-4,
            schedule: Schedule::Cosine,
            warm_up_steps: 0,
            bias_rate_factor: 1.0,
            clip_norm: 0.0,
            full_weight_m: 0.0,
            orientation_weight: 1.0,
            dimensions_weight: 1.0,
            image_weight: 0.0,
            neighbour_cells: 0,
            surface_weight: 0.0,
            precision: Precision::F32,
            seed: 0,
            start_from: None,
            start_without: None,
            freeze: Vec::new(),
            rate_factors: BTreeMap::new(),
            ema_decay: None,
            statistics_batches: None,
            checkpoint_steps: 200,
            log_steps: 10,
            threads: 0,
        }
    }
}

/// A run that cannot be started as described.
#[derive(Debug, Error)]
pub enum RunConfigError {
    /// The file could not be read.
    #[error("{}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's answer.
        source: std::io::Error,
    },
    /// The file is no valid config; the text says line and column.
    #[error("{}: {source}", path.display())]
    Parse {
        /// The file.
        path: PathBuf,
        /// What is wrong, and where.
        source: toml::de::Error,
    },
    /// A value cannot be used.
    #[error("{}: {problem}", path.display())]
    Value {
        /// The file.
        path: PathBuf,
        /// The field, what was found and what was expected.
        problem: String,
    },
}

/// Reads a TOML file of which `problem` says what is wrong with its values.
pub fn read_checked<T: DeserializeOwned>(
    path: &Path,
    problem: impl Fn(&T) -> Option<String>,
) -> Result<T, RunConfigError> {
    let text = fs::read_to_string(path).map_err(|source| RunConfigError::Read { path: path.into(), source })?;
    let config: T = toml::from_str(&text).map_err(|source| RunConfigError::Parse { path: path.into(), source })?;
    match problem(&config) {
        Some(problem) => Err(RunConfigError::Value { path: path.into(), problem }),
        None => Ok(config),
    }
}

/// Why the weights' running means cannot have this decay, if they cannot.
pub fn problem_of_decay(ema_decay: Option<f64>) -> Option<String> {
    let wrong = ema_decay.filter(|decay| !(*decay > 0.0 && *decay < 1.0));
    wrong.map(|decay| format!("train.ema_decay is {decay}; expected a number between 0 and 1"))
}

impl RunConfig {
    /// Reads and checks a config file.
    ///
    /// # Errors
    /// When the file cannot be read, has a field that does not exist, or a value that cannot be used.
    pub fn read(path: &Path) -> Result<Self, RunConfigError> {
        read_checked(path, Self::problem)
    }

    /// This run without what does not change its steps: a checkpoint belongs to every run that has the same identity.
    pub fn identity(&self) -> Self {
        let train = TrainConfig::default();
        let mut identity = self.clone();
        identity.data = self.data.identity();
        identity.train.checkpoint_steps = train.checkpoint_steps;
        identity.train.log_steps = train.log_steps;
        identity.train.statistics_batches = train.statistics_batches;
        identity
    }

    /// Why this run cannot be started, if it cannot.
    pub fn problem(&self) -> Option<String> {
        if let Err(error) = self.model.validate() {
            return Some(error.to_string());
        }
        if let Some(problem) = self.augmentation.problem() {
            return Some(format!("augmentation.{problem}"));
        }
        if let Some(problem) = self.data.problem() {
            return Some(problem);
        }
        let train = &self.train;
        let positive = [
            ("train.epochs", train.epochs as f64),
            ("train.batch_size", train.batch_size as f64),
            ("train.learning_rate", train.learning_rate),
            ("train.bias_rate_factor", train.bias_rate_factor),
            ("train.checkpoint_steps", train.checkpoint_steps as f64),
            ("train.log_steps", train.log_steps as f64),
        ];
        let not_negative = [
            ("train.weight_decay", train.weight_decay),
            ("train.clip_norm", train.clip_norm),
            ("train.full_weight_m", train.full_weight_m),
            ("train.orientation_weight", train.orientation_weight),
            ("train.dimensions_weight", train.dimensions_weight),
            ("train.image_weight", train.image_weight),
            ("train.surface_weight", train.surface_weight),
        ];
        if train.surface_weight > 0.0 && self.data.rendered.is_none() {
            return Some("train.surface_weight needs data.rendered; other frames have no depth".to_owned());
        }
        let bad_positive = positive.iter().find(|(_, v)| !(v.is_finite() && *v > 0.0));
        let bad_other = not_negative.iter().find(|(_, v)| !(v.is_finite() && *v >= 0.0));
        bad_positive
            .map(|(name, v)| format!("{name} is {v}; expected a positive number"))
            .or_else(|| bad_other.map(|(name, v)| format!("{name} is {v}; expected 0 or a positive number")))
            .or_else(|| problem_of_decay(train.ema_decay))
            .or_else(|| train.problem_of_parts())
    }
}

impl TrainConfig {
    /// Settings of the optimiser.
    pub fn adam(&self) -> AdamSettings {
        AdamSettings {
            rate_factors: self.rate_factors.clone(),
            ..AdamSettings::new(self.weight_decay, self.bias_rate_factor)
        }
    }

    /// What is said about parts of the network that cannot be.
    fn problem_of_parts(&self) -> Option<String> {
        if self.start_without.is_some() && self.start_from.is_none() {
            return Some("train.start_without needs train.start_from; without it everything starts anew".to_owned());
        }
        let wrong = self.rate_factors.iter().find(|(_, factor)| !(factor.is_finite() && **factor > 0.0));
        wrong.map(|(prefix, factor)| {
            format!("train.rate_factors has {factor} for \"{prefix}\"; expected a positive number (train.freeze stops a part)")
        })
    }

    pub fn learner(&self) -> LearnerSettings {
        LearnerSettings {
            adam: self.adam(),
            clip_norm: self.clip_norm,
            ema_decay: self.ema_decay,
            precision: self.precision,
            seed: self.seed,
            start_from: self.start_from.clone(),
            parts: Parts {
                freeze: self.freeze.clone(),
                start_without: self.start_without.clone(),
                rate_factors: self.rate_factors.clone(),
            },
        }
    }
}

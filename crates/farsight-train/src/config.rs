//! A training run in one TOML file: what every method's training has in common.

use std::collections::BTreeMap;
use std::fmt::Debug;
use std::path::{Path, PathBuf};

use farsight_data::AugmentationConfig;
use farsight_graph::model::NetworkConfig;
use farsight_synth::SceneConfig;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::adam::AdamSettings;
pub use crate::error::RunConfigError;
use crate::executor::Precision;
use crate::learner::LearnerSettings;
use crate::parts::Parts;
use crate::schedule::Schedule;

/// What a method alone says about its training: the table `[task]`.
pub trait TaskConfig: Clone + Debug + Default + PartialEq + Serialize + DeserializeOwned {
    /// The field that cannot be used, what was found and what was expected; `data` is where the frames come from.
    fn problem(&self, data: &DataConfig) -> Option<String>;
}

/// A run: what to train, on what, how. Every table has defaults; those of `[train]` are the paper's recipe.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, bound = "")]
pub struct RunConfig<M: NetworkConfig, C: TaskConfig> {
    /// Tag of the method.
    pub method: String,
    /// The network.
    #[serde(default)]
    pub model: M,
    /// Where the frames come from.
    #[serde(default)]
    pub data: DataConfig,
    /// How they vary.
    #[serde(default)]
    pub augmentation: AugmentationConfig,
    /// How the network learns.
    #[serde(default)]
    pub train: TrainConfig,
    /// What the method alone says.
    #[serde(default)]
    pub task: C,
    /// What is measured while it learns.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub validate: Option<ValidateConfig>,
}

/// What is measured while a network learns: the model so far looks at frames that it does not learn from.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ValidateConfig {
    /// Folder in KITTI's layout.
    pub root: PathBuf,
    /// Split: a name under `ImageSets` or a file of frame names.
    pub split: PathBuf,
    /// Steps between two measurements.
    pub every_steps: u64,
    /// The first so many frames of the split only; 0 for all.
    #[serde(default)]
    pub limit: usize,
}

/// A config file as it is written.
///
/// # Errors
/// When the file cannot be read or is no TOML.
pub fn read_table(path: &Path) -> Result<toml::Table, RunConfigError> {
    parsed(path)
}

/// The tag of the method that a config in memory is of, which must be one of `known`; `path` is only what errors call
/// it.
///
/// # Errors
/// When it names no method that is known.
pub fn method_of(table: &toml::Table, known: &[&str], path: &Path) -> Result<String, RunConfigError> {
    let found = match table.get("method") {
        Some(toml::Value::String(method)) if known.contains(&method.as_str()) => return Ok(method.clone()),
        Some(other) => other.to_string(),
        None => "missing".to_owned(),
    };
    let problem = format!("method is {found}; expected one of {}", known.join(", "));
    Err(RunConfigError::Value { path: path.into(), problem })
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
            if rendered.views == 0 {
                return Some("data.rendered.views is 0; expected a positive number".to_owned());
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
    /// Samples in what the schedule calls an epoch; no sample is ever seen twice.
    pub frames_per_epoch: usize,
    /// Samples made of each scene, each with an augmentation of its own and some hundred scenes apart. More than 1 pays
    /// where drawing a scene takes longer than learning from it.
    pub views: usize,
    /// What the scenes look like and which cameras see them.
    pub world: SceneConfig,
}

impl Default for RenderedConfig {
    fn default() -> Self {
        Self { frames_per_epoch: 1000, views: 1, world: SceneConfig::default() }
    }
}

/// Which numbers a run is asked to compute in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PrecisionChoice {
    /// Single precision.
    #[default]
    F32,
    /// bfloat16 between the layers ([`Precision::Bf16`]).
    Bf16,
    /// Whichever of both makes a step faster on this machine. The run's folder says which it was, and who goes on with
    /// the run does so in the same numbers.
    Auto,
}

impl PrecisionChoice {
    /// What was asked for by name.
    pub fn named(self) -> Option<Precision> {
        match self {
            Self::F32 => Some(Precision::F32),
            Self::Bf16 => Some(Precision::Bf16),
            Self::Auto => None,
        }
    }
}

/// How a network learns, whatever its method. The defaults are the paper's: Adam, cosine, weight decay 5e-4, 140
/// epochs, batch 8.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrainConfig {
    /// Passes over the data.
    pub epochs: u64,
    /// Steps after which the run ends, although its schedule is that of all epochs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_steps: Option<u64>,
    /// Frames a step.
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
    /// Numbers of the convolutions.
    pub precision: PrecisionChoice,
    /// Seed of the weights, the order and the augmentation.
    pub seed: u64,
    /// Weights to start from instead of random ones (safetensors with the network's names); others start as they would.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub start_from: Option<PathBuf>,
    /// Starts of the names of tensors that start anew although `start_from` has them. With it, even empty, `start_from`
    /// must have all others.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub start_without: Option<Vec<String>>,
    /// Starts of the names of tensors that nothing moves; batch norms among them use their running statistics as they
    /// are.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub freeze: Vec<String>,
    /// Factors on the learning rate of tensors by how their names start; of several the longest start counts.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub rate_factors: BTreeMap<String, f64>,
    /// Decay of the exponential running means of the weights (EMA), which the model gets in the end; without it those
    /// of the last step.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ema_decay: Option<f64>,
    /// Batches after the last step over which the statistics of batch norm are taken anew; without it they are those of
    /// the last dozens of steps.
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
            max_steps: None,
            batch_size: 8,
            learning_rate: 2.5e-4,
            weight_decay: 5e-4,
            schedule: Schedule::Cosine,
            warm_up_steps: 0,
            bias_rate_factor: 1.0,
            clip_norm: 0.0,
            precision: PrecisionChoice::F32,
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

/// What stands in a TOML file.
fn parsed<T: DeserializeOwned>(path: &Path) -> Result<T, RunConfigError> {
    let text =
        farsight_files::read_config(path).map_err(|source| RunConfigError::Read { path: path.into(), source })?;
    toml::from_str(&text).map_err(|source| RunConfigError::Parse { path: path.into(), source })
}

impl<M: NetworkConfig, C: TaskConfig> RunConfig<M, C> {
    /// Reads and checks a config file.
    ///
    /// # Errors
    /// When the file cannot be read, has a field that does not exist, or a value that cannot be used.
    pub fn read(path: &Path) -> Result<Self, RunConfigError> {
        parsed::<Self>(path)?.checked(path)
    }

    /// Checks a config that is in memory; `path` is only what errors call it.
    ///
    /// # Errors
    /// When it has a field that does not exist, or a value that cannot be used.
    pub fn from_table(table: toml::Table, path: &Path) -> Result<Self, RunConfigError> {
        let parsed = table.try_into::<Self>().map_err(|source| RunConfigError::Parse { path: path.into(), source });
        parsed?.checked(path)
    }

    fn checked(self, path: &Path) -> Result<Self, RunConfigError> {
        match self.problem() {
            Some(problem) => Err(RunConfigError::Value { path: path.into(), problem }),
            None => Ok(self),
        }
    }

    /// This run without what does not change its steps: a checkpoint belongs to every run that has the same identity.
    #[must_use]
    pub fn identity(&self) -> Self {
        let train = TrainConfig::default();
        let mut identity = self.clone();
        identity.data = self.data.identity();
        identity.validate = None;
        identity.train.max_steps = train.max_steps;
        identity.train.checkpoint_steps = train.checkpoint_steps;
        identity.train.log_steps = train.log_steps;
        identity.train.statistics_batches = train.statistics_batches;
        identity
    }

    /// Why this run cannot be started, if it cannot.
    pub fn problem(&self) -> Option<String> {
        if self.method != M::METHOD {
            return Some(format!("method is \"{}\"; expected \"{}\"", self.method, M::METHOD));
        }
        let augmentation = || self.augmentation.problem().map(|problem| format!("augmentation.{problem}"));
        let validate = || {
            let every_steps = self.validate.as_ref()?.every_steps;
            (every_steps == 0).then(|| "validate.every_steps is 0; expected at least 1".to_owned())
        };
        self.model
            .problem()
            .or_else(augmentation)
            .or_else(|| self.data.problem())
            .or_else(|| self.task.problem(&self.data).map(|problem| format!("task.{problem}")))
            .or_else(|| self.train.problem())
            .or_else(validate)
    }
}

impl TrainConfig {
    /// Why a network cannot learn like this, if it cannot.
    pub fn problem(&self) -> Option<String> {
        let positive = [
            ("epochs", self.epochs as f64),
            ("max_steps", self.max_steps.map_or(1.0, |steps| steps as f64)),
            ("batch_size", self.batch_size as f64),
            ("learning_rate", self.learning_rate),
            ("bias_rate_factor", self.bias_rate_factor),
            ("checkpoint_steps", self.checkpoint_steps as f64),
            ("log_steps", self.log_steps as f64),
        ];
        let not_negative = [("weight_decay", self.weight_decay), ("clip_norm", self.clip_norm)];
        let bad_positive = positive.iter().find(|(_, v)| !(v.is_finite() && *v > 0.0));
        let bad_other = not_negative.iter().find(|(_, v)| !(v.is_finite() && *v >= 0.0));
        bad_positive
            .map(|(name, v)| format!("train.{name} is {v}; expected a positive number"))
            .or_else(|| bad_other.map(|(name, v)| format!("train.{name} is {v}; expected 0 or a positive number")))
            .or_else(|| self.problem_of_decay())
            .or_else(|| self.problem_of_parts())
    }

    /// Why the weights' running means cannot have this decay, if they cannot.
    fn problem_of_decay(&self) -> Option<String> {
        let wrong = self.ema_decay.filter(|decay| !(*decay > 0.0 && *decay < 1.0));
        wrong.map(|decay| format!("train.ema_decay is {decay}; expected a number between 0 and 1"))
    }

    /// The learning rate of a step, of so many in all.
    pub fn rate(&self, step: u64, total: u64) -> f64 {
        self.learning_rate * self.schedule.factor(step, total, self.warm_up_steps)
    }

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

    /// How a network starts and learns in these numbers.
    pub fn learner(&self, precision: Precision) -> LearnerSettings {
        LearnerSettings {
            adam: self.adam(),
            clip_norm: self.clip_norm,
            ema_decay: self.ema_decay,
            precision,
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

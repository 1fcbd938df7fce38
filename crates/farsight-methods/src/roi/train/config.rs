//! A training on cut-outs in one TOML file.

use std::path::{Path, PathBuf};

use farsight_data::AugmentationConfig;
use farsight_graph::model::NetworkConfig;
use crate::plate_reader::PlateConfig;
use crate::refiner::RefinerConfig;
use serde::{Deserialize, Serialize};

use crate::adam::AdamSettings;
use crate::config::{DataConfig, RunConfigError, problem_of_decay, read_checked};
use crate::executor::Precision;
use crate::learner::LearnerSettings;
use crate::parts::Parts;
use crate::schedule::Schedule;
use crate::trainer::{Pace, Run};

/// What to train, on what, how. One of the tables `[refiner]` and `[plates]` must be there, if only by name: it tells this from the training of a detector.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CropRun {
    /// The network, if it is a refiner.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refiner: Option<RefinerConfig>,
    /// The network, if it is a plate reader.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plates: Option<PlateConfig>,
    /// Where the frames come from.
    #[serde(default)]
    pub data: DataConfig,
    /// How the cut-outs vary; windows and their steps play no part.
    #[serde(default)]
    pub augmentation: AugmentationConfig,
    /// How the network learns.
    #[serde(default)]
    pub train: CropTrainConfig,
}

/// What is trained on cut-outs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CropNetwork<'a> {
    /// A refiner.
    Refiner(&'a RefinerConfig),
    /// A plate reader.
    Plates(&'a PlateConfig),
}

impl CropNetwork<'_> {
    fn problem(&self) -> Option<String> {
        match self {
            Self::Refiner(config) => config.problem(),
            Self::Plates(config) => config.problem(),
        }
    }
}

/// How a network learns from cut-outs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CropTrainConfig {
    /// Passes over the frames.
    pub epochs: u64,
    /// Frames a step; all their objects are a batch.
    pub frames_per_step: usize,
    /// At most so many objects of one frame, drawn at random.
    pub objects_per_frame: usize,
    /// Objects whose box is lower than this are not learnt from, pixels.
    pub least_height_px: f64,
    /// Folder of a detector's result files for the frames of `data.root`: what it found where nothing is teaches a refiner what nothing looks like.
    pub first_looks: Option<PathBuf>,
    /// At most so many of those of one frame, drawn at random.
    pub false_alarms_per_frame: usize,
    /// At most so many vehicles of one frame whose plates are not seen teach a plate reader to be unsure, drawn at random.
    pub hidden_plates_per_frame: usize,
    /// A network to start from; what it lacks starts at random.
    pub start_from: Option<PathBuf>,
    /// Initial learning rate.
    pub learning_rate: f64,
    /// Weight decay.
    pub weight_decay: f64,
    /// Steps of linear rise before it.
    pub warm_up_steps: u64,
    /// Largest norm of the gradient; 0 for no limit.
    pub clip_norm: f64,
    /// Decay of the exponential running means of the weights (EMA), which the network gets in the end; without it those of the last step.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ema_decay: Option<f64>,
    /// Seed of the weights, the order, the errors of the first look and the augmentation.
    pub seed: u64,
    /// Steps between checkpoints; one is also written at the end.
    pub checkpoint_steps: u64,
    /// Steps between lines of the metrics.
    pub log_steps: u64,
    /// Threads of libtorch; 0 for its own choice.
    pub threads: usize,
}

impl Default for CropTrainConfig {
    fn default() -> Self {
        Self {
            epochs: 10,
            frames_per_step: 14,
            objects_per_frame: 8,
            least_height_px: 20.0,
            first_looks: None,
            false_alarms_per_frame: 3,
            hidden_plates_per_frame: 1,
            start_from: None,
            learning_rate: 2e-3,
            weight_decay: 1e-5,
            warm_up_steps: 200,
            clip_norm: 10.0,
            ema_decay: None,
            seed: 0,
            checkpoint_steps: 500,
            log_steps: 50,
            threads: 0,
        }
    }
}

impl CropTrainConfig {
    pub(crate) fn learner(&self) -> LearnerSettings {
        LearnerSettings {
            adam: AdamSettings::new(self.weight_decay, 1.0),
            clip_norm: self.clip_norm,
            ema_decay: self.ema_decay,
            precision: Precision::F32,
            seed: self.seed,
            start_from: self.start_from.clone(),
            parts: Parts::default(),
        }
    }

    /// The learning rate of a step.
    pub(crate) fn rate(&self, step: u64, steps: u64) -> f64 {
        self.learning_rate * Schedule::Cosine.factor(step, steps, self.warm_up_steps)
    }

    fn problem(&self) -> Option<String> {
        let counts = [
            ("epochs", self.epochs),
            ("frames_per_step", self.frames_per_step as u64),
            ("objects_per_frame", self.objects_per_frame as u64),
            ("checkpoint_steps", self.checkpoint_steps),
            ("log_steps", self.log_steps),
        ];
        let numbers = [
            ("learning_rate", self.learning_rate),
            ("weight_decay", self.weight_decay),
            ("clip_norm", self.clip_norm),
            ("least_height_px", self.least_height_px),
        ];
        let zero = counts.into_iter().find(|(_, count)| *count == 0);
        let wrong = numbers.into_iter().find(|(_, number)| !(number.is_finite() && *number >= 0.0));
        zero.map(|(name, _)| format!("train.{name} is 0; expected at least 1"))
            .or_else(|| {
                wrong.map(|(name, number)| format!("train.{name} is {number}; expected a number that is not negative"))
            })
            .or_else(|| problem_of_decay(self.ema_decay))
    }
}

impl CropRun {
    /// Whether a config file is one of these: it has a table `[refiner]` or `[plates]`.
    pub fn is_meant(text: &str) -> bool {
        let table = text.parse::<toml::Table>();
        table.is_ok_and(|table| ["refiner", "plates"].iter().any(|name| table.contains_key(*name)))
    }

    /// What is to be trained, if that is one thing.
    pub fn network(&self) -> Option<CropNetwork<'_>> {
        match (&self.refiner, &self.plates) {
            (Some(config), None) => Some(CropNetwork::Refiner(config)),
            (None, Some(config)) => Some(CropNetwork::Plates(config)),
            _ => None,
        }
    }

    /// Reads and checks a config file.
    ///
    /// # Errors
    /// When the file cannot be read, has a field that does not exist, or a value that cannot be used.
    pub fn read(path: &Path) -> Result<Self, RunConfigError> {
        read_checked(path, Self::problem)
    }

    /// Why this run cannot be started, if it cannot.
    pub fn problem(&self) -> Option<String> {
        let augmentation = || self.augmentation.problem().map(|problem| format!("augmentation.{problem}"));
        if self.train.first_looks.is_some() && self.data.rendered.is_some() {
            return Some("train.first_looks needs data.root; a stream of scenes has no result files".to_owned());
        }
        let Some(network) = self.network() else {
            return Some("[refiner] and [plates]; expected one of them".to_owned());
        };
        if self.train.first_looks.is_some() && self.plates.is_some() {
            return Some(
                "train.first_looks is for refiners; a plate reader learns from labelled vehicles alone".to_owned(),
            );
        }
        let problem = network.problem().or_else(|| self.data.problem()).or_else(augmentation);
        problem.or_else(|| self.train.problem())
    }

    /// This run without what does not change its steps: a checkpoint belongs to every run that has the same identity.
    pub fn identity(&self) -> Self {
        let defaults = CropTrainConfig::default();
        let mut identity = self.clone();
        identity.data = self.data.identity();
        identity.train.checkpoint_steps = defaults.checkpoint_steps;
        identity.train.log_steps = defaults.log_steps;
        identity
    }
}

impl Run for CropRun {
    fn data(&self) -> &DataConfig {
        &self.data
    }

    fn pace(&self) -> Pace {
        let train = &self.train;
        Pace {
            epochs: train.epochs,
            batch_size: train.frames_per_step,
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

//! What a file says about its model.

use std::collections::BTreeMap;

use serde_json::json;

use farsight_graph::model::{Model, NetworkConfig};

use crate::Target;

/// Keys of the facts.
pub mod key {
    /// The whole description of the model, JSON; all that Farsight itself needs.
    pub const MODEL: &str = farsight_graph::model::CONFIG_KEY;
    /// Tag of the method that the model is of.
    pub const METHOD: &str = farsight_graph::model::METHOD_KEY;
    /// Names of the heatmap's channels, separated by commas.
    pub const CLASSES: &str = "farsight.classes";
    /// Width and height of the input the model was trained with, `1280x384`.
    pub const INPUT_SIZE: &str = "farsight.input_size";
    /// Order, mean and deviation of the colour channels on the scale 0 to 1, JSON.
    pub const NORMALISATION: &str = "farsight.normalisation";
    /// Reference depth and reference sizes that the regression is relative to, JSON.
    pub const REFERENCE: &str = "farsight.reference";
    /// [`farsight_graph::weights::Weights::sha256`] of the weights as they were trained. The last of the keys, and so
    /// of the file: what lacks it has been cut short.
    pub const WEIGHTS_SHA256: &str = "farsight.weights_sha256";
    /// Where the regression head lies that can be computed at single cells, JSON; see [`crate::LocalHeadFile`].
    pub const PEAKS_HEAD: &str = "farsight.peaks_head";
    /// What is in 8 bits, and how that was decided, JSON; only in files that have such parts.
    pub const QUANTIZATION: &str = "farsight.quantization";
    /// Which part of a network it is that is cut at its samplers: "1 of 2" and so on.
    pub const PART: &str = "farsight.part";
    /// For which engines the file is meant.
    pub const TARGET: &str = "farsight.target";
    /// Steps, epochs and frames of the training, JSON.
    pub const TRAINING: &str = "farsight.training";
    /// That the layers are narrower than the description says; only in files of pruned models.
    pub const NARROWED: &str = farsight_graph::model::PRUNED_KEY;
    /// How far a training has come, JSON; only in checkpoints, which are no models.
    pub const PROGRESS: &str = "farsight.progress";
    /// Projection of the camera of training, 12 numbers row by row, JSON.
    pub const CAMERA: &str = "farsight.camera";
    /// What the model was trained on.
    pub const TRAINING_DATA: &str = "farsight.training_data";
    /// The licence of what it was trained on.
    pub const TRAINING_DATA_LICENCE: &str = "farsight.training_data_licence";
    /// Whose weights it was made from, and under which licence they are.
    pub const ATTRIBUTION: &str = farsight_graph::model::ATTRIBUTION_KEY;
    /// How well it did, on what, JSON.
    pub const EVALUATION: &str = "farsight.evaluation";
}

/// Prefix of all keys.
const PREFIX: &str = "farsight.";

/// Facts about a model by key, see [`key`].
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Facts {
    entries: BTreeMap<String, String>,
}

impl Facts {
    /// What is known about `model`: its method, its config, and what its own file says about training, camera and
    /// licence.
    pub fn new<C: NetworkConfig>(model: &Model<C>, target: Target) -> Self {
        Self::with_hash(model, &model.weights.sha256(), target)
    }

    /// The same where the hash of the weights is known: computing it takes longer than looking at an image.
    pub fn with_hash<C: NetworkConfig>(model: &Model<C>, weights_sha256: &str, target: Target) -> Self {
        let own = model.weights.metadata.iter().filter(|(key, _)| key.starts_with(PREFIX));
        let mut facts = Self { entries: own.map(|(key, value)| (key.clone(), value.clone())).collect() };
        facts.set(key::METHOD, C::METHOD.to_owned());
        facts.set(key::MODEL, json!(model.config).to_string());
        facts.set(key::WEIGHTS_SHA256, weights_sha256.to_owned());
        facts.set(key::TARGET, target.name().to_owned());
        facts
    }

    /// Adds or replaces a fact.
    pub fn set(&mut self, key: &str, value: String) {
        self.entries.insert(key.to_owned(), value);
    }

    /// The fact under this key.
    pub fn get(&self, key: &str) -> Option<&str> {
        self.entries.get(key).map(String::as_str)
    }

    /// All facts, by key.
    pub fn entries(&self) -> impl Iterator<Item = (String, String)> {
        self.entries.iter().map(|(key, value)| (key.clone(), value.clone()))
    }
}

impl FromIterator<(String, String)> for Facts {
    fn from_iter<I: IntoIterator<Item = (String, String)>>(entries: I) -> Self {
        Self { entries: entries.into_iter().collect() }
    }
}

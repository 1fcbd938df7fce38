//! Models that are only a config: a network with random weights, to know what it costs before it is trained.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use farsight_data::AugmentationConfig;
use farsight_net::build::network;
use farsight_net::config::ModelConfig;
use farsight_net::init::initial_weights;
use farsight_net::model::Model;
use farsight_net::refiner::RefinerConfig;
use serde::Deserialize;

/// The parts of a training's config that describe what is trained.
///
/// `farsight train` reads the other tables; that there are no others is checked here too, as what is misspelt would be ignored.
#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct RunFile {
    model: Option<ModelConfig>,
    refiner: Option<RefinerConfig>,
    #[serde(rename = "data")]
    _data: toml::Table,
    #[serde(rename = "augmentation")]
    _augmentation: AugmentationConfig,
    #[serde(rename = "train")]
    _train: toml::Table,
}

impl RunFile {
    fn read(path: &Path) -> Result<Self> {
        let text = fs::read_to_string(path).with_context(|| format!("{}: cannot be read", path.display()))?;
        let run: Self =
            toml::from_str(&text).with_context(|| format!("{}: not the config of a training", path.display()))?;
        let both = run.model.is_some() && run.refiner.is_some();
        ensure!(!both, "{}: both [model] and [refiner]; expected one of them", path.display());
        Ok(run)
    }
}

/// Whether a file is the config of a training rather than a model.
pub(crate) fn is_config(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "toml")
}

/// What the config of a training says about its model.
pub(crate) fn read_config(path: &Path) -> Result<ModelConfig> {
    let run = RunFile::read(path)?;
    ensure!(run.refiner.is_none(), "{}: the config of a refiner; expected that of a detector", path.display());
    let model = run.model.unwrap_or_default();
    model.validate().with_context(|| path.display().to_string())?;
    Ok(model)
}

/// What the config of a training says about its refiner, if it is the training of one.
pub(crate) fn read_refiner_config(path: &Path) -> Result<Option<RefinerConfig>> {
    let refiner = RunFile::read(path)?.refiner;
    if let Some(problem) = refiner.as_ref().and_then(RefinerConfig::problem) {
        bail!("{}: {problem}", path.display());
    }
    Ok(refiner)
}

/// The network of a config with random weights.
pub(crate) fn model(path: &Path) -> Result<Model> {
    let config = read_config(path)?;
    let weights = initial_weights(&network(&config), 0);
    Ok(Model::new(config, weights)?)
}

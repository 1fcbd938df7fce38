//! Models that are only a config: a network with random weights, to know what it costs before it is trained.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};
use farsight_net::build::network;
use farsight_net::config::ModelConfig;
use farsight_net::init::initial_weights;
use farsight_net::model::Model;
use serde::Deserialize;

/// The part of a training's config that describes the model.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct RunFile {
    model: ModelConfig,
}

/// Whether a file is the config of a training rather than a model.
pub(crate) fn is_config(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "toml")
}

/// What the config of a training says about its model.
pub(crate) fn read_config(path: &Path) -> Result<ModelConfig> {
    let text = fs::read_to_string(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    let run: RunFile = toml::from_str(&text).with_context(|| path.display().to_string())?;
    run.model.validate().with_context(|| path.display().to_string())?;
    Ok(run.model)
}

/// The network of a config with random weights.
pub(crate) fn model(path: &Path) -> Result<Model> {
    let config = read_config(path)?;
    let weights = initial_weights(&network(&config), 0);
    Ok(Model::new(config, weights)?)
}

//! Models that are only a config: a network with random weights, to know what it costs before it is trained.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result, bail};
use farsight_data::AugmentationConfig;
use farsight_net::build::network;
use farsight_net::config::ModelConfig;
use farsight_net::init::initial_weights;
use farsight_net::model::Model;
use farsight_net::part::PartConfig;
use farsight_net::plate::PlateConfig;
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
    plates: Option<PlateConfig>,
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
        toml::from_str(&text).with_context(|| format!("{}: not the config of a training", path.display()))
    }
}

/// What a config's training is of.
pub(crate) enum Untrained {
    Detector(ModelConfig),
    Refiner(RefinerConfig),
    Plates(PlateConfig),
}

/// Whether a file is the config of a training rather than a model.
pub(crate) fn is_config(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "toml")
}

/// What the config of a training says about what it trains.
pub(crate) fn read(path: &Path) -> Result<Untrained> {
    let RunFile { model, refiner, plates, .. } = RunFile::read(path)?;
    Ok(match (model, refiner, plates) {
        (None, Some(config), None) => Untrained::Refiner(usable(config, path)?),
        (None, None, Some(config)) => Untrained::Plates(usable(config, path)?),
        (model, None, None) => {
            let config = model.unwrap_or_default();
            config.validate().with_context(|| path.display().to_string())?;
            Untrained::Detector(config)
        }
        _ => bail!("{}: more than one of [model], [refiner] and [plates]; expected one of them", path.display()),
    })
}

fn usable<C: PartConfig>(config: C, path: &Path) -> Result<C> {
    match config.problem() {
        Some(problem) => bail!("{}: {problem}", path.display()),
        None => Ok(config),
    }
}

/// What the config of a training says about its detector.
pub(crate) fn read_config(path: &Path) -> Result<ModelConfig> {
    let other = match read(path)? {
        Untrained::Detector(config) => return Ok(config),
        Untrained::Refiner(_) => RefinerConfig::NAME,
        Untrained::Plates(_) => PlateConfig::NAME,
    };
    bail!("{}: the config of {other}; expected that of a detector", path.display())
}

/// The network of a config with random weights.
pub(crate) fn model(path: &Path) -> Result<Model> {
    let config = read_config(path)?;
    let weights = initial_weights(&network(&config), 0);
    Ok(Model::new(config, weights)?)
}

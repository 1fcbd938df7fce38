//! Models that are only a config: a network with random weights, to know what it costs before it is trained.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result, bail};
use farsight_data::AugmentationConfig;
use farsight_graph::init::initial_weights;
use farsight_graph::model::NetworkConfig;
use farsight_methods::plate_reader::PlateReaderConfig;
use farsight_methods::refiner::RefinerConfig;
use farsight_methods::smoke::SmokeModel;
use farsight_methods::smoke::config::SmokeConfig;
use serde::Deserialize;

/// The parts of a training's config that describe what is trained.
///
/// `farsight train` reads the other tables; that there are no others is checked here too, as what is misspelt would be ignored.
#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct RunFile {
    model: Option<SmokeConfig>,
    refiner: Option<RefinerConfig>,
    plates: Option<PlateReaderConfig>,
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
    Detector(SmokeConfig),
    Refiner(RefinerConfig),
    Plates(PlateReaderConfig),
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

fn usable<C: NetworkConfig>(config: C, path: &Path) -> Result<C> {
    match config.problem() {
        Some(problem) => bail!("{}: {problem}", path.display()),
        None => Ok(config),
    }
}

/// What the config of a training says about its detector.
pub(crate) fn read_config(path: &Path) -> Result<SmokeConfig> {
    let other = match read(path)? {
        Untrained::Detector(config) => return Ok(config),
        Untrained::Refiner(_) => RefinerConfig::NAME,
        Untrained::Plates(_) => PlateReaderConfig::NAME,
    };
    bail!("{}: the config of {other}; expected that of a detector", path.display())
}

/// The network of a config with random weights.
pub(crate) fn model(path: &Path) -> Result<SmokeModel> {
    let config = read_config(path)?;
    let weights = initial_weights(&config.graph(), 0);
    Ok(SmokeModel::new(config, weights)?)
}

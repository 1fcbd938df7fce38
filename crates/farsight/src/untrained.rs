//! Models that are only a config: a network with random weights, to know what it costs before it is trained.

use std::path::Path;

use anyhow::{Context, Result, bail};
use farsight_data::AugmentationConfig;
use farsight_graph::init::initial_weights;
use farsight_graph::model::NetworkConfig;
use farsight_methods::detectors::{Description, trained_methods};
use farsight_methods::plate_reader::PlateReaderConfig;
use farsight_methods::refiner::RefinerConfig;
use farsight_methods::smoke::SmokeModel;
use farsight_methods::smoke::config::SmokeConfig;
use serde::Deserialize;

/// The parts of a training's config that describe what is trained.
///
/// `farsight train` reads the other tables; that there are no others is checked here too, as what is misspelt would be
/// ignored.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RunFile {
    method: Option<String>,
    #[serde(default)]
    model: toml::Table,
    #[serde(default, rename = "data")]
    _data: toml::Table,
    #[serde(default, rename = "augmentation")]
    _augmentation: AugmentationConfig,
    #[serde(default, rename = "train")]
    _train: toml::Table,
    #[serde(default, rename = "task")]
    _task: toml::Table,
    #[serde(default, rename = "validate")]
    _validate: toml::Table,
}

impl RunFile {
    fn read(path: &Path) -> Result<Self> {
        let text = farsight_files::read_config(path).with_context(|| format!("{}: cannot be read", path.display()))?;
        toml::from_str(&text).with_context(|| format!("{}: not the config of a training", path.display()))
    }
}

/// What a config's training is of.
pub(crate) enum Untrained {
    Smoke(SmokeConfig),
    /// A detector of another method.
    Other(Description),
    Refiner(RefinerConfig),
    Plates(PlateReaderConfig),
}

/// Whether a file is the config of a training rather than a model.
pub(crate) fn is_config(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "toml")
}

/// What the config of a training says about what it trains.
pub(crate) fn read(path: &Path) -> Result<Untrained> {
    let RunFile { method, model, .. } = RunFile::read(path)?;
    let found = match method.as_deref() {
        Some(SmokeConfig::METHOD) => return Ok(Untrained::Smoke(model_config(model, path)?)),
        Some(RefinerConfig::METHOD) => return Ok(Untrained::Refiner(model_config(model, path)?)),
        Some(PlateReaderConfig::METHOD) => return Ok(Untrained::Plates(model_config(model, path)?)),
        Some(other) => match Description::of_table(other, model) {
            Some(Ok(description)) => return Ok(Untrained::Other(description)),
            Some(Err(problem)) => bail!("{}: [model]: {problem}", path.display()),
            None => format!("\"{other}\""),
        },
        None => "missing".to_owned(),
    };
    let known: Vec<&str> = [SmokeConfig::METHOD]
        .into_iter()
        .chain(trained_methods())
        .chain([RefinerConfig::METHOD, PlateReaderConfig::METHOD])
        .collect();
    bail!("{}: method is {found}; expected one of {}", path.display(), known.join(", "))
}

fn model_config<C: NetworkConfig>(table: toml::Table, path: &Path) -> Result<C> {
    let config: C = table.try_into().with_context(|| format!("{}: [model]", path.display()))?;
    usable(config, path)
}

fn usable<C: NetworkConfig>(config: C, path: &Path) -> Result<C> {
    match config.problem() {
        Some(problem) => bail!("{}: {problem}", path.display()),
        None => Ok(config),
    }
}

/// What the config of a training says about its SMOKE.
pub(crate) fn read_config(path: &Path) -> Result<SmokeConfig> {
    let other = match read(path)? {
        Untrained::Smoke(config) => return Ok(config),
        Untrained::Other(description) => description.name,
        Untrained::Refiner(_) => RefinerConfig::NAME,
        Untrained::Plates(_) => PlateReaderConfig::NAME,
    };
    bail!("{}: the config of {other}; expected that of a SMOKE", path.display())
}

/// The network of a config with random weights.
pub(crate) fn model(path: &Path) -> Result<SmokeModel> {
    let config = read_config(path)?;
    let weights = initial_weights(&config.graph(), 0);
    Ok(SmokeModel::new(config, weights)?)
}

//! Models that are only a config: a network with random weights, to know what it costs before it is trained.

use std::path::Path;

use anyhow::{Context, Result, bail};
use farsight::ModelSource;
use farsight_data::AugmentationConfig;
use farsight_methods::description::{Description, trained_methods};
use farsight_methods::detectors::{DetectorNetwork, untrained};
use farsight_onnx::Target;
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
    #[serde(default, rename = "parts")]
    _parts: Vec<toml::Table>,
}

impl RunFile {
    fn read(path: &Path) -> Result<Self> {
        let text = farsight_files::read_config(path).with_context(|| format!("{}: cannot be read", path.display()))?;
        toml::from_str(&text).with_context(|| format!("{}: not the config of a training", path.display()))
    }
}

/// Whether a file is the config of a training rather than a model.
pub(crate) fn is_config(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "toml")
}

/// What the config of a training says about what it trains.
pub(crate) fn read(path: &Path) -> Result<Description> {
    let RunFile { method, model, .. } = RunFile::read(path)?;
    let tag = known(method, path)?;
    match Description::of_table(&tag, model) {
        Some(Ok(description)) => Ok(description),
        Some(Err(problem)) => bail!("{}: {problem}", path.display()),
        None => unreachable!("a method that is known"),
    }
}

/// The tag of a method that can be trained, in whatever build.
fn known(method: Option<String>, path: &Path) -> Result<String> {
    let found = match method {
        Some(tag) if trained_methods().any(|known| known == tag) => return Ok(tag),
        Some(other) => format!("\"{other}\""),
        None => "missing".to_owned(),
    };
    let known: Vec<&str> = trained_methods().collect();
    bail!("{}: method is {found}; expected one of {}", path.display(), known.join(", "))
}

/// The network of a detector's config with random weights, in memory, for engines of this target.
pub(crate) fn network(path: &Path, target: Target) -> Result<ModelSource> {
    let description = read(path)?;
    let RunFile { model, .. } = RunFile::read(path)?;
    let made = untrained(description.method, model, target, path);
    let DetectorNetwork { first, later, .. } = made
        .with_context(|| format!("{}: the config of {}; expected a detector's", path.display(), description.name))??;
    let later = later.into_iter().map(|part| part.onnx).collect();
    Ok(ModelSource::Memory { onnx: Box::new(first.onnx), later, name: path.to_owned() })
}

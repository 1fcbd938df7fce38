//! A training in parts, each of which goes on from the one before, in one config file.
//!
//! ```toml
//! method = "smoke"              # and what all parts have in common
//! [[parts]]
//! name = "first"
//! train.epochs = 20
//! [[parts]]
//! name = "second"               # from the model of the first
//! train.epochs = 5
//! ```

use std::fs;
use std::path::{Path, PathBuf};

use farsight_files::write_atomically;
use farsight_graph::weights::Weights;
use farsight_train::config::{RunConfigError, method_of};
use farsight_train::training::{Callback, FileOptions, TrainError};
use serde::Deserialize;

use super::{TAGS, method};
use crate::patch::lay_over;

/// One part.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Part {
    /// Its folder, and what `mean_of` calls it.
    name: String,
    /// Its config but for where it starts.
    config: toml::Table,
    start: Start,
}

/// What a part starts from.
#[derive(Debug, Clone, PartialEq)]
enum Start {
    /// What its config says, or random weights.
    AsSaid,
    /// The model of the part before.
    PartBefore,
    /// The mean of the weights of two parts before.
    MeanOf([String; 2]),
}

/// As a file says it.
#[derive(Debug, Deserialize)]
struct PartConfig {
    name: String,
    mean_of: Option<[String; 2]>,
    #[serde(flatten)]
    changes: toml::Table,
}

/// The parts of the config `table`, each with what they have in common; none where it has no `parts`. `path` is only
/// what errors call it.
///
/// # Errors
/// When a part cannot be trained.
pub(super) fn parts(mut table: toml::Table, path: &Path) -> Result<Option<Vec<Part>>, RunConfigError> {
    let refused = |problem: String| RunConfigError::Value { path: path.into(), problem };
    let Some(listed) = table.remove("parts") else { return Ok(None) };
    let listed: Vec<PartConfig> =
        listed.try_into().map_err(|source| RunConfigError::Parse { path: path.into(), source })?;
    if listed.is_empty() {
        return Err(refused("parts is empty; expected one [[parts]] or more".to_owned()));
    }
    if start_from(&table).is_some() {
        return Err(refused("train.start_from is outside of the [[parts]]; expected it in the first".to_owned()));
    }
    let mut parts: Vec<Part> = Vec::with_capacity(listed.len());
    for PartConfig { name, mean_of, changes } in listed {
        let is_name = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        if name.is_empty() || !name.chars().all(is_name) {
            return Err(refused(format!("parts: name is {name:?}; expected letters, digits, - and _")));
        }
        let is_known = |name: &String| parts.iter().any(|part| part.name == *name);
        if is_known(&name) {
            return Err(refused(format!("parts: two are called {name:?}; expected names of their own")));
        }
        if let Some(unknown) = mean_of.iter().flatten().find(|name| !is_known(name)) {
            return Err(refused(format!("part {name}: mean_of names {unknown:?}; expected a part before it")));
        }
        let mut config = table.clone();
        lay_over(&mut config, &changes);
        let start = match (start_from(&config), mean_of) {
            (Some(_), Some(_)) => {
                return Err(refused(format!("part {name} has mean_of and train.start_from; expected one of them")));
            }
            (Some(_), None) => Start::AsSaid,
            (None, Some(names)) => Start::MeanOf(names),
            (None, None) if parts.is_empty() => Start::AsSaid,
            (None, None) => Start::PartBefore,
        };
        let part = Part { name, config, start };
        // Typing errors of the last part are told before the first one is trained.
        let config = part.starting_from(Path::new("the part before"));
        let tag = method_of(&config, &TAGS, path)?;
        (method(&tag).check)(config, path).map_err(|error| match error {
            RunConfigError::Value { path, problem } => {
                RunConfigError::Value { path, problem: format!("part {}: {problem}", part.name) }
            }
            other => other,
        })?;
        parts.push(part);
    }
    Ok(Some(parts))
}

/// Trains part after part in folders of their own. Returns the model of the last one. With `resume`, parts that are
/// done stay as they are, and one that is not goes on.
///
/// # Errors
/// As [`super::train`].
pub(super) fn train(
    parts: &[Part],
    path: &Path,
    options: &FileOptions,
    callback: &mut dyn Callback,
) -> Result<PathBuf, TrainError> {
    let FileOptions { data, out, resume } = options;
    fs::create_dir_all(out).map_err(|source| TrainError::Write { path: out.clone(), source })?;
    let mut models: Vec<(&str, PathBuf)> = Vec::with_capacity(parts.len());
    for (place, part) in parts.iter().enumerate() {
        callback.on_part(&part.name, place + 1, parts.len());
        let folder = out.join(&part.name);
        let start = match &part.start {
            Start::AsSaid => None,
            Start::PartBefore => models.last().map(|(_, model)| model.clone()),
            Start::MeanOf(names) => Some(mean(names, &models, &out.join(format!("{}-start.safetensors", part.name)))?),
        };
        let config = start.map_or_else(|| part.config.clone(), |start| part.starting_from(&start));
        let file = out.join(format!("{}.toml", part.name));
        write_atomically(&file, |to| write!(to, "{config}"))?;
        let resume = *resume && folder.exists();
        let options = FileOptions { data: data.clone(), out: folder, resume };
        let tag = method_of(&config, &TAGS, path)?;
        models.push((&part.name, (method(&tag).train)(&file, &options, callback)?));
    }
    Ok(models.pop().map(|(_, model)| model).unwrap_or_default())
}

/// Writes the mean of the weights of two parts to `path`.
fn mean(names: &[String; 2], models: &[(&str, PathBuf)], path: &Path) -> Result<PathBuf, TrainError> {
    let of = |name: &String| models.iter().find(|(known, _)| known == name).map(|(_, model)| Weights::read(model));
    let [first, second] = names.each_ref().map(of);
    let (first, second) = (first.transpose()?, second.transpose()?);
    let mean = first.zip(second).and_then(|(first, second)| first.mean_with(&second));
    let problem = || format!("mean_of: {} are not of one network", names.join(" and "));
    mean.ok_or_else(|| RunConfigError::Value { path: path.into(), problem: problem() })?.write(path)?;
    Ok(path.to_path_buf())
}

impl Part {
    /// Its config with these weights to start from, unless it names others.
    fn starting_from(&self, start: &Path) -> toml::Table {
        let mut config = self.config.clone();
        if self.start != Start::AsSaid {
            let start_from = toml::Table::from_iter([("start_from".to_owned(), start.display().to_string().into())]);
            lay_over(&mut config, &toml::Table::from_iter([("train".to_owned(), start_from.into())]));
        }
        config
    }
}

/// What a config says of where it starts.
fn start_from(config: &toml::Table) -> Option<&toml::Value> {
    config.get("train")?.get("start_from")
}

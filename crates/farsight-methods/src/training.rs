//! Which methods can be trained: a config file says the method by its tag.

mod parts;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use farsight_data::Dataset;
use farsight_graph::model::NetworkConfig;
use farsight_train::config::{RunConfig, RunConfigError, method_of, read_table};
use farsight_train::task::{RunOf, Task};
use farsight_train::training::{Callback, FileOptions, Job, TrainError, fit_file, fit_on};

use crate::TASKS;

/// Trains the method of a table on a data set.
type TrainOn = fn(toml::Table, &Path, Arc<dyn Dataset>, &FileOptions, &mut dyn Callback) -> Result<PathBuf, TrainError>;

/// What can be done with the config of a method.
pub(crate) struct Entry {
    tag: &'static str,
    train: fn(&Path, &FileOptions, &mut dyn Callback) -> Result<PathBuf, TrainError>,
    train_on: TrainOn,
    check: fn(toml::Table, &Path) -> Result<(), RunConfigError>,
}

impl Entry {
    pub(crate) const fn new<T: Task>() -> Self {
        Self {
            tag: T::Model::METHOD,
            train: fit_file::<T>,
            train_on: |table, path, dataset, options, callback| {
                let run: RunOf<T> = RunConfig::from_table(table, path)?;
                let FileOptions { out, resume, .. } = options.clone();
                fit_on::<T>(&Job { run, out, resume }, dataset, callback)
            },
            check: |table, path| -> Result<(), RunConfigError> {
                let run: Result<RunOf<T>, _> = RunConfig::from_table(table, path);
                run.map(drop)
            },
        }
    }
}

/// Does something with every task.
pub trait TaskVisitor {
    /// Does it with this one.
    fn visit<T: Task>(&mut self);
}

/// Their tags.
pub const TAGS: [&str; TASKS.len()] = {
    let mut tags = [""; TASKS.len()];
    let mut place = 0;
    while place < TASKS.len() {
        tags[place] = TASKS[place].tag;
        place += 1;
    }
    tags
};

/// Trains the method that the config file at `path` names, part after part where it has `[[parts]]`. Returns the path
/// of the model.
///
/// # Errors
/// When the file names no method that is known here, and as [`farsight_train::training::fit`].
pub fn train(path: &Path, options: &FileOptions, callback: &mut dyn Callback) -> Result<PathBuf, TrainError> {
    let table = read_table(path)?;
    let tag = method_of(&table, &TAGS, path)?;
    match parts::parts(table, path)? {
        Some(parts) => parts::train(&parts, path, options, callback),
        None => (method(&tag).train)(path, options, callback),
    }
}

/// Trains the method that the config `table` names on `dataset`, whatever data it names itself; `path` is only what
/// errors call the config. Returns the path of the model.
///
/// # Errors
/// As [`train`].
pub fn train_on(
    table: toml::Table,
    path: &Path,
    dataset: Arc<dyn Dataset>,
    options: &FileOptions,
    callback: &mut dyn Callback,
) -> Result<PathBuf, TrainError> {
    let tag = method_of(&table, &TAGS, path)?;
    (method(&tag).train_on)(table, path, dataset, options, callback)
}

/// Checks the config of a training that is in memory, all of its parts where it has `[[parts]]`; `path` is only what
/// errors call it.
///
/// # Errors
/// When it names no method that is known here, has a field that its method does not have, or a value that cannot be
/// used.
pub fn check(table: &toml::Table, path: &Path) -> Result<(), RunConfigError> {
    let tag = method_of(table, &TAGS, path)?;
    match parts::parts(table.clone(), path)? {
        Some(_) => Ok(()),
        None => (method(&tag).check)(table.clone(), path),
    }
}

/// The method of a tag that is known.
fn method(tag: &str) -> &'static Entry {
    TASKS.iter().find(|method| method.tag == tag).unwrap_or_else(|| unreachable!("a method that is known"))
}

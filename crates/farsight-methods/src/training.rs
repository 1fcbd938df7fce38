//! Which methods can be trained: a config file says the method by its tag.

use std::path::{Path, PathBuf};

use farsight_graph::model::NetworkConfig;
use farsight_train::config::{RunConfig, RunConfigError, method_of, read_method};
use farsight_train::task::{RunOf, Task};
use farsight_train::training::{Callback, FileOptions, TrainError, fit_file};

use crate::centernet3d::train::CenterNet3dTask;
use crate::gs3d::train::Gs3dTask;
use crate::monodle::train::MonoDleTask;
use crate::oftnet::train::OftNetTask;
use crate::plate_reader::train::PlateReaderTask;
use crate::refiner::train::RefinerTask;
use crate::smoke::train::SmokeTask;

/// What can be done with the config of a method.
struct Method {
    tag: &'static str,
    train: fn(&Path, &FileOptions, &mut dyn Callback) -> Result<PathBuf, TrainError>,
    check: fn(toml::Table, &Path) -> Result<(), RunConfigError>,
}

impl Method {
    const fn new<T: Task>() -> Self {
        Self {
            tag: T::Model::METHOD,
            train: fit_file::<T>,
            check: |table, path| -> Result<(), RunConfigError> {
                let run: Result<RunOf<T>, _> = RunConfig::from_table(table, path);
                run.map(drop)
            },
        }
    }
}

/// The methods.
const METHODS: [Method; 7] = [
    Method::new::<SmokeTask>(),
    Method::new::<CenterNet3dTask>(),
    Method::new::<MonoDleTask>(),
    Method::new::<OftNetTask>(),
    Method::new::<Gs3dTask>(),
    Method::new::<RefinerTask>(),
    Method::new::<PlateReaderTask>(),
];

/// Their tags.
pub const TAGS: [&str; METHODS.len()] = {
    let mut tags = [""; METHODS.len()];
    let mut place = 0;
    while place < METHODS.len() {
        tags[place] = METHODS[place].tag;
        place += 1;
    }
    tags
};

/// Trains the method that the config file at `path` names. Returns the path of the model.
///
/// # Errors
/// When the file names no method that is known here, and as [`farsight_train::training::fit`].
pub fn train(path: &Path, options: &FileOptions, callback: &mut dyn Callback) -> Result<PathBuf, TrainError> {
    let tag = read_method(path, &TAGS)?;
    (method(&tag).train)(path, options, callback)
}

/// Checks the config of a training that is in memory; `path` is only what errors call it.
///
/// # Errors
/// When it names no method that is known here, has a field that its method does not have, or a value that cannot be
/// used.
pub fn check(table: &toml::Table, path: &Path) -> Result<(), RunConfigError> {
    let tag = method_of(table, &TAGS, path)?;
    (method(&tag).check)(table.clone(), path)
}

/// The method of a tag that is known.
fn method(tag: &str) -> &'static Method {
    METHODS.iter().find(|method| method.tag == tag).unwrap_or_else(|| unreachable!("a method that is known"))
}

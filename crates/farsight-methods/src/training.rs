//! Which methods can be trained: a config file says the method by its tag.

use std::path::{Path, PathBuf};

use farsight_train::config::read_method;
use farsight_train::training::{Callback, FileOptions, TrainError, fit_file};

use crate::centernet3d::train::CenterNet3dTask;
use crate::plate_reader::train::PlateReaderTask;
use crate::refiner::train::RefinerTask;
use crate::smoke::train::SmokeTask;

/// Trains what the config in a file is of.
type TrainFile = fn(&Path, &FileOptions, &mut dyn Callback) -> Result<PathBuf, TrainError>;

/// The methods, by their tags.
pub const METHODS: [(&str, TrainFile); 4] = [
    ("smoke", fit_file::<SmokeTask>),
    ("centernet3d", fit_file::<CenterNet3dTask>),
    ("refiner", fit_file::<RefinerTask>),
    ("plate_reader", fit_file::<PlateReaderTask>),
];

/// Trains the method that the config file at `path` names. Returns the path of the model.
///
/// # Errors
/// When the file names no method that is known here, and as [`farsight_train::training::fit`].
pub fn train(path: &Path, options: &FileOptions, callback: &mut dyn Callback) -> Result<PathBuf, TrainError> {
    let method = read_method(path, &METHODS.map(|(tag, _)| tag))?;
    let train = METHODS.iter().find(|(tag, _)| *tag == method).map(|(_, train)| train);
    let train = train.unwrap_or_else(|| unreachable!("a method that is known"));
    train(path, options, callback)
}

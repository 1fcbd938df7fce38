//! Files that are given as models: those that are plainly none are told for what they are, before somebody tries to
//! read them as one.

use std::fs;
use std::io::ErrorKind;
use std::path::Path;

use farsight_graph::model::{METHOD_KEY, ModelError, NetworkConfig, method_of};
use farsight_graph::weights::{FILE_SHA256_KEY, Weights};
use farsight_methods::camera_estimator::CameraEstimatorModel;
use farsight_methods::description::is_detector;
use farsight_methods::method::ModelTaker;
use farsight_methods::plate_reader::PlateReaderModel;
use farsight_methods::refiner::RefinerModel;
use farsight_methods::smoke::{SmokeConfig, SmokeModel};
use farsight_methods::ssd::SsdConfig;
use farsight_methods::with_detector;
use farsight_onnx::{OnnxModel, is_safetensors};

use crate::Error;
use crate::file_kind::{signature, start_of};
use crate::shipped::{self, Family};

/// The word for what comes with the library and is used unless something else is named, where the name of a file is
/// expected. A file that is called so is named with its folder, `./shipped`.
pub const SHIPPED: &str = "shipped";

/// The word for the shipped plate reader, where a model of any kind is expected.
pub const SHIPPED_PLATES: &str = "shipped-plates";

/// The word for the shipped camera estimator, likewise.
pub const SHIPPED_CAMERA: &str = "shipped-camera";

/// The family whose detector `path` is the word for.
pub fn shipped_detector(path: &Path) -> Option<Family> {
    match path.to_str()? {
        SHIPPED => Some(Family::default()),
        word => Family::ALL.into_iter().find(|family| family.name() == word),
    }
}

/// The family whose refiner `path` is the word for, where a model of any kind is expected.
pub fn shipped_refiner(path: &Path) -> Option<Family> {
    shipped_detector(Path::new(path.to_str()?.strip_suffix("-refiner")?))
}

/// Whether the file may be what is `expected`.
///
/// # Errors
/// When it is plainly something else.
pub fn check(path: &Path, expected: &str) -> Result<(), Error> {
    found_instead(path).map_or(Ok(()), |found| Err(kind_error(path, found, expected)))
}

pub(crate) fn kind_error(path: &Path, found: impl Into<String>, expected: impl Into<String>) -> Error {
    Error::Kind { path: path.to_owned(), found: found.into(), expected: expected.into() }
}

/// Whether the file is a model without the hash that files of ours carry since they do. One with a hash is checked when
/// it is read.
pub fn lacks_hash(path: &Path) -> bool {
    match is_safetensors(path) {
        Ok(true) => Weights::read_metadata(path).is_ok_and(|facts| !facts.contains_key(FILE_SHA256_KEY)),
        Ok(false) => OnnxModel::read(path).is_ok_and(|model| !model.has_hash()),
        Err(_) => false,
    }
}

/// What to tell of a model file that [`lacks_hash`].
pub fn hash_note(path: &Path) -> Option<String> {
    lacks_hash(path).then(|| format!("{}: has no hash, so damage to it would not be noticed", path.display()))
}

/// Whether the file may be a detector.
///
/// # Errors
/// When it is plainly something else.
pub fn check_detector(path: &Path) -> Result<(), Error> {
    check(path, "a model that `farsight train`, `farsight import` or `farsight export` wrote")?;
    if RefinerModel::is_one(path) {
        return Err(kind_error(path, "a refiner", "a detector, name it with --refiner"));
    }
    if PlateReaderModel::is_one(path) {
        return Err(kind_error(path, "a plate reader", "a detector, name it with --plates"));
    }
    if CameraEstimatorModel::is_one(path) {
        return Err(kind_error(path, "a camera estimator", "a detector; the shipped estimator runs with --hfov auto"));
    }
    Ok(())
}

/// Reads a SMOKE's model file of our own, or the shipped one by its word.
///
/// # Errors
/// When the file is none; what `farsight export` made of one is told.
pub fn read_own(path: &Path) -> Result<SmokeModel, Error> {
    match shipped_detector(path) {
        Some(Family::FarsightS) => return Ok(shipped::smoke()?),
        Some(Family::FarsightN) => return Ok(shipped::small_smoke()?),
        Some(Family::FarsightW) => {
            let found = <SsdConfig as NetworkConfig>::NAME;
            return Err(kind_error(
                path,
                found,
                "a SMOKE, \"farsight-s\" or \"farsight-n\" for those that come with the program",
            ));
        }
        None => {}
    }
    Ok(SmokeModel::from_weights(own_weights(path)?, path)?)
}

/// Gives `taker` a detector of our own, whatever its method: a model file, or a shipped one by its word.
///
/// # Errors
/// When the file is none; what `farsight export` made of one is told.
pub fn with_own<T: ModelTaker>(path: &Path, taker: T) -> Result<T::Answer, Error> {
    match shipped_detector(path) {
        Some(Family::FarsightS) => return Ok(taker.take(shipped::smoke()?)),
        Some(Family::FarsightN) => return Ok(taker.take(shipped::small_smoke()?)),
        Some(Family::FarsightW) => return Ok(taker.take(shipped::ssd()?)),
        None => {}
    }
    let weights = own_weights(path)?;
    let found = format!("a model of the method \"{}\"", method_of(&weights));
    with_detector(weights, path, taker)?.ok_or_else(|| kind_error(path, found, "a detector"))
}

/// Whether `path` is no SMOKE but a detector of another method.
pub fn is_other_detector(path: &Path) -> bool {
    if let Some(family) = shipped_detector(path) {
        return family == Family::FarsightW;
    }
    let metadata = Weights::read_metadata(path).unwrap_or_default();
    metadata.get(METHOD_KEY).is_some_and(|tag| tag != SmokeConfig::METHOD && is_detector(tag))
}

/// The weights of a model file of our own.
fn own_weights(path: &Path) -> Result<Weights, Error> {
    check(path, "a model that `farsight train` or `farsight import` wrote")?;
    Weights::read(path).map_err(|error| match OnnxModel::read(path) {
        Ok(_) => kind_error(path, "an ONNX file already", "the model that it was made from (.safetensors)"),
        Err(_) => ModelError::from(error).into(),
    })
}

fn found_instead(path: &Path) -> Option<String> {
    let failed = |error: std::io::Error| match error.kind() {
        ErrorKind::NotFound => "no such file".to_owned(),
        _ => format!("cannot be read: {error}"),
    };
    let there = match fs::metadata(path) {
        Ok(there) if there.is_dir() => return Some("a folder".to_owned()),
        Ok(there) => there,
        Err(error) => return Some(failed(error)),
    };
    if !there.is_file() {
        return Some("no regular file".to_owned());
    }
    match start_of(path) {
        Err(error) => Some(failed(error)),
        Ok(start) => kind(path, &start).map(str::to_owned),
    }
}

fn kind(path: &Path, start: &[u8]) -> Option<&'static str> {
    if path.extension().is_some_and(|extension| extension == "toml") {
        return Some("a TOML file");
    }
    signature(start)
}

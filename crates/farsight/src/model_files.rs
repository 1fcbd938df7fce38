//! Files that are given as models: those that are plainly none are told for what they are, before somebody tries to read them as one.

use std::fs;
use std::io::ErrorKind;
use std::path::Path;

use anyhow::{Result, bail, ensure};
use farsight_methods::plate_reader::PlateReaderModel;
use farsight_methods::refiner::RefinerModel;
use farsight_methods::smoke::SmokeModel;
use farsight_onnx::OnnxModel;

use crate::outputs::start_of;

/// How files begin that are often at hand and are no models.
const SIGNATURES: [(&[u8], &str); 3] = [
    (b"\x89PNG", "a PNG image"),
    (b"\xff\xd8\xff", "a JPEG image"),
    (b"PK\x03\x04", "a ZIP archive, as PyTorch's checkpoints are, which `farsight import` reads"),
];

/// Whether the file may be what is `expected`.
pub(crate) fn check(path: &Path, expected: &str) -> Result<()> {
    match found_instead(path) {
        Some(found) => bail!("{}: {found}; expected {expected}", path.display()),
        None => Ok(()),
    }
}

/// Whether the file may be a detector.
pub(crate) fn check_detector(path: &Path) -> Result<()> {
    check(path, "a model that `farsight train`, `farsight import` or `farsight export` wrote")?;
    let is_refiner = RefinerModel::is_one(path);
    ensure!(!is_refiner, "{}: a refiner; expected a detector, name it with --refiner", path.display());
    let is_plate_reader = PlateReaderModel::is_one(path);
    ensure!(!is_plate_reader, "{}: a plate reader; expected a detector, name it with --plates", path.display());
    Ok(())
}

/// Reads a model of our own; what `farsight export` made of one is worth a word.
pub(crate) fn read_own(path: &Path) -> Result<SmokeModel> {
    check(path, "a model that `farsight train` or `farsight import` wrote")?;
    SmokeModel::read(path).or_else(|error| match OnnxModel::read(path) {
        Ok(_) => {
            bail!("{}: an ONNX file already; expected the model that it was made from (.safetensors)", path.display())
        }
        Err(_) => Err(error.into()),
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

/// What a file is that begins like this, when it is an image or an archive.
pub(crate) fn signature(start: &[u8]) -> Option<&'static str> {
    SIGNATURES.iter().find(|(signature, _)| start.starts_with(signature)).map(|(_, kind)| *kind)
}

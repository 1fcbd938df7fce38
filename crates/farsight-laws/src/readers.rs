//! The readers of files by name, for tests of what they take.

use std::path::Path;

use farsight::video::EgoFile;
use farsight_data::annotations::{Annotations, FileFormat, Plates};
use farsight_data::{ClassMap, Exif, ImageLimits, load_image};
use farsight_eval::tracks::read_sequence;
use farsight_graph::weights::Weights;
use farsight_methods::ssd;
use farsight_onnx::OnnxModel;

use crate::answers::{answers_of, manifest, told_tracks};
use crate::experiment::{plan::Experiment, results::Results};
use crate::text::{untrained, world};

/// Reads a file; an error is told in words.
pub type Read = fn(&Path) -> Result<(), String>;

/// A reader, what its files are called, and how it reads one.
#[derive(Debug, Clone, Copy)]
pub struct Reader {
    /// What it reads.
    pub name: &'static str,
    /// How such a file is called.
    pub file: &'static str,
    /// Reads one.
    pub read: Read,
}

const fn reader(name: &'static str, file: &'static str, read: Read) -> Reader {
    Reader { name, file, read }
}

fn told<T, E: std::fmt::Display>(read: Result<T, E>) -> Result<(), String> {
    read.map(drop).map_err(|error| format!("{error:#}"))
}

/// Readers of text.
pub const TEXT: &[Reader] = &[
    reader("class map", "classes.txt", |path| told(ClassMap::read(path))),
    reader("tracking labels", "0000.txt", |path| told(read_sequence(path, None))),
    reader("camera's motion", "ego.csv", |path| told(EgoFile::read(path))),
    reader("number plates", "plates/000000.txt", |path| {
        let folder = path.parent().and_then(Path::parent).unwrap_or(path);
        told(FileFormat::of::<Plates>().read(folder, "000000", &mut Annotations::default()))
    }),
    reader("scene config", "world.toml", |path| told(world::read_config(path))),
    reader("training config", "run.toml", |path| told(untrained::read(path))),
    reader("experiment's plan", "plan.toml", |path| told(Experiment::read(path))),
    reader("experiment's results", "results.json", |path| told(Results::read(path))),
    reader("answers", "answers.json", |path| told(answers_of(path))),
    reader("answers by lines", "answers.jsonl", |path| told(answers_of(path))),
    reader("tracks", "tracks.jsonl", |path| told(told_tracks::told(path))),
    reader("manifest", "manifest.json", |path| told(manifest(path.parent().unwrap_or(path)))),
];

/// Readers of other files.
pub const BINARY: &[Reader] = &[
    reader("safetensors, header", "m.safetensors", |path| told(Weights::read_metadata(path))),
    reader("safetensors", "m.safetensors", |path| told(Weights::read(path))),
    reader("pickle", "m.pth", |path| told(farsight_import::read_pth(path))),
    reader("TFLite", "m.tflite", |path| told(ssd::import::import(path))),
    reader("ONNX", "m.onnx", |path| told(OnnxModel::read(path))),
    reader("image", "photo.jpg", |path| told(load_image(path, ImageLimits::default()))),
    reader("EXIF", "exif", |path| told(std::fs::read(path).map(|bytes| Exif::from_bytes(&bytes)))),
];

//! Laws of files of weights: every tensor is as long as its shape says, every number of a model is finite, and a model
//! that is written is read again.

use std::path::Path;

use farsight_graph::model::{Model, NetworkConfig};
use farsight_graph::weights::{WeightTensor, Weights};
use farsight_import::read_pth;
use farsight_import::tflite::read_convolutions;
use farsight_methods::each_detector;
use farsight_methods::method::{DetectorMethod, DetectorVisitor};
use farsight_methods::plate_reader::PlateReaderConfig;
use farsight_methods::refiner::RefinerConfig;
use farsight_methods::smoke::import::{ImportOptions, import};
use farsight_methods::ssd;

use crate::text::{accepted, as_file};

/// A model file of a detector, of every method.
pub(crate) fn detector(bytes: &[u8]) -> bool {
    let mut models = Models { bytes, accepted: false };
    each_detector(&mut models);
    models.accepted
}

struct Models<'a> {
    bytes: &'a [u8],
    /// Whether it is a model of any method.
    accepted: bool,
}

impl DetectorVisitor for Models<'_> {
    fn visit<C: DetectorMethod>(&mut self) {
        self.accepted |= model::<C>(self.bytes);
    }
}

/// A model file of a refiner.
pub(crate) fn refiner(bytes: &[u8]) -> bool {
    model::<RefinerConfig>(bytes)
}

/// A model file of a plate reader.
pub(crate) fn plate_reader(bytes: &[u8]) -> bool {
    model::<PlateReaderConfig>(bytes)
}

fn model<C: NetworkConfig>(bytes: &[u8]) -> bool {
    let path = Path::new("input.safetensors");
    let Some(model) = accepted(Model::<C>::from_safetensors(bytes, path), path) else { return false };
    assert!(model.config.problem().is_none());
    whole(model.weights.tensors.values());
    model.weights.check_finite(path).expect("what was accepted");
    let mut written = Vec::new();
    model.weights.write_safetensors(&mut written).expect("memory takes all");
    let again = Weights::from_safetensors(&written, path).expect("what was written");
    assert_eq!(again, model.weights);
    true
}

/// A checkpoint of `PyTorch`, in the zip layout or the legacy one, through a file as users have it.
pub(crate) fn pickle(bytes: &[u8]) -> bool {
    let (_folder, path) = as_file("input.pth", bytes);
    let Some(tensors) = accepted(read_pth(&path), &path) else { return false };
    whole(tensors.values());
    // Whatever tensors it has: a model, or an error that names the file.
    accepted(import(&path, ImportOptions::default()), &path);
    true
}

/// A `TFLite` file, and as users have it.
pub(crate) fn tflite(bytes: &[u8]) -> bool {
    let (_folder, path) = as_file("input.tflite", bytes);
    accepted(ssd::import::import(&path), &path);
    accepted(import(&path, ImportOptions::default()), &path);
    let Ok(tensors) = read_convolutions(bytes) else { return false };
    whole(tensors.values());
    true
}

fn whole<'a>(tensors: impl Iterator<Item = &'a WeightTensor>) {
    for tensor in tensors {
        assert_eq!(tensor.shape.iter().product::<usize>(), tensor.values.len());
    }
}

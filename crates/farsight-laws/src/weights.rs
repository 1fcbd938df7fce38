//! Laws of files of weights: every tensor is as long as its shape says, every number of a model is finite, and a model
//! that is written is read again.

use std::path::Path;

use farsight_graph::model::{Model, NetworkConfig};
use farsight_graph::weights::{WeightTensor, Weights};
use farsight_import::tensors_from_pth;
use farsight_import::tflite::read_convolutions;
use farsight_methods::each_detector;
use farsight_methods::method::{DetectorMethod, DetectorVisitor};
use farsight_methods::plate_reader::PlateReaderConfig;
use farsight_methods::refiner::RefinerConfig;

/// A model file of a detector, of every method.
pub(crate) fn detector(bytes: &[u8]) {
    each_detector(&mut Models(bytes));
}

struct Models<'a>(&'a [u8]);

impl DetectorVisitor for Models<'_> {
    fn visit<C: DetectorMethod>(&mut self) {
        model::<C>(self.0);
    }
}

/// A model file of a refiner.
pub(crate) fn refiner(bytes: &[u8]) {
    model::<RefinerConfig>(bytes);
}

/// A model file of a plate reader.
pub(crate) fn plate_reader(bytes: &[u8]) {
    model::<PlateReaderConfig>(bytes);
}

fn model<C: NetworkConfig>(bytes: &[u8]) {
    let path = Path::new("input.safetensors");
    match Model::<C>::from_safetensors(bytes, path) {
        Ok(model) => {
            assert!(model.config.problem().is_none());
            whole(model.weights.tensors.values());
            model.weights.check_finite(path).expect("what was accepted");
            let mut written = Vec::new();
            model.weights.write_safetensors(&mut written).expect("memory takes all");
            let again = Weights::from_safetensors(&written, path).expect("what was written");
            assert_eq!(again, model.weights);
        }
        Err(error) => assert!(error.to_string().contains("input.safetensors"), "no file in: {error}"),
    }
}

/// A checkpoint of `PyTorch`, in the zip layout or the legacy one.
pub(crate) fn pickle(bytes: &[u8]) {
    if let Ok(tensors) = tensors_from_pth(bytes) {
        whole(tensors.values());
    }
}

/// A `TFLite` file.
pub(crate) fn tflite(bytes: &[u8]) {
    if let Ok(tensors) = read_convolutions(bytes) {
        whole(tensors.values());
    }
}

fn whole<'a>(tensors: impl Iterator<Item = &'a WeightTensor>) {
    for tensor in tensors {
        assert_eq!(tensor.shape.iter().product::<usize>(), tensor.values.len());
    }
}

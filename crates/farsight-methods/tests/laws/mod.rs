//! What must hold for any bytes in a model file: nothing panics, and what is accepted can be used. The fuzz target and
//! the replay of its saved inputs share this.
#![allow(unreachable_pub)] // Each user is a crate of its own.

use std::path::Path;

use farsight_graph::model::NetworkConfig;
use farsight_graph::weights::Weights;
use farsight_methods::smoke::{DetectorFile, REGRESSION};
use farsight_onnx::LocalHeadFile;

/// Any bytes as a model file, of either kind.
pub fn model(bytes: &[u8]) -> bool {
    let path = Path::new("fuzz");
    let read = DetectorFile::from_bytes(bytes.to_vec(), path);
    if let Err(error) = &read {
        assert!(error.to_string().starts_with("fuzz: "), "no file in: {error}");
    }
    let is_accepted = read.is_ok();
    if let Ok(model) = read {
        assert!(model.config.problem().is_none());
        if let Ok(Some(cut)) = LocalHeadFile::new(&model.onnx, REGRESSION, path) {
            let [hidden, channels] = [cut.hidden.weight.shape[0], cut.hidden.weight.shape[1]];
            assert_eq!(cut.hidden.bias.values.len(), hidden);
            assert_eq!(cut.output.weight.values.len(), 8 * hidden);
            assert!(cut.hidden.weight.values.len() >= hidden * channels);
        }
    }
    if let Ok(weights) = Weights::from_safetensors(bytes, path) {
        for tensor in weights.tensors.values() {
            assert_eq!(tensor.shape.iter().product::<usize>(), tensor.values.len());
        }
    }
    is_accepted
}

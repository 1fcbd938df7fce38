//! Reading the reference tensors.

use std::collections::BTreeMap;
use std::path::PathBuf;

use safetensors::{Dtype, SafeTensors};
use tch::Tensor;

/// Tensors of a reference file by name; integers become floats.
pub(crate) type Golden = BTreeMap<String, Tensor>;

/// The reference file `name`; `None`, with a printed reason, where the folder is not there.
pub(crate) fn golden(name: &str) -> Option<Golden> {
    let default = || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/golden"));
    let folder = std::env::var_os("FARSIGHT_GOLDEN").map_or_else(default, PathBuf::from);
    let path = folder.join(format!("{name}.safetensors"));
    let Ok(bytes) = std::fs::read(&path) else {
        println!("skipped: no {} (set FARSIGHT_GOLDEN to the folder of reference tensors)", path.display());
        return None;
    };
    let file = SafeTensors::deserialize(&bytes).unwrap();
    Some(file.iter().map(|(name, view)| (name.to_owned(), tensor_from_view(&view))).collect())
}

fn tensor_from_view(view: &safetensors::tensor::TensorView<'_>) -> Tensor {
    let shape: Vec<i64> = view.shape().iter().map(|&s| s as i64).collect();
    let values: Vec<f32> = match view.dtype() {
        Dtype::F32 => view.data().as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect(),
        Dtype::I64 => view.data().as_chunks::<8>().0.iter().map(|b| i64::from_le_bytes(*b) as f32).collect(),
        other => panic!("unexpected dtype {other:?}"),
    };
    Tensor::from_slice(&values).view(shape.as_slice())
}

/// The largest absolute difference.
pub(crate) fn largest_difference(found: &Tensor, expected: &Tensor) -> f64 {
    assert_eq!(found.size(), expected.size());
    (found - expected).abs().max().double_value(&[])
}

/// Fails, saying which and by how much, when `found` is further than `tolerance` from `expected`.
pub(crate) fn assert_close(what: &str, found: &Tensor, expected: &Tensor, tolerance: f64) {
    let difference = largest_difference(found, expected);
    assert!(difference <= tolerance, "{what}: differs by {difference:e}, tolerance {tolerance:e}");
}

/// Rounding of single precision where the true value is zero: the gradient of a bias that a norm takes out again, for instance.
const ZERO_FLOOR: f64 = 1e-5;

/// As [`assert_close`], with the tolerance relative to the largest value expected.
pub(crate) fn assert_close_relative(what: &str, found: &Tensor, expected: &Tensor, tolerance: f64) {
    let scale = expected.abs().max().double_value(&[]);
    assert_close(what, found, expected, (tolerance * scale).max(ZERO_FLOOR));
}

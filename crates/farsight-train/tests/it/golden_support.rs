//! Reference tensors as tensors of libtorch, and how ours are compared with them.

use std::collections::BTreeMap;

use farsight_testing::Array;
use tch::{Kind, Tensor};

/// Tensors of a reference file by name, in double precision.
pub(crate) type Golden = BTreeMap<String, Tensor>;

/// In double precision, as a share of the largest value. The reference is stored in single precision: 6e-8.
pub(crate) const EXACT: f64 = 1e-6;

/// What double precision leaves where the true value is zero: the gradient of a bias that a norm takes out again.
const ZERO_FLOOR: f64 = 1e-10;

/// The committed reference file `name`.
pub(crate) fn golden(name: &str) -> Golden {
    tensors(&farsight_testing::Golden::open(name))
}

/// A reference file that is too large to be committed; `None` where it is not there.
pub(crate) fn large_golden(name: &str) -> Option<Golden> {
    farsight_testing::Golden::open_large(name).as_ref().map(tensors)
}

fn tensors(golden: &farsight_testing::Golden) -> Golden {
    let tensor = |array: &Array| {
        let shape: Vec<i64> = array.shape.iter().map(|&side| side as i64).collect();
        Tensor::from_slice(&array.values).view(shape.as_slice())
    };
    golden.iter().map(|(name, array)| (name.to_owned(), tensor(array))).collect()
}

/// The reference's values that are stored, and ours in the same places.
pub(crate) fn known(found: &Tensor, expected: &Tensor) -> [Tensor; 2] {
    assert_eq!(found.size(), expected.size());
    let known = expected.isnan().logical_not();
    [found, expected].map(|tensor| tensor.to_kind(Kind::Double).masked_select(&known))
}

/// Fails, saying which and by how much, when `found` is further than `tolerance` from `expected`.
#[track_caller]
pub(crate) fn assert_close(what: &str, found: &Tensor, expected: &Tensor, tolerance: f64) {
    let [found, expected] = known(found, expected);
    let difference = (found - expected).abs().max().double_value(&[]);
    assert!(difference <= tolerance, "{what}: differs by {difference:e}, tolerance {tolerance:e}");
}

/// As [`assert_close`], with the tolerance relative to the largest value expected, but at least `floor`.
#[track_caller]
pub(crate) fn assert_close_relative(what: &str, found: &Tensor, expected: &Tensor, tolerance: f64, floor: f64) {
    let scale = known(found, expected)[1].abs().max().double_value(&[]);
    assert_close(what, found, expected, (tolerance * scale).max(floor));
}

/// Double precision: as far as [`EXACT`] says.
#[track_caller]
pub(crate) fn assert_exact(what: &str, found: &Tensor, expected: &Tensor) {
    assert_eq!(found.kind(), Kind::Double, "{what}");
    assert_close_relative(what, found, expected, EXACT, ZERO_FLOOR);
}

/// A copy to differentiate with respect to.
pub(crate) fn leaf(tensor: &Tensor) -> Tensor {
    tensor.copy().set_requires_grad(true)
}

/// Gradients of the sum of `output` times `direction`, summed over all pairs.
pub(crate) fn gradients_along(pairs: &[(&Tensor, &Tensor)], leaves: &[Tensor]) -> Vec<Tensor> {
    let objective: Tensor = pairs.iter().map(|(output, direction)| (*output * *direction).sum(Kind::Double)).sum();
    Tensor::run_backward(&[objective], leaves, false, false)
}

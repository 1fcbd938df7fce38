//! Losses that several methods share.

use tch::Tensor;

use crate::executor::wide_kind;

/// Bounds of the probability in the focal loss (spec section 4).
const PROBABILITY_LIMITS: (f64, f64) = (1e-4, 1.0 - 1e-4);

/// Penalty-reduced focal loss of `logits` against the heatmap `target`, alpha 2, beta 4 (spec 7.1).
///
/// Normalised by the number of cells equal to 1 in the whole batch; without any, the sum is not normalised, as in
/// official SMOKE.
pub fn focal_loss(logits: &Tensor, target: &Tensor) -> Tensor {
    let (low, high) = PROBABILITY_LIMITS;
    let kind = wide_kind(logits.kind());
    let probability = logits.to_kind(kind).sigmoid().clamp(low, high);
    let complement = Tensor::from(1.0_f32) - &probability;
    let positive = target.eq(1.0).to_kind(kind);
    let negative_weight = (Tensor::from(1.0_f32) - target).pow_tensor_scalar(4);
    let positive_terms = probability.log() * complement.square() * &positive;
    // At a positive cell the weight (1 - 1)^4 is zero already.
    let negative_terms = complement.log() * probability.square() * negative_weight;
    let count = positive.sum(kind).clamp_min(1.0);
    (positive_terms + negative_terms).sum(kind).neg() / count
}

//! SMOKE's loss: focal loss on the heat map, disentangled corner loss on the regression (spec section 7).

use farsight_core::codec::CHANNELS;
use farsight_core::corner_loss::corner_loss;
use farsight_core::targets::Targets;
use farsight_core::{Camera, Codec};
use serde::Serialize;
use tch::{Device, Kind, Tensor};

/// Bounds of the probability in the focal loss (spec section 4).
const PROBABILITY_LIMITS: (f64, f64) = (1e-4, 1.0 - 1e-4);

/// Official SMOKE divides the corner loss of a GPU's 8 images by 10 * 30; ours divides by 300 for every 8 images, so
/// that the balance with the heat map does not depend on the batch size (spec 7.2).
pub const CORNER_DIVISOR_PER_IMAGE: f64 = 10.0 * 30.0 / 8.0;

/// The terms of one batch's loss.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct LossTerms {
    /// Focal loss of the heat map.
    pub heat_map: f64,
    /// Corner loss with the predicted yaw.
    pub orientation: f64,
    /// Corner loss with the predicted dimensions.
    pub dimensions: f64,
    /// Corner loss with the predicted location.
    pub location: f64,
}

impl LossTerms {
    /// What is minimised.
    pub fn total(&self) -> f64 {
        self.heat_map + self.orientation + self.dimensions + self.location
    }

    /// The terms by name.
    pub fn named(&self) -> [(&'static str, f64); 4] {
        [
            ("heat_map", self.heat_map),
            ("orientation", self.orientation),
            ("dimensions", self.dimensions),
            ("location", self.location),
        ]
    }
}

/// How much each object counts in the corner loss.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CornerWeights {
    /// Everything is divided by this.
    pub divisor: f64,
    /// Objects farther than this, metres, count in inverse proportion to their distance: their relative error is what matters.
    pub full_weight_m: Option<f64>,
}

impl CornerWeights {
    /// SMOKE's: all objects count the same.
    pub fn alike(divisor: f64) -> Self {
        Self { divisor, full_weight_m: None }
    }

    /// The factor on the loss of an object at this depth.
    pub fn factor(&self, depth_m: f64) -> f64 {
        self.full_weight_m.map_or(1.0, |full| (full / depth_m.max(full)).min(1.0)) / self.divisor
    }
}

/// What to learn from a batch.
#[derive(Debug)]
pub struct BatchTargets {
    /// Heat maps `[batch, classes, height, width]`.
    pub heat_map: Tensor,
    /// Objects that the regression learns from, with the number of their image.
    pub objects: Vec<(usize, farsight_core::targets::ObjectTarget)>,
    /// Camera of each image's feature map.
    pub cameras: Vec<Camera>,
    /// Width and height of the feature map, cells.
    pub map_size: [usize; 2],
}

impl BatchTargets {
    /// Joins the targets of several images; `regress[i]` says whether image `i` trains the regression.
    pub fn new(images: &[Targets], regress: &[bool], device: Device) -> Self {
        let map_size @ [width, height] = images.first().map_or([0, 0], |t| t.map_size);
        let values: Vec<f32> = images.iter().flat_map(|t| &t.heat_map).copied().collect();
        let shape = [images.len() as i64, -1, height as i64, width as i64];
        let objects = images.iter().enumerate().filter(|&(i, _)| regress[i]);
        Self {
            heat_map: Tensor::from_slice(&values).view(shape).to_device(device),
            objects: objects.flat_map(|(i, t)| t.objects.iter().map(move |o| (i, o.clone()))).collect(),
            cameras: images.iter().map(|t| t.camera).collect(),
            map_size,
        }
    }
}

/// Penalty-reduced focal loss of `logits` against the heat map `target`, alpha 2, beta 4 (spec 7.1).
///
/// Normalised by the number of cells equal to 1 in the whole batch; without any, the sum is not normalised, as in official SMOKE.
pub fn focal_loss(logits: &Tensor, target: &Tensor) -> Tensor {
    let (low, high) = PROBABILITY_LIMITS;
    let probability = logits.to_kind(Kind::Float).sigmoid().clamp(low, high);
    let complement = Tensor::from(1.0_f32) - &probability;
    let positive = target.eq(1.0).to_kind(Kind::Float);
    let negative_weight = (Tensor::from(1.0_f32) - target).pow_tensor_scalar(4);
    let positive_terms = probability.log() * complement.square() * &positive;
    // At a positive cell the weight (1 - 1)^4 is zero already.
    let negative_terms = complement.log() * probability.square() * negative_weight;
    let count = positive.sum(Kind::Float).clamp_min(1.0);
    (positive_terms + negative_terms).sum(Kind::Float).neg() / count
}

/// The loss of a batch as a tensor to differentiate, and its terms.
///
/// The corner loss is computed by `farsight-core` on the few cells that hold objects, with its exact gradient; the tensor returned has
/// that gradient (its value is not the loss: read the terms).
///
/// # Shapes
/// `logits` `[batch, classes, height, width]`, `regression` `[batch, 8, height, width]`.
pub fn loss(
    codec: &Codec,
    logits: &Tensor,
    regression: &Tensor,
    targets: &BatchTargets,
    weights: CornerWeights,
) -> (Tensor, LossTerms) {
    let heat_map = focal_loss(logits, &targets.heat_map);
    let raw = regression_at_objects(regression, targets);
    let values = crate::executor::values_from_tensor(&raw);

    let mut gradient = Vec::with_capacity(values.len());
    let mut terms = LossTerms { heat_map: 0.0, orientation: 0.0, dimensions: 0.0, location: 0.0 };
    for ((image, object), raw) in targets.objects.iter().zip(values.as_chunks::<CHANNELS>().0) {
        let part = corner_loss(codec, raw.map(f64::from), object, &targets.cameras[*image]);
        let factor = weights.factor(object.box3d.depth_m());
        terms.orientation += part.orientation * factor;
        terms.dimensions += part.dimensions * factor;
        terms.location += part.location * factor;
        gradient.extend(part.gradient.map(|g| (g * factor) as f32));
    }
    let gradient = Tensor::from_slice(&gradient).view([-1, CHANNELS as i64]).to_device(raw.device());
    terms.heat_map = heat_map.double_value(&[]);
    (heat_map + (raw * gradient).sum(Kind::Float), terms)
}

/// The raw channels at the cells of the objects, `[objects, 8]`.
fn regression_at_objects(regression: &Tensor, targets: &BatchTargets) -> Tensor {
    let [width, height] = targets.map_size;
    let cell = |(image, object): &(usize, farsight_core::targets::ObjectTarget)| {
        (image * width * height + object.cell[1] * width + object.cell[0]) as i64
    };
    let cells: Vec<i64> = targets.objects.iter().map(cell).collect();
    let cells = Tensor::from_slice(&cells).to_device(regression.device());
    let by_cell = regression.to_kind(Kind::Float).permute([0, 2, 3, 1]).reshape([-1, CHANNELS as i64]);
    by_cell.index_select(0, &cells)
}

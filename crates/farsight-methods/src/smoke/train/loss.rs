//! SMOKE's loss: focal loss on the heatmap, disentangled corner loss on the regression (spec section 7). And an
//! auxiliary loss in depth that rendered scenes allow.

use std::collections::HashSet;

use crate::smoke::codec::CHANNELS;
use crate::smoke::corner_loss::{CornerLoss, corner_loss};
use crate::smoke::targets::{ObjectTarget, Targets};
use farsight_core::Camera;
use serde::Serialize;
use tch::{Device, Tensor};

use crate::smoke::Codec;
use farsight_train::executor::{doubles_from_tensor, wide_kind};
use farsight_train::losses::focal_loss;
use farsight_train::metrics::Metrics;

/// Official SMOKE divides the corner loss of a GPU's 8 images by 10 * 30; ours divides by 300 for every 8 images, so
/// that the balance with the heatmap does not depend on the batch size (spec 7.2).
pub const CORNER_DIVISOR_PER_IMAGE: f64 = 10.0 * 30.0 / 8.0;

/// The terms of one batch's loss.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct LossTerms {
    /// Focal loss of the heatmap.
    pub heatmap: f64,
    /// Corner loss with the predicted yaw.
    pub orientation: f64,
    /// Corner loss with the predicted dimensions.
    pub dimensions: f64,
    /// Corner loss with the predicted location.
    pub location: f64,
    /// Corner loss of the predicted box as the image shows it.
    pub image: f64,
    /// Error of the surface's depth; zero where it is not learnt.
    pub surface: f64,
}

impl LossTerms {
    /// What is minimised.
    pub fn total(&self) -> f64 {
        self.named().iter().map(|(_, value)| value).sum()
    }
}

impl Metrics for LossTerms {
    const SAMPLES: &'static str = "images";

    fn named(&self) -> Vec<(&'static str, f64)> {
        vec![
            ("heatmap", self.heatmap),
            ("orientation", self.orientation),
            ("dimensions", self.dimensions),
            ("location", self.location),
            ("image", self.image),
            ("surface", self.surface),
        ]
    }

    fn zip_with(&self, other: &Self, joined: impl Fn(f64, f64) -> f64) -> Self {
        Self {
            heatmap: joined(self.heatmap, other.heatmap),
            orientation: joined(self.orientation, other.orientation),
            dimensions: joined(self.dimensions, other.dimensions),
            location: joined(self.location, other.location),
            image: joined(self.image, other.image),
            surface: joined(self.surface, other.surface),
        }
    }
}

/// How much each object, and each part of it, counts in the corner loss.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CornerWeights {
    /// Everything is divided by this.
    pub divisor: f64,
    /// Objects farther than this, metres, count in inverse proportion to their distance: their relative error is what
    /// matters.
    pub full_weight_m: Option<f64>,
    /// Factor on the part of the orientation. A wrong depth moves the corners by far more than a wrong heading or a
    /// wrong size, so its gradient rules the features that they share.
    pub orientation: f64,
    /// Factor on the part of the dimensions.
    pub dimensions: f64,
    /// Factor on the part of the box as the image shows it; 0 in SMOKE.
    pub image: f64,
}

impl CornerWeights {
    /// SMOKE's: all objects count the same.
    pub fn uniform(divisor: f64) -> Self {
        Self { divisor, full_weight_m: None, orientation: 1.0, dimensions: 1.0, image: 0.0 }
    }

    /// The factor on the loss of an object at this depth.
    pub fn factor(&self, depth_m: f64) -> f64 {
        self.full_weight_m.map_or(1.0, |full| (full / depth_m.max(full)).min(1.0)) / self.divisor
    }

    /// `loss` with the factors on its parts.
    fn weighted(&self, loss: &CornerLoss) -> CornerLoss {
        CornerLoss {
            orientation: loss.orientation * self.orientation,
            dimensions: loss.dimensions * self.dimensions,
            location: loss.location,
            image: loss.image * self.image,
        }
    }
}

/// What to learn from a batch.
#[derive(Debug)]
pub struct BatchTargets {
    /// Heatmaps `[batch, classes, height, width]`.
    pub heatmap: Tensor,
    /// Cells that the regression learns from.
    pub cells: Vec<RegressionCell>,
    /// Camera of each image's feature map.
    pub cameras: Vec<Camera>,
    /// Width and height of the feature map, cells.
    pub map_size: [usize; 2],
    /// Virtual depth of the surface in each cell, metres, `[batch, 1, height, width]`, infinite where there is none; if
    /// it is known.
    pub surface_m: Option<Tensor>,
}

/// A cell that the regression learns from.
#[derive(Debug, Clone, PartialEq)]
pub struct RegressionCell {
    /// Number of its image in the batch.
    pub image: usize,
    /// What is to be learnt there.
    pub object: ObjectTarget,
    /// Its part of the object's weight.
    pub share: f64,
}

impl RegressionCell {
    /// This cell and those up to `reach` away from it on the map, column and row.
    fn around(&self, reach: usize, [width, height]: [usize; 2]) -> Vec<[usize; 2]> {
        let near = |center: usize, size: usize| center.saturating_sub(reach)..(center + reach + 1).min(size);
        let [column, row] = self.object.cell;
        near(row, height).flat_map(|y| near(column, width).map(move |x| [x, y])).collect()
    }
}

impl BatchTargets {
    /// Joins the targets of several images; `regress[i]` says whether image `i` trains the regression.
    pub fn new(images: &[Targets], regress: &[bool], device: Device) -> Self {
        let map_size @ [width, height] = images.first().map_or([0, 0], |t| t.map_size);
        let values: Vec<f32> = images.iter().flat_map(|t| &t.heatmap).copied().collect();
        let shape = [images.len() as i64, -1, height as i64, width as i64];
        let regressed = images.iter().enumerate().filter(|&(i, _)| regress[i]);
        let whole = |image: usize, object: &ObjectTarget| RegressionCell { image, object: object.clone(), share: 1.0 };
        Self {
            heatmap: Tensor::from_slice(&values).view(shape).to_device(device),
            cells: regressed.flat_map(|(i, t)| t.objects.iter().map(move |object| whole(i, object))).collect(),
            cameras: images.iter().map(|t| t.camera).collect(),
            map_size,
            surface_m: None,
        }
    }

    /// The same objects, each learnt at its own cell and at those up to `reach` cells away, which share its weight: a
    /// peak that is a cell off then finds an answer too. Cells that are another object's own are left to it.
    pub fn with_neighbours(self, reach: usize) -> Self {
        let own: HashSet<(usize, [usize; 2])> = self.cells.iter().map(|cell| (cell.image, cell.object.cell)).collect();
        let spread = |cell: &RegressionCell| -> Vec<RegressionCell> {
            let mut places = cell.around(reach, self.map_size);
            places.retain(|&place| place == cell.object.cell || !own.contains(&(cell.image, place)));
            let share = cell.share / places.len() as f64;
            let at = |place| ObjectTarget { cell: place, ..cell.object.clone() };
            places.into_iter().map(|place| RegressionCell { image: cell.image, object: at(place), share }).collect()
        };
        Self { cells: self.cells.iter().flat_map(spread).collect(), ..self }
    }

    /// With the virtual depth of the surfaces, metres, one list of cells an image.
    pub fn with_surface(self, surface_m: &[Vec<f32>]) -> Self {
        let [width, height] = self.map_size.map(|side| side as i64);
        let values = Tensor::from_slice(&surface_m.concat()).view([surface_m.len() as i64, 1, height, width]);
        Self { surface_m: Some(values.to_device(self.heatmap.device())), ..self }
    }
}

/// The loss of a batch as a tensor to differentiate, and its terms.
///
/// The corner loss is computed by `farsight-core` on the few cells that hold objects, with its exact gradient; the
/// tensor returned has that gradient (its value is not the loss: read the terms).
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
    let heatmap = focal_loss(logits, &targets.heatmap);
    let raw = regression_at_objects(regression, targets);
    let values = doubles_from_tensor(&raw);

    let mut gradient = Vec::with_capacity(values.len());
    let mut terms = LossTerms::default();
    for (RegressionCell { image, object, share }, raw) in targets.cells.iter().zip(values.as_chunks::<CHANNELS>().0) {
        let corners = weights.weighted(&corner_loss(codec, *raw, object, &targets.cameras[*image]));
        let factor = share * weights.factor(object.box3d.depth_m());
        terms.orientation += corners.orientation.value * factor;
        terms.dimensions += corners.dimensions.value * factor;
        terms.location += corners.location.value * factor;
        terms.image += corners.image.value * factor;
        gradient.extend(corners.sum().gradient.map(|g| g * factor));
    }
    let gradient =
        Tensor::from_slice(&gradient).view([-1, CHANNELS as i64]).to_kind(raw.kind()).to_device(raw.device());
    terms.heatmap = heatmap.double_value(&[]);
    (heatmap + (&raw * gradient).sum(raw.kind()), terms)
}

/// Mean difference of the logarithms of depth, where `surface_m` (virtual, metres) knows one; `predicted` is the
/// logarithm of depth over `mean_m`.
///
/// # Shapes
/// Both `[batch, 1, height, width]`.
pub fn surface_loss(predicted: &Tensor, surface_m: &Tensor, mean_m: f64) -> Tensor {
    let known = surface_m.isfinite();
    let nowhere = known.logical_not();
    let wanted = (surface_m / mean_m).log().masked_fill(&nowhere, 0.0);
    let error = (predicted - wanted).abs().masked_fill(&nowhere, 0.0);
    let kind = wide_kind(predicted.kind());
    error.sum(kind) / known.sum(kind).clamp_min(1.0)
}

/// The raw channels at the cells of the objects, `[objects, 8]`.
fn regression_at_objects(regression: &Tensor, targets: &BatchTargets) -> Tensor {
    let [width, height] = targets.map_size;
    let index = |RegressionCell { image, object, .. }: &RegressionCell| {
        (image * width * height + object.cell[1] * width + object.cell[0]) as i64
    };
    let cells: Vec<i64> = targets.cells.iter().map(index).collect();
    let cells = Tensor::from_slice(&cells).to_device(regression.device());
    let by_cell = regression.to_kind(wide_kind(regression.kind())).permute([0, 2, 3, 1]).reshape([-1, CHANNELS as i64]);
    by_cell.index_select(0, &cells)
}

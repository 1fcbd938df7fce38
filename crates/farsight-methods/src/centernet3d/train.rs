//! Training of a CenterNet for 3D boxes: focal loss, L1 on depth, sizes and 2D boxes, cross entropy and smooth L1 on
//! the heading's bins.

use farsight_core::input::InputRules;
use farsight_data::{Frame, Sample};
use farsight_train::config::{DataConfig, RunConfig, TaskConfig};
use farsight_train::losses::focal_loss;
use farsight_train::metrics::Metrics;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};
use tch::{Device, Kind, Reduction, Tensor};

use super::CenterNet3dConfig;
use super::targets::{Targets, targets};
use crate::center_map::train::{AtCells, at_cells, depths_from_raw, mean_l1};
use crate::checks::problem_of_weights;
use crate::detector_task::{DetectorLoss, DetectorTask, TrainSample};
use crate::tensors::stacked;

/// A run that trains a CenterNet for 3D boxes.
pub type CenterNet3dRun = RunConfig<CenterNet3dConfig, CenterNet3dTaskConfig>;

/// Weights of the parts of the loss; the defaults are the authors'.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CenterNet3dTaskConfig {
    /// Of the depth.
    pub depth_weight: f64,
    /// Of the sizes.
    pub dimensions_weight: f64,
    /// Of the heading.
    pub rotation_weight: f64,
    /// Of the 2D box's width and height.
    pub size_weight: f64,
    /// Of the centre within its cell.
    pub offset_weight: f64,
}

impl Default for CenterNet3dTaskConfig {
    fn default() -> Self {
        Self { depth_weight: 1.0, dimensions_weight: 1.0, rotation_weight: 1.0, size_weight: 0.1, offset_weight: 1.0 }
    }
}

impl TaskConfig for CenterNet3dTaskConfig {
    fn problem(&self, _: &DataConfig) -> Option<String> {
        problem_of_weights(&[
            ("depth_weight", self.depth_weight),
            ("dimensions_weight", self.dimensions_weight),
            ("rotation_weight", self.rotation_weight),
            ("size_weight", self.size_weight),
            ("offset_weight", self.offset_weight),
        ])
    }
}

/// What the network should answer to a batch.
#[derive(Debug)]
pub struct Expected {
    /// `[batch, classes, map height, map width]`.
    heatmap: Tensor,
    /// Where the objects are in the flattened maps, `[objects]`.
    cells: Tensor,
    /// Metres, `[objects, 1]`.
    depth_m: Tensor,
    /// Metres, `[objects, 3]`.
    dimensions: Tensor,
    /// Whether the angle is in each bin, `[objects, 2]`, and its sine and cosine there, `[objects, 2, 2]`.
    in_bin: Tensor,
    sin_cos: Tensor,
    /// Cells, `[objects, 2]` each.
    size: Tensor,
    offset: Tensor,
}

/// What a step is judged by.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct LossTerms {
    /// Focal loss of the heatmap.
    pub heatmap: f64,
    /// Weighted loss of the depth.
    pub depth: f64,
    /// Weighted loss of the sizes.
    pub dimensions: f64,
    /// Weighted loss of the heading.
    pub rotation: f64,
    /// Weighted loss of the 2D box's sides.
    pub size: f64,
    /// Weighted loss of the centre within its cell.
    pub offset: f64,
}

impl Metrics for LossTerms {
    const SAMPLES: &'static str = "images";

    fn named(&self) -> Vec<(&'static str, f64)> {
        vec![
            ("heatmap", self.heatmap),
            ("depth", self.depth),
            ("dimensions", self.dimensions),
            ("rotation", self.rotation),
            ("size", self.size),
            ("offset", self.offset),
        ]
    }

    fn zip_with(&self, other: &Self, joined: impl Fn(f64, f64) -> f64) -> Self {
        Self {
            heatmap: joined(self.heatmap, other.heatmap),
            depth: joined(self.depth, other.depth),
            dimensions: joined(self.dimensions, other.dimensions),
            rotation: joined(self.rotation, other.rotation),
            size: joined(self.size, other.size),
            offset: joined(self.offset, other.offset),
        }
    }
}

/// A CenterNet for 3D boxes, learning.
pub type CenterNet3dTask = DetectorTask<CenterNet3dLoss>;

/// Its loss.
#[derive(Debug)]
pub struct CenterNet3dLoss {
    model: CenterNet3dConfig,
    weights: CenterNet3dTaskConfig,
}

impl DetectorLoss for CenterNet3dLoss {
    type Model = CenterNet3dConfig;
    type Config = CenterNet3dTaskConfig;
    type Targets = Targets;
    type Batch = Expected;
    type Metrics = LossTerms;

    fn new(run: &CenterNet3dRun) -> Self {
        Self { model: run.model.clone(), weights: run.task.clone() }
    }

    fn input_rules(model: &CenterNet3dConfig) -> InputRules {
        model.input_spec().rules
    }

    fn targets(&self, _: &Frame, sample: &Sample, _: &mut Pcg64) -> Targets {
        let CenterNet3dConfig { classes, heatmap, .. } = &self.model;
        targets(&sample.labels, classes, heatmap, &self.model.codec(), &sample.camera, sample.size)
    }

    fn batch(&self, samples: &[TrainSample<Targets>], device: Device) -> Expected {
        let map_size = samples.first().map_or([0, 0], |sample| sample.targets.map_size);
        let taught = samples.iter().map(|sample| if sample.regress { &sample.targets.objects[..] } else { &[] });
        let objects = AtCells::new(taught, map_size, |object| object.cell, device);
        Expected {
            heatmap: stacked(samples.iter().map(|sample| &sample.targets.heatmap[..]), map_size, device),
            cells: objects.cells(),
            depth_m: objects.rows(|object| [object.depth_m]),
            dimensions: objects.rows(|object| object.dimensions_hwl),
            in_bin: objects.rows(|object| object.bins.map(|bin| bin.score)),
            sin_cos: objects
                .rows::<4>(|object| [0, 1, 2, 3].map(|place| object.bins[place / 2].sin_cos[place % 2]))
                .view([-1, 2, 2]),
            size: objects.rows(|object| object.size),
            offset: objects.rows(|object| object.offset),
        }
    }
    fn loss(&self, outputs: &[Tensor], batch: &Expected) -> (Tensor, LossTerms) {
        let [heatmap, depth, rotation, dimensions, size, offset] = [0, 1, 2, 3, 4, 5].map(|place| &outputs[place]);
        let at = |map: &Tensor| at_cells(map, &batch.cells);
        let found_m = depths_from_raw(&at(depth));
        let heatmap = focal_loss(heatmap, &batch.heatmap);
        let weights = &self.weights;
        let parts = [
            mean_l1(&found_m, &batch.depth_m) * weights.depth_weight,
            mean_l1(&at(dimensions), &batch.dimensions) * weights.dimensions_weight,
            rotation_loss(&at(rotation), &batch.in_bin, &batch.sin_cos) * weights.rotation_weight,
            mean_l1(&at(size), &batch.size) * weights.size_weight,
            mean_l1(&at(offset), &batch.offset) * weights.offset_weight,
        ];
        let [depth, dimensions, rotation, size, offset] = parts.each_ref().map(|part| part.double_value(&[]));
        let metrics = LossTerms { heatmap: heatmap.double_value(&[]), depth, dimensions, rotation, size, offset };
        let objective = parts.iter().fold(heatmap, |sum, part| sum + part);
        (objective, metrics)
    }
}

/// Cross entropy of each bin, and smooth L1 of sine and cosine in the bins that the angle is in.
///
/// # Shapes
/// `found` `[objects, 8]`, `in_bin` `[objects, 2]`, `sin_cos` `[objects, 2, 2]`.
fn rotation_loss(found: &Tensor, in_bin: &Tensor, sin_cos: &Tensor) -> Tensor {
    let objects = in_bin.size()[0].max(1) as f64;
    let found = found.view([-1, 2, 4]);
    let logits = found.narrow(2, 0, 2).reshape([-1, 2]);
    let classes = in_bin.reshape([-1]).to_kind(Kind::Int64);
    let entropy = logits.cross_entropy_loss::<Tensor>(&classes, None, Reduction::Sum, -100, 0.0) / objects;
    let off = found.narrow(2, 2, 2).smooth_l1_loss(sin_cos, Reduction::None, 1.0);
    let residual = (off * in_bin.unsqueeze(2)).sum(Kind::Float) / in_bin.sum(Kind::Float).clamp_min(1.0);
    entropy + residual
}

//! Training of a `MonoDLE`: focal loss, L1 on offsets and 2D boxes, a depth that learns how sure it is, sizes weighed
//! by how much they count, cross entropy and L1 on the heading's bins. All terms weigh the same.

use farsight_core::input::InputRules;
use farsight_core::{Box2d, Label};
use farsight_data::{Frame, Sample};
use farsight_train::config::{DataConfig, RunConfig, TaskConfig};
use farsight_train::losses::focal_loss;
use farsight_train::metrics::Metrics;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};
use tch::{Device, Tensor};

use super::MonoDleConfig;
use super::codec::Encoded;
use super::targets::{Targets, targets};
use crate::center_map::train::{AtCells, at_cells, depths_from_raw, heading_loss, mean_l1};
use crate::checks::problem_of_weights;
use crate::detector_task::{DetectorLoss, DetectorTask, TrainSample};
use crate::tensors::stacked;

/// A run that trains a `MonoDLE`.
pub type MonoDleRun = RunConfig<MonoDleConfig, MonoDleTaskConfig>;

/// A size divides a loss as if it were at least this, metres.
const MIN_SIZE_M: f64 = 0.05;

/// Which objects count, and weights of the parts of the loss; the defaults are the authors'.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MonoDleTaskConfig {
    /// Objects whose depth, metres, lies outside are taken for background: far ones do more harm than good (paper,
    /// section 3.4).
    pub depth_range_m: [f64; 2],
    /// Objects lower than this in the original image, pixels, are taken for background; of KITTI's what is below its
    /// Hard difficulty, as by the next two fields.
    pub min_height_px: f64,
    /// So are those of which the image cuts off a larger share.
    pub max_truncation: f64,
    /// So are those that are hidden more (KITTI's 0 to 3).
    pub max_occlusion: i32,
    /// Weight of the 2D box: its offset and its size.
    pub box_weight: f64,
    /// Of the depth.
    pub depth_weight: f64,
    /// Of the offset of the 3D box's centre.
    pub offset_weight: f64,
    /// Of the sizes.
    pub dimensions_weight: f64,
    /// Of the heading.
    pub heading_weight: f64,
}

impl Default for MonoDleTaskConfig {
    fn default() -> Self {
        Self {
            depth_range_m: [2.0, 65.0],
            min_height_px: 25.0,
            max_truncation: 0.5,
            max_occlusion: 2,
            box_weight: 1.0,
            depth_weight: 1.0,
            offset_weight: 1.0,
            dimensions_weight: 1.0,
            heading_weight: 1.0,
        }
    }
}

impl TaskConfig for MonoDleTaskConfig {
    fn problem(&self, _: &DataConfig) -> Option<String> {
        let [least, most] = self.depth_range_m;
        if !(least >= 0.0 && least < most && most.is_finite()) {
            return Some(format!("depth_range_m is {least} to {most}; expected 0 <= least < most"));
        }
        problem_of_weights(&[
            ("min_height_px", self.min_height_px),
            ("max_truncation", self.max_truncation),
            ("box_weight", self.box_weight),
            ("depth_weight", self.depth_weight),
            ("offset_weight", self.offset_weight),
            ("dimensions_weight", self.dimensions_weight),
            ("heading_weight", self.heading_weight),
        ])
    }
}

impl MonoDleTaskConfig {
    /// Whether an object as annotated in its original image counts.
    fn counts(&self, label: &Label) -> bool {
        let [least, most] = self.depth_range_m;
        let Box2d { y1, y2, .. } = label.box2d;
        (least..=most).contains(&label.box3d.depth_m())
            && y2 - y1 >= self.min_height_px
            && label.truncation <= self.max_truncation
            && label.occlusion <= self.max_occlusion
    }
}

/// What the network should answer to a batch.
#[derive(Debug)]
pub struct Expected {
    /// `[batch, classes, map height, map width]`.
    heatmap: Tensor,
    /// Where the objects are in the flattened maps, `[objects]`.
    cells: Tensor,
    /// Cells, `[objects, 2]` each.
    box_offset: Tensor,
    box_size: Tensor,
    /// Bins, `[objects]`, and the residuals in them, radians, `[objects, 1]`.
    bin: Tensor,
    residual: Tensor,
    /// Where those objects are whose 3D boxes are learnt.
    cells_3d: Tensor,
    /// Metres, `[objects, 1]`.
    depth_m: Tensor,
    /// Cells, `[objects, 2]`.
    center_offset: Tensor,
    /// Metres, `[objects, 3]`.
    dimensions: Tensor,
}

/// What a step is judged by.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct LossTerms {
    /// Focal loss of the heatmap.
    pub heatmap: f64,
    /// Weighted loss of the 2D box.
    pub box_2d: f64,
    /// Weighted loss of the depth; below zero where it is sure and right.
    pub depth: f64,
    /// Weighted loss of the offset of the 3D box's centre.
    pub offset: f64,
    /// Weighted loss of the sizes.
    pub dimensions: f64,
    /// Weighted loss of the heading.
    pub heading: f64,
}

impl Metrics for LossTerms {
    const SAMPLES: &'static str = "images";

    fn named(&self) -> Vec<(&'static str, f64)> {
        vec![
            ("heatmap", self.heatmap),
            ("box_2d", self.box_2d),
            ("depth", self.depth),
            ("offset", self.offset),
            ("dimensions", self.dimensions),
            ("heading", self.heading),
        ]
    }

    fn zip_with(&self, other: &Self, joined: impl Fn(f64, f64) -> f64) -> Self {
        Self {
            heatmap: joined(self.heatmap, other.heatmap),
            box_2d: joined(self.box_2d, other.box_2d),
            depth: joined(self.depth, other.depth),
            offset: joined(self.offset, other.offset),
            dimensions: joined(self.dimensions, other.dimensions),
            heading: joined(self.heading, other.heading),
        }
    }
}

/// A `MonoDLE`, learning.
pub type MonoDleTask = DetectorTask<MonoDleLoss>;

/// Its loss.
#[derive(Debug)]
pub struct MonoDleLoss {
    model: MonoDleConfig,
    task: MonoDleTaskConfig,
}

impl DetectorLoss for MonoDleLoss {
    type Model = MonoDleConfig;
    type Config = MonoDleTaskConfig;
    type Targets = Targets;
    type Batch = Expected;
    type Metrics = LossTerms;

    fn new(run: &MonoDleRun) -> Self {
        Self { model: run.model.clone(), task: run.task.clone() }
    }

    fn input_rules(model: &MonoDleConfig) -> InputRules {
        model.input_spec().rules
    }

    fn targets(&self, frame: &Frame, sample: &Sample, _: &mut Pcg64) -> Targets {
        let counting = frame.labels.iter().zip(&sample.labels).filter(|(annotated, _)| self.task.counts(annotated));
        let labels = counting.map(|(_, label)| label);
        let MonoDleConfig { classes, heatmap, .. } = &self.model;
        targets(labels, classes, heatmap, &self.model.codec(), &sample.camera, sample.size)
    }

    fn batch(&self, samples: &[TrainSample<Targets>], device: Device) -> Expected {
        let map_size = samples.first().map_or([0, 0], |sample| sample.targets.map_size);
        let cell_of = |object: &Encoded| object.cell;
        let all = samples.iter().map(|sample| &sample.targets.objects[..]);
        let taught = samples.iter().map(|sample| if sample.regress { &sample.targets.objects[..] } else { &[] });
        let (all, taught) =
            (AtCells::new(all, map_size, cell_of, device), AtCells::new(taught, map_size, cell_of, device));
        Expected {
            heatmap: stacked(samples.iter().map(|sample| &sample.targets.heatmap[..]), map_size, device),
            cells: all.cells(),
            box_offset: all.rows(|object| object.box_offset),
            box_size: all.rows(|object| object.box_size),
            bin: all.classes(|object| object.heading.bin),
            residual: all.rows(|object| [object.heading.residual]),
            cells_3d: taught.cells(),
            depth_m: taught.rows(|object| [object.depth_m]),
            center_offset: taught.rows(|object| object.center_offset),
            dimensions: taught.rows(|object| object.dimensions_hwl),
        }
    }
    fn loss(&self, outputs: &[Tensor], batch: &Expected) -> (Tensor, LossTerms) {
        let [heatmap, box_offset, box_size, depth, center_offset, dimensions, heading] =
            [0, 1, 2, 3, 4, 5, 6].map(|place| &outputs[place]);
        let at = |map: &Tensor| at_cells(map, &batch.cells);
        let at_3d = |map: &Tensor| at_cells(map, &batch.cells_3d);
        let heatmap = focal_loss(heatmap, &batch.heatmap);
        let weights = &self.task;
        let box_2d = mean_l1(&at(box_offset), &batch.box_offset) + mean_l1(&at(box_size), &batch.box_size);
        let parts = [
            box_2d * weights.box_weight,
            depth_loss(&at_3d(depth), &batch.depth_m) * weights.depth_weight,
            mean_l1(&at_3d(center_offset), &batch.center_offset) * weights.offset_weight,
            dimensions_loss(&at_3d(dimensions), &batch.dimensions) * weights.dimensions_weight,
            heading_loss(&at(heading), &batch.bin, &batch.residual) * weights.heading_weight,
        ];
        let [box_2d, depth, offset, dimensions, heading] = parts.each_ref().map(|part| part.double_value(&[]));
        let metrics = LossTerms { heatmap: heatmap.double_value(&[]), box_2d, depth, offset, dimensions, heading };
        let objective = parts.iter().fold(heatmap, |sum, part| sum + part);
        (objective, metrics)
    }
}

/// Laplace's negative logarithm of the likelihood, up to a constant: `sqrt(2) exp(-v / 2) |error| + v / 2`, mean over
/// the objects, where `v` is the logarithm of the variance (authors' code).
///
/// # Shapes
/// `found` `[objects, 2]`: depth before its activation, and `v`; `depth_m` `[objects, 1]`.
pub fn depth_loss(found: &Tensor, depth_m: &Tensor) -> Tensor {
    let objects = depth_m.numel().max(1) as f64;
    let log_variance = found.narrow(1, 1, 1);
    let error = (depths_from_raw(&found.narrow(1, 0, 1)) - depth_m).abs();
    let each = error * (&log_variance * -0.5).exp() * std::f64::consts::SQRT_2 + log_variance * 0.5;
    each.sum(each.kind()) / objects
}

/// L1 of the sizes, each divided by the right one, then scaled by a factor without gradient, so that the value is that
/// of plain L1 (authors' code): the same error in metres counts more of a small side.
///
/// # Shapes
/// Both `[objects, 3]`, metres.
pub fn dimensions_loss(found: &Tensor, expected: &Tensor) -> Tensor {
    let numbers = expected.numel().max(1) as f64;
    let error = (found - expected).abs();
    let relative = (&error / expected.clamp_min(MIN_SIZE_M)).sum(error.kind()) / numbers;
    let plain = error.sum(error.kind()).detach() / numbers;
    // Without an error both are zero, and so is the gradient.
    let factor = plain / relative.detach().clamp_min(f64::from(f32::MIN_POSITIVE));
    relative * factor
}

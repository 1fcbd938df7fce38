//! Training of an `OFTNet`: L1 on everything, near objects much more on the scores; the rest under objects alone.

use farsight_core::Box2d;
use farsight_core::input::InputRules;
use farsight_data::{Frame, Sample};
use farsight_train::config::{DataConfig, RunConfig, TaskConfig};
use farsight_train::metrics::Metrics;
use farsight_train::samplers::box_means;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};
use tch::{Device, Tensor};

use super::OftNetConfig;
use super::grid::Grid;
use super::network::ANSWERS;
use super::sampler::{STRIDES, boxes};
use super::targets::{Targets, targets};
use crate::checks::problem_of_weights;
use crate::detector_task::{DetectorLoss, DetectorTask, TrainSample};
use crate::tensors::stacked;

/// A run that trains an `OFTNet`.
pub type OftNetRun = RunConfig<OftNetConfig, OftNetTaskConfig>;

/// Cells whose score should be above this are near an object (authors' code).
const NEAR: f64 = 0.05;

/// Weights of the parts of the loss; the defaults are the authors'.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OftNetTaskConfig {
    /// How much more an error of the score counts near an object.
    pub near_factor: f64,
    /// Of the scores.
    pub score_weight: f64,
    /// Of the places.
    pub place_weight: f64,
    /// Of the sizes.
    pub size_weight: f64,
    /// Of the headings.
    pub yaw_weight: f64,
}

impl Default for OftNetTaskConfig {
    fn default() -> Self {
        Self { near_factor: 100.0, score_weight: 1.0, place_weight: 1.0, size_weight: 1.0, yaw_weight: 1.0 }
    }
}

impl TaskConfig for OftNetTaskConfig {
    fn problem(&self, _: &DataConfig) -> Option<String> {
        problem_of_weights(&[
            ("near_factor", self.near_factor),
            ("score_weight", self.score_weight),
            ("place_weight", self.place_weight),
            ("size_weight", self.size_weight),
            ("yaw_weight", self.yaw_weight),
        ])
    }
}

/// What the network should answer to one image, and where its maps are read for that.
#[derive(Debug)]
pub struct Expectation {
    boxes: [Vec<Box2d>; STRIDES.len()],
    targets: Targets,
}

/// What the network should answer to a batch.
#[derive(Debug)]
pub struct Expected {
    /// Where each image's maps are read.
    boxes: Vec<[Vec<Box2d>; STRIDES.len()]>,
    /// `[batch, classes, rows, columns]`.
    heatmap: Tensor,
    /// Which cells are under objects, in flattened `[batch, classes, rows, columns]`.
    cells: Tensor,
    /// What stands there: place, size, cosine and sine, `[cells, 8]`.
    answers: Tensor,
}

/// What a step is judged by. All terms are sums over an image divided by the cells of the grid.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct LossTerms {
    /// Weighted loss of the scores.
    pub score: f64,
    /// Weighted loss of the places.
    pub place: f64,
    /// Weighted loss of the sizes.
    pub size: f64,
    /// Weighted loss of the headings.
    pub yaw: f64,
}

impl Metrics for LossTerms {
    const SAMPLES: &'static str = "images";

    fn named(&self) -> Vec<(&'static str, f64)> {
        vec![("score", self.score), ("place", self.place), ("size", self.size), ("yaw", self.yaw)]
    }

    fn zip_with(&self, other: &Self, joined: impl Fn(f64, f64) -> f64) -> Self {
        Self {
            score: joined(self.score, other.score),
            place: joined(self.place, other.place),
            size: joined(self.size, other.size),
            yaw: joined(self.yaw, other.yaw),
        }
    }
}

/// An `OFTNet`, learning.
pub type OftNetTask = DetectorTask<OftNetLoss>;

/// Its loss.
#[derive(Debug)]
pub struct OftNetLoss {
    model: OftNetConfig,
    weights: OftNetTaskConfig,
}

impl DetectorLoss for OftNetLoss {
    type Model = OftNetConfig;
    type Config = OftNetTaskConfig;
    type Targets = Expectation;
    type Batch = Expected;
    type Metrics = LossTerms;

    fn new(run: &OftNetRun) -> Self {
        Self { model: run.model.clone(), weights: run.task.clone() }
    }

    fn input_rules(model: &OftNetConfig) -> InputRules {
        model.input_spec().rules
    }

    fn targets(&self, _: &Frame, sample: &Sample, _: &mut Pcg64) -> Expectation {
        Expectation {
            boxes: boxes(&self.model.grid, &sample.camera),
            targets: targets(&sample.labels, &self.model.codec()),
        }
    }

    fn batch(&self, samples: &[TrainSample<Expectation>], device: Device) -> Expected {
        let grid = &self.model.grid;
        let size = [grid.columns, grid.rows];
        let of_all = || samples.iter().map(|sample| &sample.targets.targets);
        let classes = of_all().next().map_or(1, |targets| targets.heatmap.len() / grid.cells());
        let mut cells = Vec::new();
        let mut expected = Vec::new();
        for (image, targets) in of_all().enumerate() {
            for (class, [column, row], encoded) in &targets.cells {
                cells.push((((image * classes + class) * grid.rows + row) * grid.columns + column) as i64);
                let values = encoded.place.iter().chain(&encoded.size).chain(&encoded.cos_sin);
                expected.extend(values.map(|value| *value as f32));
            }
        }
        Expected {
            boxes: samples.iter().map(|sample| sample.targets.boxes.clone()).collect(),
            heatmap: stacked(of_all().map(|targets| &targets.heatmap[..]), size, device),
            cells: Tensor::from_slice(&cells).to_device(device),
            answers: Tensor::from_slice(&expected).view([-1, ANSWERS as i64 - 1]).to_device(device),
        }
    }

    fn sampled(&self, _: usize, maps: &[Tensor], batch: &Expected) -> Tensor {
        sampled(maps, &batch.boxes, &self.model.grid)
    }

    fn loss(&self, outputs: &[Tensor], batch: &Expected) -> (Tensor, LossTerms) {
        let weights = &self.weights;
        let parts = losses(&outputs[0], &batch.heatmap, &batch.cells, &batch.answers, weights.near_factor);
        let factors = [weights.score_weight, weights.place_weight, weights.size_weight, weights.yaw_weight];
        let parts: Vec<Tensor> = parts.into_iter().zip(factors).map(|(part, factor)| part * factor).collect();
        let [score, place, size, yaw] = [0, 1, 2, 3].map(|place| parts[place].double_value(&[]));
        let metrics = LossTerms { score, place, size, yaw };
        let objective = &parts[0] + &parts[1] + &parts[2] + &parts[3];
        (objective, metrics)
    }
}

/// [`super::sampler::sample`] on tensors, for a batch.
///
/// # Shapes
/// Each of `maps` `[batch, channels, height, width]` to `[batch, maps slabs channels, rows, columns]`.
pub fn sampled(maps: &[Tensor], boxes: &[[Vec<Box2d>; STRIDES.len()]], grid: &Grid) -> Tensor {
    let [slabs, rows, columns] = [grid.slabs, grid.rows, grid.columns].map(|count| count as i64);
    let of_image = |(image, boxes): (usize, &[Vec<Box2d>; STRIDES.len()])| {
        let of_map = |(map, boxes): (&Tensor, &Vec<Box2d>)| {
            let means = box_means(&map.get(image as i64), boxes).view([-1, slabs, rows, columns]);
            means.transpose(0, 1).reshape([-1, rows, columns])
        };
        Tensor::cat(&maps.iter().zip(boxes).map(of_map).collect::<Vec<_>>(), 0)
    };
    Tensor::stack(&boxes.iter().enumerate().map(of_image).collect::<Vec<_>>(), 0)
}

/// L1 of the scores, those near objects times `near_factor`, then of places, sizes and headings under objects: sums,
/// divided by the images and by the cells of the grid. The authors divide by nothing.
///
/// # Shapes
/// `answer` `[batch, classes answers, rows, columns]`, `heatmap` `[batch, classes, rows, columns]`, `cells` `[objects]`
/// in flattened `heatmap`, `expected` `[objects, 8]`.
pub fn losses(answer: &Tensor, heatmap: &Tensor, cells: &Tensor, expected: &Tensor, near_factor: f64) -> [Tensor; 4] {
    let size = heatmap.size();
    let [batch, classes, rows, columns] = [0, 1, 2, 3].map(|axis| size[axis]);
    let scale = 1.0 / (batch * rows * columns) as f64;
    let answer = answer.view([batch, classes, ANSWERS as i64, rows, columns]);
    let near = heatmap.gt(NEAR).to_kind(heatmap.kind()) * (near_factor - 1.0) + 1.0;
    let score = ((answer.select(2, 0) - heatmap).abs() * near).sum(heatmap.kind()) * scale;
    let found = answer.permute([0, 1, 3, 4, 2]).reshape([-1, ANSWERS as i64]).index_select(0, cells);
    let part = |first: i64, count: i64| {
        let off = found.narrow(1, first + 1, count) - expected.narrow(1, first, count);
        off.abs().sum(off.kind()) * scale
    };
    [score, part(0, 3), part(3, 3), part(6, 2)]
}

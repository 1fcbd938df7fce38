//! Training of a GS3D: of the first network focal loss, L1 on 2D boxes and the heading's losses, of the second cross
//! entropy of bins that hold how good a box becomes. Both at once, or one after the other with `train.freeze`.

use farsight_core::input::InputRules;
use farsight_data::{Frame, Sample};
use farsight_train::config::{DataConfig, RunConfig, TaskConfig};
use farsight_train::losses::focal_loss;
use farsight_train::metrics::Metrics;
use farsight_train::samplers::grid_sample;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};
use tch::{Device, Reduction, Tensor};

use super::Gs3dConfig;
use super::network::{HEADING, HEATMAP, OFFSET, REFINEMENT, SIZE};
use super::refinement::{BINS, NUMBERS};
use super::surfaces::{SAMPLES, SIDE, SURFACES, nothing};
use super::targets::{Targets, targets};
use crate::center_map::train::{AtCells, at_cells, heading_loss, mean_l1};
use crate::checks::problem_of_weights;
use crate::detector_task::{DetectorLoss, DetectorTask, TrainSample};
use crate::tensors::stacked;

/// A run that trains a GS3D.
pub type Gs3dRun = RunConfig<Gs3dConfig, Gs3dTaskConfig>;

/// Weights of the parts of the loss.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Gs3dTaskConfig {
    /// Of the 2D box's centre within its cell.
    pub offset_weight: f64,
    /// Of the 2D box's sides.
    pub size_weight: f64,
    /// Of the heading.
    pub heading_weight: f64,
    /// Of the refinement.
    pub refinement_weight: f64,
}

impl Default for Gs3dTaskConfig {
    /// Those of `CenterNet` for the 2D box; the paper gives none.
    fn default() -> Self {
        Self { offset_weight: 1.0, size_weight: 0.1, heading_weight: 1.0, refinement_weight: 1.0 }
    }
}

impl TaskConfig for Gs3dTaskConfig {
    fn problem(&self, _: &DataConfig) -> Option<String> {
        problem_of_weights(&[
            ("offset_weight", self.offset_weight),
            ("size_weight", self.size_weight),
            ("heading_weight", self.heading_weight),
            ("refinement_weight", self.refinement_weight),
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
    /// Cells, `[objects, 2]` each.
    offset: Tensor,
    size: Tensor,
    /// Bins, `[objects]`, and the residuals in them, radians, `[objects, 1]`.
    bin: Tensor,
    residual: Tensor,
    /// Where each image's map is read, and how many candidates there are.
    points: Vec<Vec<[f64; 2]>>,
    candidates: usize,
    /// What the second network should say, `[candidates, numbers bins]`.
    bins: Tensor,
}

/// What a step is judged by.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct LossTerms {
    /// Focal loss of the heatmap.
    pub heatmap: f64,
    /// Weighted loss of the centre within its cell.
    pub offset: f64,
    /// Weighted loss of the 2D box's sides.
    pub size: f64,
    /// Weighted loss of the heading.
    pub heading: f64,
    /// Weighted loss of the refinement.
    pub refinement: f64,
}

impl Metrics for LossTerms {
    const SAMPLES: &'static str = "images";

    fn named(&self) -> Vec<(&'static str, f64)> {
        vec![
            ("heatmap", self.heatmap),
            ("offset", self.offset),
            ("size", self.size),
            ("heading", self.heading),
            ("refinement", self.refinement),
        ]
    }

    fn zip_with(&self, other: &Self, joined: impl Fn(f64, f64) -> f64) -> Self {
        Self {
            heatmap: joined(self.heatmap, other.heatmap),
            offset: joined(self.offset, other.offset),
            size: joined(self.size, other.size),
            heading: joined(self.heading, other.heading),
            refinement: joined(self.refinement, other.refinement),
        }
    }
}

/// A GS3D, learning.
pub type Gs3dTask = DetectorTask<Gs3dLoss>;

/// Its loss.
#[derive(Debug)]
pub struct Gs3dLoss {
    model: Gs3dConfig,
    weights: Gs3dTaskConfig,
}

impl DetectorLoss for Gs3dLoss {
    type Model = Gs3dConfig;
    type Config = Gs3dTaskConfig;
    type Targets = Targets;
    type Batch = Expected;
    type Metrics = LossTerms;

    const READS: &'static [&'static str] = &[HEATMAP, OFFSET, SIZE, HEADING, REFINEMENT];

    fn new(run: &Gs3dRun) -> Self {
        Self { model: run.model.clone(), weights: run.task.clone() }
    }

    fn input_rules(model: &Gs3dConfig) -> InputRules {
        model.input_spec().rules
    }

    fn targets(&self, _: &Frame, sample: &Sample, rng: &mut Pcg64) -> Targets {
        targets(&sample.labels, &self.model, &sample.camera, sample.size, rng)
    }

    fn batch(&self, samples: &[TrainSample<Targets>], device: Device) -> Expected {
        let map_size = samples.first().map_or([0, 0], |sample| sample.targets.map_size);
        let all = samples.iter().map(|sample| &sample.targets.objects[..]);
        let objects = AtCells::new(all, map_size, |object| object.cell, device);
        let mut points: Vec<Vec<[f64; 2]>> = samples
            .iter()
            .map(|sample| sample.targets.candidates.iter().flat_map(|one| one.points.iter().copied()).collect())
            .collect();
        let mut bins: Vec<f32> =
            samples.iter().flat_map(|sample| &sample.targets.candidates).flat_map(|one| one.target).collect();
        let candidates = bins.len() / (NUMBERS * BINS);
        if candidates == 0 {
            // The second network gets something to look at; its loss does not count.
            points.iter_mut().take(1).for_each(|points| *points = nothing(SURFACES * SAMPLES));
            bins = vec![0.0; NUMBERS * BINS];
        }
        Expected {
            heatmap: stacked(samples.iter().map(|sample| &sample.targets.heatmap[..]), map_size, device),
            cells: objects.cells(),
            offset: objects.rows(|object| object.offset),
            size: objects.rows(|object| object.size),
            bin: objects.classes(|object| object.heading.bin),
            residual: objects.rows(|object| [object.heading.residual]),
            points,
            candidates,
            bins: Tensor::from_slice(&bins).view([-1, (NUMBERS * BINS) as i64]).to_device(device),
        }
    }

    /// The map of surfaces is the last that is read; the others are what boxes come from.
    fn sampled(&self, _: usize, maps: &[Tensor], batch: &Expected) -> Tensor {
        sampled(&maps[maps.len() - 1], &batch.points)
    }

    fn loss(&self, outputs: &[Tensor], batch: &Expected) -> (Tensor, LossTerms) {
        let [heatmap, offset, size, heading, refinement] = [0, 1, 2, 3, 4].map(|place| &outputs[place]);
        let at = |map: &Tensor| at_cells(map, &batch.cells);
        let heatmap = focal_loss(heatmap, &batch.heatmap);
        let weights = &self.weights;
        let parts = [
            mean_l1(&at(offset), &batch.offset) * weights.offset_weight,
            mean_l1(&at(size), &batch.size) * weights.size_weight,
            heading_loss(&at(heading), &batch.bin, &batch.residual) * weights.heading_weight,
            refinement_loss(&refinement.flatten(1, -1), &batch.bins, batch.candidates) * weights.refinement_weight,
        ];
        let [offset, size, heading, refinement] = parts.each_ref().map(|part| part.double_value(&[]));
        let metrics = LossTerms { heatmap: heatmap.double_value(&[]), offset, size, heading, refinement };
        let objective = parts.iter().fold(heatmap, |sum, part| sum + part);
        (objective, metrics)
    }
}

/// [`super::surfaces::sample`] on tensors, for a batch: `points` of each image, candidate by candidate.
///
/// # Shapes
/// `map` `[batch, channels, height, width]` to `[candidates, surfaces channels, side, side]`.
pub fn sampled(map: &Tensor, points: &[Vec<[f64; 2]>]) -> Tensor {
    let [surfaces, samples, side] = [SURFACES, SAMPLES, SIDE].map(|count| count as i64);
    let of_image = |(image, points): (usize, &Vec<[f64; 2]>)| {
        let map = map.get(image as i64);
        let channels = map.size()[0];
        let read = grid_sample(&map, points).view([channels, -1, surfaces, samples]).permute([1, 2, 0, 3]);
        read.reshape([-1, surfaces * channels, side, side])
    };
    let read = points.iter().enumerate().filter(|(_, points)| !points.is_empty()).map(of_image);
    Tensor::cat(&read.collect::<Vec<_>>(), 0)
}

/// Cross entropy of each bin by itself, summed over numbers and bins, mean over the candidates; zero without any.
///
/// # Shapes
/// Both `[candidates, numbers bins]`: logits, and how good the box is that the bin leads to.
pub fn refinement_loss(logits: &Tensor, target: &Tensor, candidates: usize) -> Tensor {
    let sum = logits.binary_cross_entropy_with_logits::<Tensor>(target, None, None, Reduction::Sum);
    sum * (candidates.min(1) as f64 / candidates.max(1) as f64)
}

//! Training of a `MonoGRNet`: cross entropy of cells and boxes, L1 of everything else. All parts at once, or one after
//! the other with `train.freeze`, as the authors do.

use farsight_core::Box2d;
use farsight_core::input::InputRules;
use farsight_data::{Frame, Sample};
use farsight_train::config::{DataConfig, RunConfig, TaskConfig};
use farsight_train::metrics::Metrics;
use farsight_train::samplers::roi_align;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};
use tch::{Device, Kind, Reduction, Tensor};

use super::MonoGrNetConfig;
use super::codec::{CORNER_REACH_M, CORNER_STEP_M, START_DEPTH_M};
use super::layout::{BOX_NUMBERS, CORNER_NUMBERS, SIDE};
use super::network::{CELLS, CENTER, CENTER_STEP, CORNER_STEPS, CORNERS, DEPTH, DEPTH_STEP, REZOOM};
use super::sampler::on_map;
use super::targets::{BoxTarget, CellClass, CellTarget, CornerTarget, Targets, targets};
use crate::center_map::train::{AtCells, at_cells, mean_l1};
use crate::checks::problem_of_weights;
use crate::detector_task::{DetectorLoss, DetectorTask, TrainSample};

/// A run that trains a `MonoGRNet`.
pub type MonoGrNetRun = RunConfig<MonoGrNetConfig, MonoGrNetTaskConfig>;

/// Class of a cell that may say anything.
const IGNORED: i64 = -100;

/// Weights of the parts of the loss.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MonoGrNetTaskConfig {
    /// Of cells' 2D boxes.
    pub box_weight: f64,
    /// Of depths, those of cells and those of boxes.
    pub depth_weight: f64,
    /// Of where centres are seen, those of cells and those of boxes.
    pub center_weight: f64,
    /// Of what is said again of 2D boxes: scores and moves.
    pub rezoom_weight: f64,
    /// Of corners.
    pub corner_weight: f64,
    /// Of corners that are moved once more.
    pub refinement_weight: f64,
}

impl Default for MonoGrNetTaskConfig {
    /// The authors'; what their units are is left open.
    fn default() -> Self {
        Self {
            box_weight: 0.1,
            depth_weight: 1.0,
            center_weight: 1.0,
            rezoom_weight: 0.1,
            corner_weight: 0.5,
            refinement_weight: 0.5,
        }
    }
}

impl TaskConfig for MonoGrNetTaskConfig {
    fn problem(&self, _: &DataConfig) -> Option<String> {
        problem_of_weights(&[
            ("box_weight", self.box_weight),
            ("depth_weight", self.depth_weight),
            ("center_weight", self.center_weight),
            ("rezoom_weight", self.rezoom_weight),
            ("corner_weight", self.corner_weight),
            ("refinement_weight", self.refinement_weight),
        ])
    }
}

/// What the networks should answer to a batch.
#[derive(Debug)]
pub struct Expected {
    /// Class of every cell, background first, `[batch, rows, columns]`.
    classes: Tensor,
    /// Where the objects' cells are in the flattened grids, `[cells]`, and what is asked there: 2D boxes
    /// `[cells, 4]`, depths `[cells, 1]`, centres `[cells, 2]`.
    cells: Tensor,
    boxes: Tensor,
    depths: Tensor,
    centers: Tensor,
    /// The 2D boxes of each image, on the maps.
    read: Vec<Vec<Box2d>>,
    /// Classes of these boxes, background first, `[boxes]`.
    box_classes: Tensor,
    /// Which of them are objects, `[objects]`; where their cells are in the flattened grids, and what is asked of them:
    /// moves `[objects, 4]`, depths `[objects, 1]`, centres `[objects, 2]`, corners `[objects, 24]`.
    objects: Tensor,
    object_cells: Tensor,
    moves: Tensor,
    object_depths: Tensor,
    object_centers: Tensor,
    corners: Tensor,
    /// Where the 3D boxes of each image are seen, on the maps, and by what they are off, `[boxes, 24]`.
    read_again: Vec<Vec<Box2d>>,
    steps: Tensor,
    /// How many 2D and 3D boxes count: without any, one is looked at for nothing.
    counts: [usize; 2],
}

/// What a step is judged by.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct LossTerms {
    /// Cross entropy of cells.
    pub cells: f64,
    /// Weighted loss of cells' 2D boxes.
    pub boxes: f64,
    /// Weighted loss of depths.
    pub depth: f64,
    /// Weighted loss of centres.
    pub center: f64,
    /// Weighted loss of what is said again of 2D boxes.
    pub rezoom: f64,
    /// Weighted loss of corners.
    pub corners: f64,
    /// Weighted loss of corners that are moved once more.
    pub refinement: f64,
}

impl Metrics for LossTerms {
    const SAMPLES: &'static str = "images";

    fn named(&self) -> Vec<(&'static str, f64)> {
        vec![
            ("cells", self.cells),
            ("boxes", self.boxes),
            ("depth", self.depth),
            ("center", self.center),
            ("rezoom", self.rezoom),
            ("corners", self.corners),
            ("refinement", self.refinement),
        ]
    }

    fn zip_with(&self, other: &Self, joined: impl Fn(f64, f64) -> f64) -> Self {
        Self {
            cells: joined(self.cells, other.cells),
            boxes: joined(self.boxes, other.boxes),
            depth: joined(self.depth, other.depth),
            center: joined(self.center, other.center),
            rezoom: joined(self.rezoom, other.rezoom),
            corners: joined(self.corners, other.corners),
            refinement: joined(self.refinement, other.refinement),
        }
    }
}

/// A `MonoGRNet`, learning.
pub type MonoGrNetTask = DetectorTask<MonoGrNetLoss>;

/// Its loss.
#[derive(Debug)]
pub struct MonoGrNetLoss {
    model: MonoGrNetConfig,
    weights: MonoGrNetTaskConfig,
}

impl DetectorLoss for MonoGrNetLoss {
    type Model = MonoGrNetConfig;
    type Config = MonoGrNetTaskConfig;
    type Targets = Targets;
    type Batch = Expected;
    type Metrics = LossTerms;

    const READS: &'static [&'static str] =
        &[CELLS, DEPTH, CENTER, REZOOM, DEPTH_STEP, CENTER_STEP, CORNERS, CORNER_STEPS];

    fn new(run: &MonoGrNetRun) -> Self {
        Self { model: run.model.clone(), weights: run.task.clone() }
    }

    fn input_rules(model: &MonoGrNetConfig) -> InputRules {
        model.input_spec().rules
    }

    fn targets(&self, _: &Frame, sample: &Sample, rng: &mut Pcg64) -> Targets {
        targets(&sample.labels, &self.model, &sample.camera, sample.size, rng)
    }

    fn batch(&self, samples: &[TrainSample<Targets>], device: Device) -> Expected {
        let all: Vec<&Targets> = samples.iter().map(|sample| &sample.targets).collect();
        Expected::new(&all, device)
    }

    /// The map that is read is the last, at 2D boxes first and then at 3D boxes.
    fn sampled(&self, place: usize, maps: &[Tensor], batch: &Expected) -> Tensor {
        sampled(&maps[maps.len() - 1], if place == 0 { &batch.read } else { &batch.read_again })
    }

    fn loss(&self, outputs: &[Tensor], batch: &Expected) -> (Tensor, LossTerms) {
        let [cells, depth, center, rezoom, depth_step, center_step, corners, corner_steps] =
            [0, 1, 2, 3, 4, 5, 6, 7].map(|place| &outputs[place]);
        let scores = self.model.scores() as i64;
        let weights = &self.weights;
        let logits = cells.narrow(1, 0, scores).to_kind(Kind::Float);
        let entropy = logits.cross_entropy_loss::<Tensor>(&batch.classes, None, Reduction::Mean, IGNORED, 0.0);
        let boxes = at_cells(&cells.narrow(1, scores, BOX_NUMBERS as i64), &batch.cells);
        let of_objects = |answer: &Tensor| answer.flatten(1, -1).to_kind(Kind::Float).index_select(0, &batch.objects);
        // A box goes on from what its cell says.
        let depths = at_cells(depth, &batch.object_cells) + of_objects(depth_step);
        let centers = at_cells(center, &batch.object_cells) + of_objects(center_step);
        let rezoomed = rezoom_loss(&rezoom.flatten(1, -1), scores, batch);
        let reached = of_objects(corners).tanh() * CORNER_REACH_M;
        let stepped = corner_steps.flatten(1, -1).to_kind(Kind::Float).tanh() * CORNER_STEP_M;
        let [_, counted] = batch.counts;
        let parts = [
            mean_l1(&boxes, &batch.boxes) * weights.box_weight,
            (mean_l1(&at_cells(depth, &batch.cells), &batch.depths) + mean_l1(&depths, &batch.object_depths))
                * weights.depth_weight,
            (mean_l1(&at_cells(center, &batch.cells), &batch.centers) + mean_l1(&centers, &batch.object_centers))
                * weights.center_weight,
            rezoomed * weights.rezoom_weight,
            mean_l1(&reached, &batch.corners) * weights.corner_weight,
            mean_l1(&stepped, &batch.steps) * (weights.refinement_weight * counted.min(1) as f64),
        ];
        let [boxes, depth, center, rezoom, corners, refinement] = parts.each_ref().map(|part| part.double_value(&[]));
        let cells = entropy.double_value(&[]);
        let objective = parts.iter().fold(entropy, |sum, part| sum + part);
        (objective, LossTerms { cells, boxes, depth, center, rezoom, corners, refinement })
    }
}

/// Cross entropy of the scores of 2D boxes, and L1 of what moves those of objects; zero without boxes.
fn rezoom_loss(found: &Tensor, scores: i64, batch: &Expected) -> Tensor {
    let [counted, _] = batch.counts;
    let logits = found.narrow(1, 0, scores).to_kind(Kind::Float);
    let entropy = logits.cross_entropy_loss::<Tensor>(&batch.box_classes, None, Reduction::Mean, IGNORED, 0.0);
    let moves = found.narrow(1, scores, BOX_NUMBERS as i64).to_kind(Kind::Float).index_select(0, &batch.objects);
    (entropy + mean_l1(&moves, &batch.moves)) * counted.min(1) as f64
}

impl Expected {
    /// Joins the targets of several images with one size of grid.
    pub fn new(all: &[&Targets], device: Device) -> Self {
        let grid @ [columns, rows] = all.first().map_or([1, 1], |targets| targets.grid);
        let class = |class: &CellClass| match class {
            CellClass::Background => 0,
            CellClass::Object(class) => 1 + *class as i64,
            CellClass::Ignored => IGNORED,
        };
        let classes: Vec<i64> = all.iter().flat_map(|targets| &targets.cells).map(class).collect();
        let cells = AtCells::new(all.iter().map(|one| &one.objects[..]), grid, |one: &CellTarget| one.cell, device);
        let is_object = |one: &&BoxTarget| one.object.is_some();
        let with_object: Vec<Vec<BoxTarget>> =
            all.iter().map(|one| one.boxes.iter().filter(is_object).cloned().collect()).collect();
        let objects = AtCells::new(with_object.iter().map(Vec::as_slice), grid, |one: &BoxTarget| one.cell, device);
        let boxes = || all.iter().flat_map(|targets| &targets.boxes);
        let places: Vec<i64> =
            boxes().enumerate().filter(|(_, one)| is_object(one)).map(|(place, _)| place as i64).collect();
        let mut box_classes: Vec<i64> =
            boxes().map(|one| one.object.as_ref().map_or(0, |object| 1 + object.class as i64)).collect();
        let mut read = areas(all, |one| one.boxes.iter().map(|one: &BoxTarget| one.box2d).collect());
        let mut read_again = areas(all, |one| one.corners.iter().map(|one: &CornerTarget| one.seen).collect());
        let mut steps: Vec<f32> =
            all.iter().flat_map(|one| &one.corners).flat_map(|one| one.steps).map(|step| step as f32).collect();
        let counts = [box_classes.len(), steps.len() / CORNER_NUMBERS];
        // Later parts get something to look at; it does not count.
        if counts[0] == 0 {
            read.iter_mut().take(1).for_each(|boxes| boxes.push(Box2d::new(0.0, 0.0, 1.0, 1.0)));
            box_classes.push(0);
        }
        if counts[1] == 0 {
            read_again.iter_mut().take(1).for_each(|boxes| boxes.push(Box2d::new(0.0, 0.0, 1.0, 1.0)));
            steps = vec![0.0; CORNER_NUMBERS];
        }
        let whole = |values: &[i64]| Tensor::from_slice(values).to_device(device);
        Self {
            classes: whole(&classes).view([-1, rows as i64, columns as i64]),
            cells: cells.cells(),
            boxes: cells.rows(|one| one.box2d),
            depths: cells.rows(|one| [one.depth_m - START_DEPTH_M]),
            centers: cells.rows(|one| one.center),
            read,
            box_classes: whole(&box_classes),
            objects: whole(&places),
            object_cells: objects.cells(),
            moves: objects.rows(|one| one.object.as_ref().map_or([0.0; BOX_NUMBERS], |object| object.step)),
            object_depths: objects
                .rows(|one| [one.object.as_ref().map_or(0.0, |object| object.depth_m - START_DEPTH_M)]),
            object_centers: objects.rows(|one| one.object.as_ref().map_or([0.0; 2], |object| object.center)),
            corners: objects.rows(|one| one.object.as_ref().map_or([0.0; CORNER_NUMBERS], |object| object.corners)),
            read_again,
            steps: Tensor::from_slice(&steps).view([-1, CORNER_NUMBERS as i64]).to_device(device),
            counts,
        }
    }
}

/// Boxes of each image, on the maps.
fn areas(all: &[&Targets], of: impl Fn(&Targets) -> Vec<Box2d>) -> Vec<Vec<Box2d>> {
    all.iter().map(|targets| of(targets).iter().map(on_map).collect()).collect()
}

/// [`super::sampler::sample`] on tensors, for a batch, with boxes on the map.
///
/// # Shapes
/// `map` `[batch, channels, height, width]` to `[boxes, channels, side, side]`.
pub fn sampled(map: &Tensor, boxes: &[Vec<Box2d>]) -> Tensor {
    let of_image = |(image, boxes): (usize, &Vec<Box2d>)| roi_align(&map.get(image as i64), boxes, [SIDE, SIDE], 1);
    let read = boxes.iter().enumerate().filter(|(_, boxes)| !boxes.is_empty()).map(of_image);
    Tensor::cat(&read.collect::<Vec<_>>(), 0)
}

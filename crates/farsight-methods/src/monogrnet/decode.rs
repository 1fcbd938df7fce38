//! From what the networks say to detections, in the three steps in which they say it.

use farsight_core::box3d::{EDGES, NEAR_PLANE_M, near_plane_crossing};
use farsight_core::detection::{DecodeOptions, View};
use farsight_core::nms::class_nms;
use farsight_core::score::SCORE_LIMITS;
use farsight_core::{Box2d, Box3d, Camera, Detection};
use farsight_runtime::TensorView;

use super::MonoGrNetConfig;
use super::codec::{
    CORNER_REACH_M, CORNER_STEP_M, Corners, box_from_corners, cell_camera, cell_center, corners_from, decode_box,
    decode_move, depth_of, global_corners,
};
use super::layout::{BOX_NUMBERS, CELL_STRIDE};
use crate::center_map::{image_box_of, value_at};

/// Boxes of one class that overlap by more than this in the image are of one object: neighbouring cells find the same.
const SAME_OBJECT_OVERLAP: f64 = 0.5;

/// So many more boxes are looked at than are asked for: several cells find one object.
const BOXES_A_DETECTION: usize = 4;

/// A longer step of a box is none, logarithm.
const MAX_STEP: f64 = 4.0;

/// What a cell has found.
#[derive(Debug, Clone, PartialEq)]
pub struct CellBox {
    /// The class that is likeliest there.
    pub class: usize,
    /// Its probability.
    pub score: f64,
    /// Column and row.
    pub cell: [usize; 2],
    /// Its box, grid.
    pub box2d: Box2d,
    /// Virtual depth of the centre, metres.
    pub depth_m: f64,
    /// Where the centre of the 3D box is seen, grid.
    pub center: [f64; 2],
}

/// What has been said of a box in the image: the second step.
#[derive(Debug, Clone, PartialEq)]
pub struct Placed {
    /// The class that is likeliest.
    pub class: usize,
    /// Its probability.
    pub score: f64,
    /// The box, grid.
    pub box2d: Box2d,
    /// Its corners, metres.
    pub corners: Corners,
    /// Where these are seen, grid.
    pub seen: Box2d,
}

/// The boxes that cells have found, likeliest first. `maps` are those of cells, depths and centres of one image.
pub fn cell_boxes(
    config: &MonoGrNetConfig,
    [cells, depth, center]: [&TensorView<'_>; 3],
    options: &DecodeOptions,
) -> Vec<CellBox> {
    let (rows, columns) = (cells.shape[1], cells.shape[2]);
    let scores = config.scores();
    let min_score = options.min_score(&config.classes);
    let at = |cell: [usize; 2]| {
        let logits: Vec<f64> = (0..scores).map(|channel| value_at(cells, channel, cell)).collect();
        let (class, score) = likeliest(&logits);
        let numbers: [f64; BOX_NUMBERS] = std::array::from_fn(|k| value_at(cells, scores + k, cell));
        let box2d = decode_box(numbers, cell);
        let [x, y] = cell_center(cell);
        let center = [x + value_at(center, 0, cell), y + value_at(center, 1, cell)];
        CellBox { class, score, cell, box2d, depth_m: depth_of(value_at(depth, 0, cell)), center }
    };
    let all = (0..rows).flat_map(|row| (0..columns).map(move |column| [column, row]));
    // The second look may raise a score, but not one that was nearly nothing.
    let is_box =
        |found: &CellBox| found.score > min_score / 2.0 && found.box2d.width() > 0.0 && found.box2d.height() > 0.0;
    let mut found: Vec<CellBox> = all.map(at).filter(is_box).collect();
    found.sort_by(|a, b| b.score.total_cmp(&a.score));
    found.truncate(BOXES_A_DETECTION * options.max_detections);
    found
}

/// The class, without the background, whose logit is the highest, and its probability among all.
fn likeliest(logits: &[f64]) -> (usize, f64) {
    let most = logits.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let sum: f64 = logits.iter().map(|logit| (logit - most).exp()).sum();
    let best = (1..logits.len()).fold(1, |best, class| if logits[class] > logits[best] { class } else { best });
    (best - 1, logits.get(best).map_or(0.0, |logit| (logit - most).exp() / sum))
}

/// What the second part says of a box that a cell has found; none where it comes out nowhere.
pub fn placed(
    config: &MonoGrNetConfig,
    found: &CellBox,
    [rezoom, depth_step, center_step, corners]: [&[f32]; 4],
    input_camera: &Camera,
) -> Option<Placed> {
    let logits: Vec<f64> = rezoom[..config.scores()].iter().map(|value| f64::from(*value)).collect();
    let (class, score) = likeliest(&logits);
    let step = std::array::from_fn(|k| f64::from(rezoom[config.scores() + k]).clamp(-MAX_STEP, MAX_STEP));
    let box2d = decode_move(&found.box2d, step);
    let depth_m = found.depth_m + f64::from(depth_step[0]);
    let center = [0, 1].map(|axis| found.center[axis] + f64::from(center_step[axis]));
    let center = config.codec().center(center, depth_m, input_camera);
    let local = corners_from(corners.try_into().ok()?, CORNER_REACH_M);
    let corners = global_corners(&local, center);
    let seen = Box2d::bounding(visible(&corners, &cell_camera(input_camera)))?;
    let numbers = [box2d.x1, box2d.y1, box2d.x2, box2d.y2, seen.x1, seen.y1, seen.x2, seen.y2, score];
    let is_there = center[2] > 0.0 && numbers.into_iter().chain(center).all(f64::is_finite);
    is_there.then_some(Placed { class, score, box2d, corners, seen })
}

/// Where corners are seen, as far as they and their edges lie before the camera.
fn visible<'a>(corners: &'a Corners, camera: &'a Camera) -> impl Iterator<Item = [f64; 2]> + 'a {
    let ahead = corners.iter().copied().filter(|corner| corner[2] >= NEAR_PLANE_M);
    let crossings = EDGES.iter().filter_map(|&[a, b]| near_plane_crossing(corners[a], corners[b]));
    ahead.chain(crossings).filter_map(|point| camera.pixel_from_point(point))
}

/// The detection that a box becomes by what the third part says of its corners; none without extent.
pub fn detection(config: &MonoGrNetConfig, placed: &Placed, steps: &[f32], view: &View) -> Option<Detection> {
    let steps = corners_from(steps.try_into().ok()?, CORNER_STEP_M);
    let corners: Corners =
        std::array::from_fn(|k| std::array::from_fn(|axis| placed.corners[k][axis] + steps[k][axis]));
    let box3d = box_from_corners(&corners);
    let [width, height] = view.image_size.map(|side| side as f64);
    let box2d = image_box_of(&placed.box2d, CELL_STRIDE, view).clamped(width, height);
    let (low, high) = SCORE_LIMITS;
    let class = &config.classes[placed.class];
    let score = placed.score.clamp(low, high);
    let score = match &class.score {
        Some(calibration) => calibration.probability(score, view.input_height_px(&box2d)).clamp(low, high),
        None => score,
    };
    is_there(&box3d).then(|| Detection { class: class.class.clone(), score, box2d, box3d, range_sigma_m: None })
}

fn is_there(box3d: &Box3d) -> bool {
    let size = [box3d.dimensions.height, box3d.dimensions.width, box3d.dimensions.length];
    let is_finite = box3d.location.iter().chain(&size).chain([&box3d.yaw]).all(|value| value.is_finite());
    is_finite && size.iter().all(|side| *side > 0.0) && box3d.depth_m() > 0.0
}

/// What is shown of the detections of one image, highest score first.
pub fn shown(config: &MonoGrNetConfig, mut found: Vec<Detection>, options: &DecodeOptions) -> Vec<Detection> {
    let min_score = options.min_score(&config.classes);
    found.retain(|detection| detection.score > min_score);
    found.sort_by(|a, b| b.score.total_cmp(&a.score));
    let mut found = class_nms(found, SAME_OBJECT_OVERLAP);
    found.truncate(options.max_detections);
    found
}

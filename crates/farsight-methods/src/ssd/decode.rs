//! From maps to detections.

use farsight_core::overlap::iou_2d;
use farsight_core::score::logistic;
use farsight_core::{Affine2, Box2d, Box3d, Camera, Detection, Dimensions, ObjectClass};
use farsight_runtime::TensorView;

use super::SsdConfig;
use super::anchors::{decoded, shapes};
use super::config::{BICYCLE, LABELS, PERSON, VEHICLES};
use super::network::BOXES;
use super::views::Window;
use crate::DetectError;

/// A box that ends within so many pixels of the input of a border that is not the image's may be cut off there.
const CUT_PX: f64 = 4.0;

/// By these shares of its width and height a box ends too early at either side and below: labels bound the projection
/// of a 3D box. Measured on 400 rendered scenes (vehicles: 4.6% at the sides, 4.2% below), and much the same in
/// photographs.
const SHORT_ASIDE: f64 = 0.04;
const SHORT_BELOW: f64 = 0.03;

/// No sound network encodes a box by a larger number: on noise it is a hundred, and an exponential follows.
const MAX_ENCODED: f64 = 1000.0;

/// A bicycle of which a person's box covers at least this share is ridden.
const RIDDEN_SHARE: f64 = 0.25;

/// What the network takes for what, by label, in pixels of the image.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Boxes {
    vehicles: Vec<(Box2d, f64)>,
    people: Vec<(Box2d, f64)>,
    bicycles: Vec<(Box2d, f64)>,
}

impl Boxes {
    /// Adds what a level's maps of a view say with a probability above `min_score`.
    /// `boxes` and `classes` are `[channels, rows, columns]`.
    ///
    /// # Errors
    /// When a box is out of all proportion.
    pub fn extend(
        &mut self,
        level: usize,
        boxes: &TensorView<'_>,
        classes: &TensorView<'_>,
        window: &Window,
        image_size: [usize; 2],
        min_score: f64,
    ) -> Result<(), DetectError> {
        let [rows, columns] = [boxes.shape[1], boxes.shape[2]];
        let area = rows * columns;
        let Some(back) = window.affine.inverse() else { return Ok(()) };
        for (anchor, shape) in shapes(level).into_iter().enumerate() {
            let plane =
                |map: &TensorView<'_>, channel: usize, cell: usize| f64::from(map.values[channel * area + cell]);
            for cell in 0..area {
                let logit = |label: usize| plane(classes, anchor * LABELS.len() + label, cell);
                let vehicle = VEHICLES.map(logit).into_iter().fold(f64::NEG_INFINITY, f64::max);
                let scores = [vehicle, logit(PERSON), logit(BICYCLE)].map(logistic);
                if scores.iter().all(|score| *score <= min_score) {
                    continue;
                }
                let encoded: [f64; 4] = std::array::from_fn(|part| plane(boxes, 4 * anchor + part, cell));
                if let Some(value) = encoded.into_iter().find(|value| value.is_nan() || value.abs() > MAX_ENCODED) {
                    let (model, output, limit) = (String::new(), BOXES[level], MAX_ENCODED);
                    return Err(DetectError::Value { model, output, value, limit });
                }
                let place = [cell % columns, cell / columns];
                let Some(seen) = seen(&decoded(level, place, shape, encoded), &back, window, image_size) else {
                    continue;
                };
                for (list, score) in [&mut self.vehicles, &mut self.people, &mut self.bicycles].into_iter().zip(scores)
                {
                    if score > min_score {
                        list.push((seen, score));
                    }
                }
            }
        }
        Ok(())
    }

    /// The detections, each thing once, highest score first: distances by similar triangles.
    pub fn detections(self, config: &SsdConfig, camera: &Camera, most: usize) -> Vec<Detection> {
        let [vehicles, people, bicycles] =
            [self.vehicles, self.people, self.bicycles].map(|boxes| suppressed(boxes, config.max_overlap));
        let one = |class: ObjectClass, box2d: Box2d, score: f64| detection(config, class, box2d, score, camera);
        let mut found: Vec<Detection> =
            vehicles.into_iter().filter_map(|(box2d, score)| one(ObjectClass::Car, box2d, score)).collect();
        found.extend(people.into_iter().filter_map(|(person, score)| {
            let ridden = bicycles.iter().find(|(bicycle, _)| is_ridden(bicycle, &person));
            match ridden {
                Some((bicycle, _)) => one(ObjectClass::Cyclist, person.union(bicycle), score),
                None => one(ObjectClass::Pedestrian, person, score),
            }
        }));
        found.sort_by(|a, b| b.score.total_cmp(&a.score));
        found.truncate(most);
        found
    }
}

/// A box of the input as pixels of the image, grown to what labels bound, clipped; none when it shows nothing, or is
/// cut by the view and not by the image.
fn seen(found: &Box2d, back: &Affine2, window: &Window, image_size: [usize; 2]) -> Option<Box2d> {
    let [width, height] = image_size.map(|side| side as f64);
    let [x1, y1] = back.apply([found.x1 - 0.5, found.y1 - 0.5]);
    let [x2, y2] = back.apply([found.x2 - 0.5, found.y2 - 0.5]);
    let [first, last] = window.rows;
    let margin = CUT_PX / window.scale;
    let is_cut = (first > 0.0 && y1 < first + margin) || (last < height && y2 > last - margin);
    let (aside, below) = (SHORT_ASIDE * (x2 - x1), SHORT_BELOW * (y2 - y1));
    let clipped = Box2d::new(x1 - aside, y1, x2 + aside, y2 + below).clamped(width, height);
    let numbers = [x1, y1, x2, y2];
    let shows = numbers.iter().all(|at| at.is_finite()) && clipped.width() >= 1.0 && clipped.height() >= 1.0;
    (shows && !is_cut).then_some(clipped)
}

/// Non-maximum suppression: of boxes that overlap by more than `max_overlap` the best.
fn suppressed(mut boxes: Vec<(Box2d, f64)>, max_overlap: f64) -> Vec<(Box2d, f64)> {
    boxes.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut kept: Vec<(Box2d, f64)> = Vec::new();
    for one in boxes {
        if kept.iter().all(|better| iou_2d(&better.0, &one.0) <= max_overlap) {
            kept.push(one);
        }
    }
    kept
}

fn is_ridden(bicycle: &Box2d, person: &Box2d) -> bool {
    let across = bicycle.x2.min(person.x2) - bicycle.x1.max(person.x1);
    let down = bicycle.y2.min(person.y2) - bicycle.y1.max(person.y1);
    across.max(0.0) * down.max(0.0) >= RIDDEN_SHARE * bicycle.area()
}

/// What has the usual size of its class and fills the box in height, seen from behind.
fn detection(config: &SsdConfig, class: ObjectClass, box2d: Box2d, score: f64, camera: &Camera) -> Option<Detection> {
    let [length, height, width] = config.reference(&class)?.dimensions_lhw;
    let depth_m = camera.focal_y() * height / box2d.height();
    let center = [f64::midpoint(box2d.x1, box2d.x2), f64::midpoint(box2d.y1, box2d.y2)];
    let [x, y, z] = camera.point_from_pixel(center, depth_m);
    let location = [x, y + height / 2.0, z];
    let box3d = Box3d { dimensions: Dimensions { height, width, length }, location, yaw: -std::f64::consts::FRAC_PI_2 };
    let is_there = location.iter().all(|number| number.is_finite()) && z > 0.0;
    is_there.then_some(Detection { class, score, box2d, box3d, range_sigma_m: Some(config.relative_error * z) })
}

//! More than one box around one thing: finding and judging them.

use crate::Detection;
use crate::overlap::{iou_2d, iou_bev};

/// `detections`, highest score first, without those that stand where a better one stands: seen from above they overlap
/// by more than `max_overlap` (intersection over union), whatever their classes. SMOKE has no such step; two things in
/// one place are one too many for whoever reads the answer.
pub fn bev_nms(detections: Vec<Detection>, max_overlap: f64) -> Vec<Detection> {
    without_repeats(detections, |better, other| iou_bev(&better.box3d, &other.box3d) > max_overlap)
}

/// `detections`, highest score first, without those that are a second box around what has a better one of the same
/// class: in the image they overlap by more than `max_overlap` (intersection over union).
pub fn class_nms(detections: Vec<Detection>, max_overlap: f64) -> Vec<Detection> {
    without_repeats(detections, |better, other| {
        better.class == other.class && iou_2d(&better.box2d, &other.box2d) > max_overlap
    })
}

/// Those of `detections` that repeat none of those kept before them.
fn without_repeats(detections: Vec<Detection>, repeats: impl Fn(&Detection, &Detection) -> bool) -> Vec<Detection> {
    let mut kept: Vec<Detection> = Vec::with_capacity(detections.len());
    for detection in detections {
        if !kept.iter().any(|better| repeats(better, &detection)) {
            kept.push(detection);
        }
    }
    kept
}

/// Boxes of one class that overlap by more than this in the image are of one object: of two cars of which one hides the
/// other they rarely do.
pub const SAME_OBJECT_OVERLAP: f64 = 0.7;

/// `detections` with scores that know that no two things stand in one place: of two boxes that mean one thing, the less
/// likely one is there only if the likelier one is not. Scores are probabilities, highest first before and after.
///
/// What has a lower score changes nothing for what has a higher one.
pub fn soft_suppression(mut detections: Vec<Detection>) -> Vec<Detection> {
    for place in 1..detections.len() {
        let (likelier, rest) = detections.split_at_mut(place);
        let nobody_else: f64 = likelier.iter().map(|other| beside(other, &rest[0])).product();
        rest[0].score *= nobody_else;
    }
    detections.sort_by(|a, b| b.score.total_cmp(&a.score));
    detections
}

/// How likely `detection` is there beside `other`, which is likelier: they may stand in one place, or be seen as one.
fn beside(other: &Detection, detection: &Detection) -> f64 {
    let in_one_place = (iou_bev(&other.box3d, &detection.box3d) / ONE_PLACE_OVERLAP).min(1.0);
    (1.0 - other.score * in_one_place) * (1.0 - other.score * seen_as_one(other, detection))
}

/// How surely two boxes are of one thing, 0 to 1, by how much of the image they share and how well their distances
/// agree; 0 of classes that are not taken for one another, and where an error bar is missing.
fn seen_as_one(a: &Detection, b: &Detection) -> f64 {
    let (Some(sigma_a), Some(sigma_b)) = (a.range_sigma_m, b.range_sigma_m) else { return 0.0 };
    if !a.class.is_like(&b.class) {
        return 0.0;
    }
    let [from, to] = ONE_SIGHT_OVERLAPS;
    let sigmas_apart = (a.box3d.depth_m() - b.box3d.depth_m()).abs() / sigma_a.hypot(sigma_b);
    let in_sight = (iou_2d(&a.box2d, &b.box2d) - from) / (to - from);
    in_sight.clamp(0.0, 1.0) * (1.0 - sigmas_apart / ONE_DEPTH_SIGMAS).max(0.0)
}

/// Boxes that overlap by more than this as seen from above, whatever their classes, are not off by their errors alone:
/// they mean one thing.
const ONE_PLACE_OVERLAP: f64 = 0.25;

/// Boxes that overlap by no more than the first in the image need not be of one thing; from the second on nothing but
/// their distances tells them apart.
const ONE_SIGHT_OVERLAPS: [f64; 2] = [0.4, SAME_OBJECT_OVERLAP];

/// Distances that differ by more joint error bars than this are two; the better they agree the likelier they are one.
const ONE_DEPTH_SIGMAS: f64 = 2.5;

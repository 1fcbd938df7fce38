//! Who found what: the greedy matching of the ranging protocol.

use farsight_core::overlap::iou_2d;
use farsight_core::{Detection, Label};

use super::options::RangingOptions;
use crate::{Difficulty, EvaluatedClass, Frame, Prediction};

/// A labelled object of an evaluated class, and how it was ranged if it was found.
#[derive(Debug, Clone, PartialEq)]
pub struct Target {
    /// Position of its frame in the set; frames are what the bootstrap draws.
    pub frame: u32,
    /// Position of its label in the frame.
    pub label: u32,
    /// Its class.
    pub class: EvaluatedClass,
    /// The easiest level at which it counts; `None` when it counts at none.
    pub difficulty: Option<Difficulty>,
    /// Height of its 2D box, pixels.
    pub height_px: f64,
    /// KITTI's occlusion, 0 to 3.
    pub occlusion: i32,
    /// Share outside the image.
    pub truncation: f64,
    /// True z, metres.
    pub depth_m: f64,
    /// True distance over the ground, metres.
    pub ground_m: f64,
    /// What the detection that took it says.
    pub found: Option<Measurement>,
}

/// The distance that a detection predicts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measurement {
    /// Position of the detection in its frame.
    pub prediction: u32,
    /// Score of the detection.
    pub score: f64,
    /// Predicted z, metres.
    pub depth_m: f64,
    /// Predicted distance over the ground, metres.
    pub ground_m: f64,
    /// Standard deviation that the detection gives its distance, metres.
    pub sigma_m: Option<f64>,
}

/// A detection that is none of anything: it took no object of its class, and is neither on a labelled object of
/// another class nor in a `DontCare` region (overlap, or covered share, of at least the options' `min_iou`), nor lower
/// than KITTI's Moderate objects. A second detection of one object is one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FalseAlarm {
    /// What class it is.
    pub class: EvaluatedClass,
    /// Its score.
    pub score: f64,
    /// Position of its frame.
    pub frame: u32,
    /// Position of the detection in its frame.
    pub prediction: u32,
}

/// The evaluated objects of `frame`, in the order of its labels, with what was found of them.
///
/// Detections whose score, location or 2D box is not a finite number take no part.
pub fn targets(frame: &Frame, index: u32, options: &RangingOptions) -> Vec<Target> {
    match_frame(frame, index, options).0
}

/// As [`targets`], and what was found that is not there.
pub fn match_frame(frame: &Frame, index: u32, options: &RangingOptions) -> (Vec<Target>, Vec<FalseAlarm>) {
    let mut false_alarms = Vec::new();
    let mut targets: Vec<_> =
        frame.labels.iter().zip(0..).map(|(label, position)| target(label, [index, position])).collect();
    for (prediction, position) in predictions_by_score(&frame.predictions, options) {
        let detection = &prediction.detection;
        let Some(class) = EvaluatedClass::of(&detection.class) else { continue };
        let free = frame.labels.iter().zip(&mut targets).filter_map(|(label, target)| {
            let target = target.as_mut().filter(|t| t.class == class && t.found.is_none())?;
            Some((iou_2d(&detection.box2d, &label.box2d), target))
        });
        let best = free
            .filter(|(iou, _)| *iou >= options.min_iou)
            .reduce(|best, next| if next.0 > best.0 { next } else { best });
        match best {
            Some((_, target)) => target.found = Some(measurement(detection, position)),
            None if is_excused(detection, class, frame, options) => {}
            None => false_alarms.push(FalseAlarm { class, score: detection.score, frame: index, prediction: position }),
        }
    }
    (targets.into_iter().flatten().collect(), false_alarms)
}

/// Whether a detection that took no object is no false alarm all the same.
fn is_excused(detection: &Detection, class: EvaluatedClass, frame: &Frame, options: &RangingOptions) -> bool {
    let is_other = |label: &Label| EvaluatedClass::of(&label.class) != Some(class);
    Difficulty::Moderate.ignores_detection(&detection.box2d)
        || frame.labels.iter().any(|label| is_other(label) && label.overlap_2d(&detection.box2d) >= options.min_iou)
}

/// Predictions that take part, highest score first, in file order where scores are equal.
fn predictions_by_score<'a>(predictions: &'a [Prediction], options: &RangingOptions) -> Vec<(&'a Prediction, u32)> {
    let takes_part = |prediction: &Prediction| {
        let Detection { score, box2d, box3d, .. } = &prediction.detection;
        let [x, _, z] = box3d.location;
        let numbers = [*score, x, z, box2d.x1, box2d.y1, box2d.x2, box2d.y2];
        numbers.iter().all(|v| v.is_finite()) && options.min_score.is_none_or(|min| *score >= min)
    };
    let mut taking_part: Vec<_> =
        predictions.iter().zip(0..).filter(|(prediction, _)| takes_part(prediction)).collect();
    // Stable, so equals stay in file order.
    taking_part.sort_by(|(a, _), (b, _)| b.detection.score.total_cmp(&a.detection.score));
    taking_part
}

fn target(label: &Label, [frame, position]: [u32; 2]) -> Option<Target> {
    let depth_m = label.box3d.depth_m();
    let ground_m = label.box3d.ground_distance_m();
    let class = EvaluatedClass::of(&label.class).filter(|_| depth_m.is_finite() && ground_m.is_finite())?;
    let Label { occlusion, truncation, .. } = *label;
    Some(Target {
        frame,
        label: position,
        class,
        difficulty: Difficulty::of(label),
        height_px: label.box2d.height(),
        occlusion,
        truncation,
        depth_m,
        ground_m,
        found: None,
    })
}

fn measurement(detection: &Detection, prediction: u32) -> Measurement {
    Measurement {
        prediction,
        score: detection.score,
        depth_m: detection.box3d.depth_m(),
        ground_m: detection.box3d.ground_distance_m(),
        sigma_m: detection.range_sigma_m,
    }
}

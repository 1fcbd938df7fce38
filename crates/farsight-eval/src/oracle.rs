//! What AP would be if one part of each detection were true: where the rest of the error comes from.
//!
//! Detections are matched to objects in the image, by the ranging protocol ([`match_frame`], all scores). Of each
//! matched detection some parts are replaced by those of its object; 2D boxes, scores and whatever matched nothing stay
//! as they are. A part's gain is a bound on what a better estimate of that part alone can bring, and gains do not add
//! up: one error often hides another.
//!
//! | part | replaced | kept |
//! |---|---|---|
//! | depth | z of the 3D centre | the direction in which the centre is seen |
//! | centre | the direction in which the 3D centre is seen: its projection in the image | z |
//! | size | height, width, length | the 3D centre |
//! | heading | yaw, and the angle of observation | the 3D centre |
//!
//! Directions are from the origin of the labels' coordinates (the reference camera in KITTI), so no calibration is
//! needed. The colour camera is 6 cm beside it: where a depth changes by 10%, a centre comes to lie 6 mm off.

use serde::Serialize;

use crate::bootstrap::Bootstrap;
use crate::compare::{ApComparisonRow, ap_rows, level_curves};
use crate::ranging::{RangingOptions, match_frame};
use crate::{EvaluatedClass, Evaluation, Frame};

/// A part of a detection that the truth can stand in for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum OraclePart {
    /// How far away it is.
    Depth,
    /// Where in the image its 3D centre is.
    Centre,
    /// Height, width and length.
    Size,
    /// Which way it faces.
    Heading,
}

/// What the truth of some parts brings.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OracleRow {
    /// The parts that were replaced.
    pub parts: Vec<OraclePart>,
    /// AP from above and in space with them (`value`) and without (`against`), of every class with detections.
    pub ap: Vec<ApComparisonRow>,
}

impl OraclePart {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Depth, Self::Centre, Self::Size, Self::Heading];

    /// The name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Depth => "depth",
            Self::Centre => "centre",
            Self::Size => "size",
            Self::Heading => "heading",
        }
    }
}

impl OracleRow {
    /// The gain of `with_truth`, an evaluation of frames with these `parts` replaced, over the frames as they are;
    /// `None` when the two are of other labels.
    pub fn new(
        parts: Vec<OraclePart>,
        with_truth: &Evaluation,
        as_they_are: &Evaluation,
        bootstrap: &Bootstrap,
    ) -> Option<Self> {
        let mut ap = Vec::new();
        for class in EvaluatedClass::ALL {
            ap.extend(ap_rows(level_curves(class), with_truth, as_they_are, bootstrap)?);
        }
        // Boxes in the image stay as they are.
        ap.retain(|row| row.metric != "2d");
        Some(Self { parts, ap })
    }
}

/// The frame with these parts of every matched detection replaced by its object's. What counts as matched is the
/// overlap of `options`; its least score does not matter here.
pub fn with_truth(frame: &Frame, parts: &[OraclePart], options: &RangingOptions) -> Frame {
    let options = RangingOptions { min_score: None, bootstrap: None, ..options.clone() };
    let (targets, _) = match_frame(frame, 0, &options);
    let mut frame = frame.clone();
    let has = |part| parts.contains(&part);
    for (target, found) in targets.iter().filter_map(|target| Some((target, target.found?))) {
        let label = &frame.labels[target.label as usize];
        let prediction = &mut frame.predictions[found.prediction as usize];
        let (truth, told) = (&label.box3d, &mut prediction.detection.box3d);
        let [x, y, z] = center(told.center(), truth.center(), has(OraclePart::Centre), has(OraclePart::Depth));
        if has(OraclePart::Size) {
            told.dimensions = truth.dimensions;
        }
        if has(OraclePart::Heading) {
            told.yaw = truth.yaw;
            prediction.alpha_rad = label.alpha;
        }
        told.location = [x, y + told.dimensions.height / 2.0, z];
    }
    frame
}

/// The centre in the direction and at the depth of whichever of both is wanted.
fn center(told: [f64; 3], truth: [f64; 3], true_direction: bool, true_depth: bool) -> [f64; 3] {
    if true_direction == true_depth {
        return if true_depth { truth } else { told };
    }
    let (along, depth_m) = if true_direction { (truth, told[2]) } else { (told, truth[2]) };
    // Behind the camera there is no direction in which it is seen.
    if along[2] > 0.0 && depth_m > 0.0 { along.map(|v| v * (depth_m / along[2])) } else { told }
}

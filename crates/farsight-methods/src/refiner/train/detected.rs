//! What a detector has in a frame: boxes of objects, by which the refiner learns to see them as it will be shown them,
//! and boxes of nothing, from which it learns what nothing looks like.

use std::path::Path;

use farsight_core::{Box2d, Detection, Label};
use farsight_data::kitti::read_results;
use farsight_data::{DatasetError, Frame};
use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

/// A detection that overlaps something labelled by more than this may be meant for it.
const MEANT_OVERLAP: f64 = 0.3;

/// Errors of a detector from one image of an object to the next, standard deviations: of the centre, as a share of the
/// box's sides, and of the logarithms of those.
const CENTER_ERROR: f64 = 0.03;
const SIDE_ERROR: f64 = 0.05;

/// A detector's boxes in the image of a frame.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct DetectedBoxes {
    /// By the place of the label that they are meant for.
    pub(super) of_labels: Vec<Vec<Box2d>>,
    /// Those on nothing that is labelled.
    pub(super) of_nothing: Vec<Box2d>,
}

impl DetectedBoxes {
    /// None at all.
    pub(super) fn none(frame: &Frame) -> Self {
        Self { of_labels: vec![Vec::new(); frame.labels.len()], of_nothing: Vec::new() }
    }

    /// Those of the results for `frame`, which stand in `folder`, of at least this height.
    ///
    /// # Errors
    /// When the frame's result file cannot be read.
    pub(super) fn read(folder: &Path, frame: &Frame, least_height_px: f64) -> Result<Self, DatasetError> {
        let mut boxes = Self::none(frame);
        for found in read_results(&folder.join(format!("{}.txt", frame.id)))? {
            if found.box2d.height() < least_height_px {
                continue;
            }
            let overlaps = frame.labels.iter().map(|label| label.overlap_2d(&found.box2d));
            let best = overlaps.enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
            match best.filter(|(_, overlap)| *overlap > MEANT_OVERLAP) {
                None => boxes.of_nothing.push(found.box2d),
                Some((place, _)) if is_meant(&found, &frame.labels[place]) => boxes.of_labels[place].push(found.box2d),
                Some(_) => {}
            }
        }
        Ok(boxes)
    }
}

/// Whether a detection that overlaps a label names its class or one that is easily taken for it.
fn is_meant(found: &Detection, label: &Label) -> bool {
    found.class.is_like(&label.class)
}

/// `found` as the detector might have had it in another image of the object.
pub(super) fn jittered(found: &Box2d, rng: &mut impl Rng) -> Box2d {
    let mut normal = |deviation: f64| deviation * rng.sample::<f64, _>(StandardNormal);
    let mut side = |low: f64, high: f64| {
        let center = f64::midpoint(low, high) + normal(CENTER_ERROR) * (high - low);
        let half = (high - low) / 2.0 * normal(SIDE_ERROR).exp();
        [center - half, center + half]
    };
    let ([x1, x2], [y1, y2]) = (side(found.x1, found.x2), side(found.y1, found.y2));
    Box2d::new(x1, y1, x2, y2)
}

//! What a detector took for objects and is none: from it the refiner learns what nothing looks like.

use std::path::Path;

use farsight_core::{Box3d, Detection, Label};
use farsight_data::kitti::read_results;
use farsight_data::{DatasetError, Frame};

/// A detection that overlaps anything labelled by more than this may be meant for it.
const MAX_OVERLAP: f64 = 0.3;

/// The false positives among a detector's results for `frame`, which stand in `folder`.
///
/// # Errors
/// When the frame's result file cannot be read.
pub(super) fn false_positives(folder: &Path, frame: &Frame, least_height_px: f64) -> Result<Vec<Box3d>, DatasetError> {
    let found = read_results(&folder.join(format!("{}.txt", frame.id)))?;
    let counts =
        |detection: &Detection| detection.box2d.height() >= least_height_px && is_on_nothing(detection, &frame.labels);
    Ok(found.into_iter().filter(counts).map(|detection| detection.box3d).collect())
}

fn is_on_nothing(detection: &Detection, labels: &[Label]) -> bool {
    labels.iter().all(|label| label.overlap_2d(&detection.box2d) <= MAX_OVERLAP)
}

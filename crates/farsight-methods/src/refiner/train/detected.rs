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

#[cfg(test)]
mod tests {
    use farsight_core::{Box3d, Camera, Dimensions, ObjectClass};
    use farsight_data::kitti::write_results;
    use image::RgbImage;
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    use super::*;

    fn label(class: ObjectClass, box2d: Box2d) -> Label {
        let dimensions = Dimensions { height: 1.5, width: 1.6, length: 3.9 };
        let box3d = Box3d { dimensions, location: [0.0, 1.6, 20.0], yaw: 0.0 };
        Label { class, truncation: 0.0, occlusion: 0, alpha: 0.0, box2d, box3d }
    }

    fn found(class: ObjectClass, box2d: Box2d) -> Detection {
        let Label { class, box2d, box3d, .. } = label(class, box2d);
        Detection { class, score: 0.5, box2d, box3d, range_sigma_m: None }
    }

    #[test]
    fn each_box_is_of_what_it_overlaps_most_or_of_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let lorry = Box2d::new(100.0, 50.0, 200.0, 150.0);
        let labels = vec![
            label(ObjectClass::Truck, lorry),
            label(ObjectClass::Car, Box2d::new(190.0, 100.0, 260.0, 150.0)),
            label(ObjectClass::Pedestrian, Box2d::new(300.0, 50.0, 330.0, 150.0)),
        ];
        let half = Box2d::new(100.0, 90.0, 200.0, 150.0);
        let nothing = Box2d::new(400.0, 50.0, 460.0, 100.0);
        let boxes = [
            found(ObjectClass::Car, half),
            found(ObjectClass::Car, lorry),
            // On a lorry, but too little of it; on a person, but no person; too low.
            found(ObjectClass::Car, Box2d::new(100.0, 130.0, 130.0, 150.0)),
            found(ObjectClass::Car, labels[2].box2d),
            found(ObjectClass::Car, Box2d::new(500.0, 50.0, 520.0, 65.0)),
            found(ObjectClass::Cyclist, Box2d::new(302.0, 50.0, 330.0, 150.0)),
            found(ObjectClass::Car, nothing),
        ];
        write_results(&folder.path().join("000001.txt"), &boxes).unwrap();
        let camera = Camera::from_intrinsics(700.0, 700.0, 300.0, 100.0).unwrap();
        let frame = Frame::new("000001", RgbImage::new(600, 200), camera, labels);
        let read = DetectedBoxes::read(folder.path(), &frame, 20.0).unwrap();
        assert_eq!(read.of_labels[0], [half, lorry]);
        assert!(read.of_labels[1].is_empty());
        assert_eq!(read.of_labels[2], [boxes[5].box2d]);
        assert_eq!(read.of_nothing, [boxes[2].box2d, nothing]);
        assert!(DetectedBoxes::read(folder.path(), &Frame { id: "000002".to_owned(), ..frame }, 20.0).is_err());
    }

    #[test]
    fn errors_of_boxes_are_shares_of_their_sides_and_none_in_the_mean() {
        let mut rng = Pcg64Mcg::seed_from_u64(7);
        let box2d = Box2d::new(100.0, 50.0, 300.0, 150.0);
        let count = 4000;
        let (mut centers, mut squares, mut widths) = (0.0, 0.0, 0.0);
        for _ in 0..count {
            let drawn = jittered(&box2d, &mut rng);
            let off = (f64::midpoint(drawn.x1, drawn.x2) - 200.0) / 200.0;
            centers += off;
            squares += off * off;
            widths += (drawn.width() / 200.0).ln();
            assert!(drawn.width() > 0.0 && drawn.height() > 0.0);
        }
        let count = f64::from(count);
        assert!((centers / count).abs() < 0.002 && (widths / count).abs() < 0.003);
        assert!(((squares / count).sqrt() - CENTER_ERROR).abs() < 0.002);
    }
}

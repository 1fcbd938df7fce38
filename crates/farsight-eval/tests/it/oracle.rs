//! What the truth replaces, and that it replaces nothing else.

use crate::common::awkward::{awkward_frames, label};
use farsight_core::depth_fusion::NORMAL_INTERVAL_SIGMAS;
use farsight_core::{Box3d, Detection, Dimensions, Label, ObjectClass};
use farsight_eval::oracle::{OraclePart, OracleRow, with_truth};
use farsight_eval::ranging::RangingOptions;
use farsight_eval::{Bootstrap, Difficulty, Evaluation, Frame};

const TOLERANCE: f64 = 1e-9;
const OPTIONS: RangingOptions =
    RangingOptions { min_score: None, min_iou: 0.5, bootstrap: None, interval_sigmas: NORMAL_INTERVAL_SIGMAS };

fn direction(box3d: &Box3d) -> [f64; 2] {
    let [x, y, z] = box3d.center();
    [x / z, y / z]
}

fn is_near(a: &[f64], b: &[f64]) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() < TOLERANCE)
}

fn sizes(box3d: &Box3d) -> [f64; 3] {
    let Dimensions { height, width, length } = box3d.dimensions;
    [height, width, length]
}

/// One car, and a detection of it with every part wrong.
fn scene() -> (Label, Frame) {
    let label = label(&ObjectClass::Car, 2.0, 20.0, 0);
    let box3d = Box3d {
        dimensions: Dimensions { height: 1.7, width: 1.8, length: 4.4 },
        location: [label.box3d.location[0] + 0.6, 1.9, 23.0],
        yaw: label.box3d.yaw + 0.4,
    };
    let detection =
        Detection { class: ObjectClass::Car, score: 0.3, box2d: label.box2d, box3d, range_sigma_m: Some(1.0) };
    (label.clone(), Frame::new("", vec![label], vec![detection]))
}

#[test]
fn each_part_is_replaced_and_no_other() {
    let (label, frame) = scene();
    let told = &frame.predictions[0];
    for part in OraclePart::ALL {
        let changed = &with_truth(&frame, &[part], &OPTIONS).predictions[0];
        let (now, before, truth) = (&changed.detection.box3d, &told.detection.box3d, &label.box3d);
        let whose = |is_true: bool| if is_true { truth } else { before };
        let name = part.name();
        assert!(is_near(&direction(now), &direction(whose(part == OraclePart::Centre))), "{name}: {now:?}");
        assert!(is_near(&[now.depth_m()], &[whose(part == OraclePart::Depth).depth_m()]), "{name}: {now:?}");
        assert!(is_near(&sizes(now), &sizes(whose(part == OraclePart::Size))), "{name}: {now:?}");
        assert!(is_near(&[now.yaw], &[whose(part == OraclePart::Heading).yaw]), "{name}: {now:?}");
        let alpha_rad = if part == OraclePart::Heading { label.alpha } else { told.alpha_rad };
        assert!(is_near(&[changed.alpha_rad], &[alpha_rad]), "{name}");
        let (now, before) = (&changed.detection, &told.detection);
        assert_eq!((now.score, now.box2d, now.range_sigma_m), (before.score, before.box2d, before.range_sigma_m));
    }
}

#[test]
fn all_parts_together_are_the_truth() {
    let (label, frame) = scene();
    let now = with_truth(&frame, &OraclePart::ALL, &OPTIONS).predictions[0].detection.box3d;
    assert!(is_near(&now.location, &label.box3d.location), "{now:?}");
    assert!(is_near(&sizes(&now), &sizes(&label.box3d)) && is_near(&[now.yaw], &[label.box3d.yaw]), "{now:?}");
}

#[test]
fn what_matches_nothing_stays_as_it_is() {
    let (label, mut frame) = scene();
    let mut elsewhere = frame.predictions[0].clone();
    (elsewhere.detection.box2d.x1, elsewhere.detection.box2d.x2) = (label.box2d.x1 + 900.0, label.box2d.x2 + 900.0);
    let mut person = frame.predictions[0].clone();
    person.detection.class = ObjectClass::Pedestrian;
    let second = frame.predictions[0].clone();
    frame.predictions.extend([elsewhere, person, second]);
    let changed = with_truth(&frame, &OraclePart::ALL, &OPTIONS);
    assert_eq!(changed.predictions[1..], frame.predictions[1..]);
    assert_ne!(changed.predictions[0], frame.predictions[0]);
    assert_eq!(with_truth(&frame, &[], &OPTIONS).predictions.len(), 4);
    // Nothing is seen behind the camera, so nothing can be moved along its ray.
    let mut behind = scene().1;
    behind.predictions[0].detection.box3d.location[2] = -3.0;
    for part in [OraclePart::Depth, OraclePart::Centre] {
        assert_eq!(with_truth(&behind, &[part], &OPTIONS), behind, "{part:?}");
    }
}

#[test]
fn the_gain_is_that_of_the_changed_frames() {
    let frames = awkward_frames(60, 6);
    let evaluation = |frames: &[Frame]| {
        let mut evaluation = Evaluation::new(OPTIONS);
        for frame in frames {
            evaluation.add(frame);
        }
        evaluation
    };
    let changed: Vec<_> = frames.iter().map(|frame| with_truth(frame, &[OraclePart::Depth], &OPTIONS)).collect();
    let (with, without) = (evaluation(&changed), evaluation(&frames));
    let bootstrap = Bootstrap { resamples: 40, seed: 0 };
    let row = OracleRow::new(vec![OraclePart::Depth], &with, &without, &bootstrap).unwrap();
    // Two metrics of two overlaps each, three levels, three classes.
    assert_eq!(row.ap.len(), 36);
    let [with, without] = [&with, &without].map(Evaluation::report);
    for cell in &row.ap {
        let overlaps = farsight_eval::ap::OverlapSet::ALL;
        let metric = farsight_eval::ap::Metric::ALL.into_iter().find(|metric| metric.name() == cell.metric).unwrap();
        let set =
            overlaps.into_iter().find(|set| (set.min_overlap(cell.class, metric) - cell.overlap).abs() < 1e-9).unwrap();
        let ap = |report: &farsight_eval::Report| report.ap.ap(set, metric, cell.class).unwrap().r40;
        let level = cell.group as usize;
        assert!((cell.value - ap(&with)[level]).abs() < TOLERANCE, "{cell:?}");
        assert!((cell.against - ap(&without)[level]).abs() < TOLERANCE, "{cell:?}");
    }
    let moderate = row.ap.iter().find(|cell| cell.metric == "3d" && cell.group == Difficulty::Moderate).unwrap();
    assert!(moderate.difference > 1.0 && moderate.excludes_zero, "{moderate:?}");
    assert!(moderate.interval.unwrap().low < moderate.difference);
}

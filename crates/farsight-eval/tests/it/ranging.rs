//! The ranging protocol: small scenes by hand, and two real result sets against an independent implementation.

use crate::common::RealSets;
use farsight_core::depth_fusion::NORMAL_INTERVAL_SIGMAS;
use farsight_core::{Box2d, Box3d, Detection, Dimensions, Label, ObjectClass};
use farsight_eval::ranging::{
    FalseAlarm, Group, MATCH_IOU, OperatingPoints, RangingComparison, RangingMetric, RangingOptions, RangingReport,
    Target, match_frame, targets,
};
use farsight_eval::{Bootstrap, Difficulty, EvaluatedClass, Frame, Prediction};

/// How far a figure may be from the independent one, metres or shares: the order of summation.
const TOLERANCE: f64 = 1e-9;

const NO_INTERVALS: RangingOptions =
    RangingOptions { min_score: None, min_iou: MATCH_IOU, bootstrap: None, interval_sigmas: NORMAL_INTERVAL_SIGMAS };

fn label(class: ObjectClass, left: f64, depth_m: f64) -> Label {
    Label {
        class,
        truncation: 0.0,
        occlusion: 0,
        alpha: 0.0,
        box2d: Box2d::new(left, 100.0, left + 100.0, 200.0),
        box3d: Box3d {
            dimensions: Dimensions { height: 1.5, width: 1.6, length: 4.0 },
            location: [0.0, 1.6, depth_m],
            yaw: 0.0,
        },
    }
}

fn prediction(like: &Label, score: f64, shift_px: f64, error_m: f64) -> Prediction {
    let b = like.box2d;
    let mut box3d = like.box3d;
    box3d.location[2] += error_m;
    let box2d = Box2d::new(b.x1 + shift_px, b.y1, b.x2 + shift_px, b.y2);
    Detection { class: like.class.clone(), score, box2d, box3d, range_sigma_m: Some(1.0) }.into()
}

#[test]
fn higher_scores_choose_first_and_each_object_is_taken_once() {
    let (near, far) = (label(ObjectClass::Car, 0.0, 10.0), label(ObjectClass::Car, 20.0, 20.0));
    // The second one lies nearer to the first object too, but comes too late.
    let predictions = vec![prediction(&near, 0.5, 5.0, 9.0), prediction(&near, 0.9, 0.0, 1.0)];
    let frame = Frame { id: String::new(), labels: vec![near, far], predictions };
    let targets = targets(&frame, 0, &NO_INTERVALS);
    assert_eq!(targets[0].found.unwrap().prediction, 1);
    assert_eq!(targets[1].found.unwrap().prediction, 0);
}

#[test]
fn an_overlap_of_exactly_one_half_is_enough() {
    let car = label(ObjectClass::Car, 0.0, 10.0);
    let third = 100.0 / 3.0;
    for (shift, is_found) in [(third - 1e-9, true), (third + 0.01, false)] {
        let frame = Frame {
            id: String::new(),
            predictions: vec![prediction(&car, 0.5, shift, 1.0)],
            labels: vec![car.clone()],
        };
        assert_eq!(targets(&frame, 0, &NO_INTERVALS)[0].found.is_some(), is_found, "{shift}");
    }
}

#[test]
fn what_is_none_of_anything_is_a_false_alarm() {
    let car = label(ObjectClass::Car, 0.0, 10.0);
    let van = label(ObjectClass::Van, 300.0, 20.0);
    // In any case, as average precision has it.
    let mut nobody_knows = label(ObjectClass::from_name("dontcare"), 600.0, -1000.0);
    nobody_knows.box2d.x2 = 1000.0;
    let nothing = label(ObjectClass::Car, 1100.0, 30.0);
    let mut low = nothing.clone();
    low.box2d.y2 = low.box2d.y1 + 24.9;
    let inside = Label { class: ObjectClass::Car, box2d: Box2d::new(700.0, 100.0, 800.0, 200.0), ..car.clone() };
    let as_car =
        |like: &Label, score: f64| prediction(&Label { class: ObjectClass::Car, ..like.clone() }, score, 0.0, 1.0);
    let predictions = vec![
        as_car(&car, 0.9),
        // The same car once more, nothing at all, and a cyclist where the car is: on an object, if another one.
        as_car(&car, 0.6),
        as_car(&nothing, 0.4),
        prediction(&Label { class: ObjectClass::Cyclist, ..car.clone() }, 0.8, 0.0, 0.0),
        as_car(&van, 0.8),
        as_car(&inside, 0.8),
        as_car(&low, 0.8),
    ];
    let frame = Frame { id: String::new(), labels: vec![car, van, nobody_knows], predictions };
    let (targets, false_alarms) = match_frame(&frame, 0, &NO_INTERVALS);
    let alarm = |score, prediction| FalseAlarm { class: EvaluatedClass::Car, score, frame: 0, prediction };
    assert_eq!(false_alarms, [alarm(0.6, 1), alarm(0.4, 2)]);

    let points = OperatingPoints::new(&targets, &false_alarms, 2);
    let [(EvaluatedClass::Car, rows)] = &points.classes[..] else { panic!("{points:?}") };
    let at = |score: f64| {
        let row = rows.iter().find(|row| (row.score - score).abs() < 1e-9).unwrap();
        (row.objects, row.found, row.false_alarms_per_frame, row.mae_z, row.median_abs_rel_z)
    };
    assert_eq!(at(0.3), (1, 1, 1.0, Some(1.0), Some(0.1)));
    assert_eq!(at(0.5), (1, 1, 0.5, Some(1.0), Some(0.1)));
    assert_eq!(at(0.95), (1, 0, 0.0, None, None));
}

#[test]
fn the_nearest_object_of_each_frame_is_asked_for() {
    let (near, far) = (label(ObjectClass::Car, 0.0, 10.0), label(ObjectClass::Car, 300.0, 40.0));
    let both = vec![near.clone(), far.clone()];
    let frames =
        [(both.clone(), vec![prediction(&far, 0.9, 0.0, 1.0)]), (both, vec![prediction(&near, 0.6, 0.0, 1.0)])];
    let targets: Vec<_> = (0..)
        .zip(frames)
        .flat_map(|(place, (labels, predictions))| {
            let frame = Frame { id: String::new(), labels, predictions };
            match_frame(&frame, place, &NO_INTERVALS).0
        })
        .collect();
    let points = OperatingPoints::new(&targets, &[], 3);
    let [(EvaluatedClass::Car, rows)] = &points.classes[..] else { panic!("{points:?}") };
    let missed = |score: f64| {
        let row = rows.iter().find(|row| (row.score - score).abs() < 1e-9).unwrap();
        (row.nearest_missed, row.frames_with_objects)
    };
    // A score too low to count is a miss.
    assert_eq!((missed(0.5), missed(0.7)), ((1, 2), (2, 2)));
}

#[test]
fn other_classes_weak_scores_and_numbers_that_are_none_take_no_part() {
    let car = label(ObjectClass::Car, 0.0, 10.0);
    let options = RangingOptions { min_score: Some(0.3), ..NO_INTERVALS };
    let mut van = prediction(&car, 0.9, 0.0, 0.0);
    van.detection.class = ObjectClass::Van;
    for prediction in [
        van,
        prediction(&car, 0.2, 0.0, 0.0),
        prediction(&car, f64::NAN, 0.0, 0.0),
        prediction(&car, 0.9, 0.0, f64::NAN),
    ] {
        let frame = Frame { id: String::new(), labels: vec![car.clone()], predictions: vec![prediction.clone()] };
        assert_eq!(targets(&frame, 0, &options)[0].found, None, "{prediction:?}");
    }
}

#[test]
fn figures_of_a_scene_by_hand() {
    // Four cars, three found: errors +1 at 10 m, -2 at 20 m, +3 at 30 m.
    let cars: Vec<_> = (1..=4).map(|i| label(ObjectClass::Car, 200.0 * f64::from(i), 10.0 * f64::from(i))).collect();
    let predictions = vec![
        prediction(&cars[0], 0.9, 0.0, 1.0),
        prediction(&cars[1], 0.8, 0.0, -2.0),
        prediction(&cars[2], 0.7, 0.0, 3.0),
    ];
    let frame = Frame { id: String::new(), labels: cars, predictions };
    let report = RangingReport::new(&targets(&frame, 0, &NO_INTERVALS), 1, &NO_INTERVALS);
    let all = report.group(EvaluatedClass::Car, Group::All).unwrap();
    assert_eq!((all.whole.objects, all.whole.found), (4, 3));
    let wanted = [
        (RangingMetric::Share, 0.75),
        (RangingMetric::MaeZ, 2.0),
        (RangingMetric::RmseZ, (14.0_f64 / 3.0).sqrt()),
        (RangingMetric::BiasZ, 2.0 / 3.0),
        (RangingMetric::AbsRelZ, 0.1),
        (RangingMetric::Delta105Z, 0.0),
        (RangingMetric::Delta125Z, 1.0),
    ];
    for (figure, want) in wanted {
        assert!((all.whole.metrics.get(figure).unwrap() - want).abs() < TOLERANCE, "{figure:?}");
    }
    // Three of four objects are needed for 0.7, so the weakest detection takes part.
    assert_eq!(all.fixed_recall.as_ref().map(|fixed| fixed.score), Some(0.7));
    let coverage = &all.calibration.as_ref().unwrap().rows[0];
    assert_eq!((coverage.count, coverage.within_1_sigma, coverage.within_2_sigma), (3, 1.0 / 3.0, 2.0 / 3.0));
    // Intervals are in proportion, and as wide as the model says.
    let log_off = |target: &Target| {
        let found = target.found.unwrap();
        (found.depth_m / target.depth_m).ln().abs() * found.depth_m / found.sigma_m.unwrap()
    };
    let found = targets(&frame, 0, &NO_INTERVALS);
    let mut offs: Vec<f64> = found.iter().filter(|target| target.found.is_some()).map(log_off).collect();
    offs.sort_unstable_by(f64::total_cmp);
    let told = RangingOptions { interval_sigmas: [offs[0] + 1e-9, offs[1] + 1e-9], ..NO_INTERVALS };
    let report = RangingReport::new(&found, 1, &told);
    let coverage = &report.group(EvaluatedClass::Car, Group::All).unwrap().calibration.as_ref().unwrap().rows[0];
    assert_eq!((coverage.within_50.share, coverage.within_90.share), (1.0 / 3.0, 2.0 / 3.0));
    let (bin, second) = &all.by_distance.0[1];
    assert_eq!(
        (*bin, second.objects, second.found, second.metrics.get(RangingMetric::BiasZ)),
        ("10-20", 1, 1, Some(1.0))
    );
}

#[test]
fn the_coverage_of_error_bars_is_counted_and_compared_with_a_normal_distribution() {
    let cars: Vec<_> = (0..4).map(|i| label(ObjectClass::Car, 200.0 * f64::from(i), 20.0)).collect();
    // Every error bar is 1 m.
    let predictions = cars.iter().zip([0.5, -1.5, 2.5, 3.5]).map(|(car, error)| prediction(car, 0.9, 0.0, error));
    let frame = Frame { id: String::new(), predictions: predictions.collect(), labels: cars };
    let report = RangingReport::new(&targets(&frame, 0, &NO_INTERVALS), 1, &NO_INTERVALS);
    let all = report.group(EvaluatedClass::Car, Group::All).unwrap();
    let coverage = &all.calibration.as_ref().unwrap().coverage;
    // The shares of a normal distribution are those of every table.
    for (step, sigmas, expected, observed) in
        [(0, 0.0, 0.0, 0.0), (10, 1.0, 0.682_689, 0.25), (20, 2.0, 0.954_500, 0.5), (30, 3.0, 0.997_300, 0.75)]
    {
        let point = coverage[step];
        assert_eq!((point.sigmas, point.observed), (sigmas, observed), "{point:?}");
        assert!((point.expected - expected).abs() < 1e-6, "{point:?}");
    }
    assert!(coverage.is_sorted_by(|a, b| a.expected < b.expected && a.observed <= b.observed));
}

#[test]
fn without_detections_there_are_shares_but_no_errors() {
    let frame = Frame { id: String::new(), labels: vec![label(ObjectClass::Cyclist, 0.0, 10.0)], predictions: vec![] };
    let report = RangingReport::new(&targets(&frame, 0, &NO_INTERVALS), 1, &RangingOptions::default());
    let group = report.group(EvaluatedClass::Cyclist, Group::Level(Difficulty::Easy)).unwrap();
    assert_eq!(group.whole.metrics.get(RangingMetric::Share), Some(0.0));
    assert_eq!(group.whole.metrics.get(RangingMetric::MaeZ), None);
    assert_eq!(group.fixed_recall, None);
    assert_eq!(report.classes.len(), 1);
}

#[test]
fn a_comparison_finds_a_real_difference_and_no_other() {
    let options = NO_INTERVALS;
    let set = |bias_m: f64| -> Vec<_> {
        let frames = (0..200_u32).map(|i| {
            let car = label(ObjectClass::Car, 0.0, 10.0 + f64::from(i % 50));
            // An error that both detectors share, and one of its own.
            let error = f64::from(i % 7) + bias_m;
            Frame { id: String::new(), predictions: vec![prediction(&car, 0.5, 0.0, error)], labels: vec![car] }
        });
        frames.zip(0..).flat_map(|(frame, i)| targets(&frame, i, &options)).collect()
    };
    let bootstrap = Bootstrap { resamples: 200, seed: 1 };
    let row = |bias_m| {
        let comparison = RangingComparison::new(&set(bias_m), &set(0.0), 200, &bootstrap).unwrap();
        comparison.rows.into_iter().find(|row| row.group == "moderate" && row.distance == "all").unwrap()
    };
    let worse = row(0.1).metrics.get(RangingMetric::MaeZ).unwrap();
    assert!(worse.excludes_zero && (worse.difference - 0.1).abs() < TOLERANCE, "{worse:?}");
    assert!(!row(0.0).metrics.get(RangingMetric::MaeZ).unwrap().excludes_zero);
    let shorter: Vec<_> = set(0.0).into_iter().skip(1).collect();
    assert!(RangingComparison::new(&set(0.0), &shorter, 200, &bootstrap).is_none());
}

#[test]
fn real_results_agree_with_an_independent_implementation() {
    let Some(sets) = RealSets::unpacked() else { return };
    let shared = farsight_testing::kitti("").unwrap();
    let expected = std::fs::read_to_string(shared.join("ranging_expected.json")).unwrap();
    let expected: serde_json::Value = serde_json::from_str(&expected).unwrap();
    for name in RealSets::NAMES {
        let frames = sets.frames(name);
        let found: Vec<_> = frames.iter().zip(0..).flat_map(|(f, i)| targets(f, i, &NO_INTERVALS)).collect();
        let report = RangingReport::new(&found, frames.len(), &NO_INTERVALS);
        let report = serde_json::to_value(&report).unwrap();
        for level in ["easy", "moderate", "hard"] {
            assert_agree(&report["car"][level], &expected[name][level], &format!("{name} {level}"));
        }
        for (bin, row) in expected[name]["moderate_by_distance"].as_object().unwrap() {
            assert_agree(&report["car"]["moderate"]["by_distance"][bin], row, &format!("{name} {bin}"));
        }
    }
}

fn assert_agree(report: &serde_json::Value, expected: &serde_json::Value, place: &str) {
    for (figure, want) in expected.as_object().unwrap() {
        let (got, want) = (report[figure].as_f64(), want.as_f64().unwrap());
        assert!(got.is_some_and(|got| (got - want).abs() < TOLERANCE), "{place} {figure}: {got:?}, expected {want}");
    }
}

//! Average precision against the official devkit: every case, and two real result sets.

use std::path::Path;

use crate::common::{self, RealSets};
use farsight_eval::ap::{ApAccumulator, ApReport, Curve, Metric, OverlapSet, RECALL_POINTS, ScoreThreshold};
use farsight_eval::{Difficulty, EvaluatedClass, Frame, Prediction};
use serde_json::Value;

/// Tolerances that the cases state.
const PRECISION_TOLERANCE: f64 = 1e-12;
const ORIENTATION_TOLERANCE: f64 = 1e-9;
const AP_TOLERANCE: f64 = 1e-9;

/// The curves of the real sets are written with six decimals, their AP with four.
const PLOT_TOLERANCE: f64 = 1.1e-6;
const TABLE_TOLERANCE: f64 = 1e-4;

fn report(frames: &[Frame]) -> ApReport {
    let mut set = ApAccumulator::new();
    for frame in frames {
        set.append(ApAccumulator::of_frame(frame));
    }
    set.report(None)
}

fn frames_of_case(case: &Path) -> Vec<Frame> {
    let (labels, results) = (case.join("gt"), case.join("det"));
    common::ids(&labels).iter().map(|id| common::frame(&labels, &results, id)).collect()
}

#[test]
fn every_case_equals_the_devkit() {
    let Some(cases) = farsight_testing::folder("FARSIGHT_EVAL_CASES", "../shared/kitti-eval", "") else { return };
    let mut cells = 0;
    for case in std::fs::read_dir(cases).unwrap().map(|entry| entry.unwrap().path()).filter(|path| path.is_dir()) {
        let expected = std::fs::read_to_string(case.join("expected.json")).unwrap();
        let expected: Value = serde_json::from_str(&expected).unwrap();
        let report = report(&frames_of_case(&case));
        let name = case.file_name().unwrap().to_string_lossy().into_owned();
        assert_eq!(report.has_orientation, expected["compute_aos"].as_bool().unwrap(), "{name}");
        for (set, set_name) in [(OverlapSet::Strict, "strict"), (OverlapSet::Loose, "loose")] {
            for metric in Metric::ALL.into_iter().filter(|m| !expected[set_name][m.name()].is_null()) {
                for class in EvaluatedClass::ALL {
                    let of_class = &expected[set_name][metric.name()][class.name()];
                    let orientation = &expected[set_name]["aos"][class.name()];
                    for difficulty in Difficulty::ALL {
                        let place = format!("{name} {set_name} {} {class} {difficulty}", metric.name());
                        let curve = report.curve(set, metric, class, difficulty);
                        assert_eq!(curve.is_some(), !of_class.is_null(), "{place}: evaluated or not");
                        let Some(curve) = curve else { continue };
                        assert_curve(curve, &of_class[difficulty.name()], &place);
                        if metric == Metric::Image {
                            assert_eq!(of_class["min_overlap"].as_f64(), Some(curve.min_overlap), "{place}");
                            assert_orientation(curve, &orientation[difficulty.name()], &place);
                        }
                        cells += 1;
                    }
                }
            }
        }
    }
    assert!(cells > 300, "only {cells} cells were compared");
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

#[allow(clippy::float_cmp)] // The thresholds are scores of the files, so they are equal or wrong.
fn assert_curve(curve: &Curve, expected: &Value, place: &str) {
    let count = |name: &str| expected[name].as_u64().unwrap() as usize;
    assert_eq!((curve.objects, curve.matched), (count("n_gt"), count("n_matched_scores")), "{place}: objects");
    let thresholds: Vec<f64> = curve.thresholds.iter().map(|threshold| threshold.score).collect();
    assert_eq!(thresholds, numbers(&expected["thresholds"]), "{place}: thresholds");
    for name in ["tp", "fp", "fn"] {
        let part = |threshold: &ScoreThreshold| match name {
            "tp" => threshold.true_positives,
            "fp" => threshold.false_positives,
            _ => threshold.false_negatives,
        };
        let got: Vec<f64> = curve.thresholds.iter().map(|threshold| part(threshold) as f64).collect();
        assert_eq!(got, numbers(&expected[name]), "{place}: {name}");
    }
    assert_points(&curve.precision, &expected["precision"], PRECISION_TOLERANCE, place);
    for (name, got) in [("ap_r40", curve.ap_r40()), ("ap_r11", curve.ap_r11())] {
        let want = expected[name].as_f64().unwrap();
        assert!((got - want).abs() < AP_TOLERANCE, "{place}: {name} {got}, expected {want}");
    }
    if let Some(sums) = expected.get("similarity_sum").filter(|sums| !sums.is_null()) {
        for (threshold, want) in curve.thresholds.iter().zip(numbers(sums)) {
            assert!((threshold.similarity - want).abs() <= want * ORIENTATION_TOLERANCE, "{place}: similarity");
        }
    }
}

fn assert_orientation(curve: &Curve, expected: &Value, place: &str) {
    assert_eq!(curve.orientation.is_some(), !expected.is_null(), "{place}: orientation");
    if let Some(points) = &curve.orientation {
        assert_points(points, &expected["precision"], ORIENTATION_TOLERANCE, place);
    }
}

fn assert_points(points: &[f64; RECALL_POINTS], expected: &Value, tolerance: f64, place: &str) {
    for (i, (got, want)) in points.iter().zip(numbers(expected)).enumerate() {
        assert!((got - want).abs() < tolerance, "{place}: point {i} is {got}, expected {want}");
    }
}

#[test]
fn real_results_equal_the_devkit() {
    let Some(sets) = RealSets::unpacked() else { return };
    let expected_ap = std::fs::read_to_string(sets.results.join("expected_ap.tsv")).unwrap();
    for name in RealSets::NAMES {
        let report = report(&sets.frames(name));
        for row in expected_ap.lines().map(|line| line.split('\t').collect::<Vec<_>>()).filter(|row| row[0] == name) {
            let class = EvaluatedClass::ALL.into_iter().find(|class| class.name() == row[2]).unwrap();
            let values = match row[3] {
                "2D" => report.ap(OverlapSet::Strict, Metric::Image, class),
                "BEV" => report.ap(OverlapSet::Strict, Metric::Bev, class),
                "3D" => report.ap(OverlapSet::Strict, Metric::Box3d, class),
                _ => report.aos(class),
            };
            let values = values.unwrap();
            for (got, want) in values.r40.iter().chain(&values.r11).zip(&row[4..]) {
                let want: f64 = want.parse().unwrap();
                assert!((got - want).abs() < TABLE_TOLERANCE, "{row:?}: {got}, expected {want}");
            }
        }
        assert!(assert_plots(&report, &sets.results.join(name).join("plot")) > 0, "{name} has no curves");
    }
}

/// Compares all curves that the devkit wrote: recall, easy, moderate, hard.
fn assert_plots(report: &ApReport, folder: &Path) -> usize {
    let mut compared = 0;
    for class in EvaluatedClass::ALL {
        let files = [("detection", 0), ("orientation", 1), ("detection_ground", 2), ("detection_3d", 3)];
        for (file, kind) in files {
            let path = folder.join(format!("{class}_{file}.txt"));
            let Ok(text) = std::fs::read_to_string(&path) else { continue };
            let metric = [Metric::Image, Metric::Image, Metric::Bev, Metric::Box3d][kind];
            for (i, line) in text.lines().enumerate() {
                let row: Vec<f64> = line.split_ascii_whitespace().map(|word| word.parse().unwrap()).collect();
                for difficulty in Difficulty::ALL {
                    let curve = report.curve(OverlapSet::Strict, metric, class, difficulty).unwrap();
                    let points = if kind == 1 { curve.orientation.unwrap() } else { curve.precision };
                    let (got, want) = (points[i], row[1 + difficulty as usize]);
                    assert!((got - want).abs() < PLOT_TOLERANCE, "{}:{}: {got}", path.display(), i + 1);
                    compared += 1;
                }
            }
        }
    }
    compared
}

#[test]
fn ground_truth_against_itself_is_perfect() {
    let Some(sets) = RealSets::unpacked() else { return };
    let frames: Vec<_> = sets
        .frames(RealSets::NAMES[0])
        .into_iter()
        .map(|frame| {
            let own = frame.labels.iter().filter(|label| EvaluatedClass::of(&label.class).is_some());
            let predictions = own.map(|label| {
                let (class, box2d, box3d) = (label.class.clone(), label.box2d, label.box3d);
                let detection = farsight_core::Detection { class, score: 1.0, box2d, box3d, range_sigma_m: None };
                Prediction { detection, alpha_rad: label.alpha }
            });
            Frame { predictions: predictions.collect(), ..frame }
        })
        .collect();
    let report = report(&frames);
    for class in EvaluatedClass::ALL {
        for set in OverlapSet::ALL {
            for metric in Metric::ALL {
                let values = report.ap(set, metric, class).unwrap();
                let all = values.r40.iter().chain(&values.r11);
                assert!(all.clone().all(|ap| (ap - 100.0).abs() < AP_TOLERANCE), "{class} {metric:?}: {values:?}");
            }
        }
        assert!(report.aos(class).unwrap().r40.iter().all(|aos| (aos - 100.0).abs() < AP_TOLERANCE), "{class}");
    }
}

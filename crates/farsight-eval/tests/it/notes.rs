//! What a report notes beside its figures, and when it does not.

use farsight_core::{Box2d, Box3d, Detection, Dimensions, Label, ObjectClass};
use farsight_eval::ranging::RangingOptions;
use farsight_eval::{Bootstrap, Evaluation, Frame, text};

const OBJECTS: usize = 100;

fn car() -> Label {
    let dimensions = Dimensions { height: 1.5, width: 1.6, length: 4.0 };
    let box3d = Box3d { dimensions, location: [1.0, 1.6, 20.0], yaw: 0.3 };
    let box2d = Box2d::new(600.0, 150.0, 700.0, 250.0);
    Label { class: ObjectClass::Car, truncation: 0.0, occlusion: 0, alpha: box3d.alpha(), box2d, box3d }
}

/// A hundred frames of one car each, of which the first ones are found with these scores.
fn evaluation(scores: &[f64]) -> Evaluation {
    let mut evaluation = Evaluation::new(RangingOptions { bootstrap: None, ..RangingOptions::default() });
    for frame in 0..OBJECTS {
        let Label { class, box2d, box3d, .. } = car();
        let found = scores.get(frame).map(|&score| Detection { class, score, box2d, box3d, range_sigma_m: None });
        evaluation.add(&Frame::new(format!("{frame:06}"), vec![car()], found.into_iter().collect()));
    }
    evaluation
}

/// `count` scores from `lowest` to `highest`.
fn scores(count: usize, [lowest, highest]: [f64; 2]) -> Vec<f64> {
    let share = |i: usize| i as f64 / (count - 1) as f64;
    (0..count).map(|i| lowest + (highest - lowest) * share(i)).collect()
}

fn notes(scores: &[f64], about: &str) -> Vec<String> {
    let notes = text::notes(&evaluation(scores).report());
    notes.into_iter().filter(|note| note.starts_with("car: ") && note.contains(about)).collect()
}

#[test]
fn results_that_were_cut_at_a_score_are_told() {
    let expected = "car: no detection has a score below 0.30; if they were cut there, AP is too low: the moderate 2d curve \
                    ends at a recall of 0.600, and precision counts as 0 beyond";
    assert_eq!(notes(&scores(60, [0.3, 0.9]), "cut"), [expected]);
    // 0.299 is below 0.30.
    assert!(notes(&scores(60, [0.299, 0.9]), "cut")[0].contains("below 0.29;"));
    for (what, quiet) in [
        ("a low score", [scores(59, [0.3, 0.9]), vec![0.05]].concat()),
        ("scores that are no probabilities", scores(60, [0.3, 7.0])),
        ("few detections", scores(49, [0.3, 0.9])),
        ("nothing left to find", scores(OBJECTS, [0.3, 0.9])),
        ("no detections", vec![]),
    ] {
        assert_eq!(notes(&quiet, "cut"), Vec::<String>::new(), "{what}");
    }
}

#[test]
fn a_recall_that_is_not_reached_is_told() {
    let expected = "car: fewer than 70% of the objects are found (easy, moderate, hard, all), so there are no errors at \
                    that recall";
    assert_eq!(notes(&scores(69, [0.05, 0.9]), "70%"), [expected]);
    assert_eq!(notes(&scores(70, [0.05, 0.9]), "70%"), Vec::<String>::new());
    // Of nothing there is no error at any recall, and another line says so.
    assert_eq!(notes(&[], "70%"), Vec::<String>::new());
}

#[test]
fn results_are_identical_when_no_figure_can_tell_them_apart() {
    let bootstrap = Bootstrap { resamples: 20, seed: 1 };
    let some = scores(60, [0.1, 0.9]);
    let compared = |others: &Evaluation| evaluation(&some).compared_with(others, &bootstrap).unwrap();
    let same = compared(&evaluation(&some));
    assert!(same.identical);
    let lines = text::comparison_lines(&same);
    assert_eq!(lines, ["identical: both results have the same detections in every frame"]);
    // Another score of one detection changes no distance.
    let mut others = some.clone();
    others[7] += 0.01;
    let other = compared(&evaluation(&others));
    assert!(!other.identical);
    assert!(text::comparison_lines(&other).iter().any(|line| line.ends_with("  the same")), "{other:?}");
    assert!(evaluation(&some).compared_with(&Evaluation::default(), &bootstrap).is_none());
}

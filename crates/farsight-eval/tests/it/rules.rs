//! The devkit's rules and quirks, each in the smallest scene that shows it (numbers of spec kitti-eval.md, section 2).

use farsight_core::{Box2d, Box3d, Detection, Dimensions, Label, ObjectClass};
use farsight_eval::ap::{ApAccumulator, ApReport, Curve, Metric, OverlapSet};
use farsight_eval::explain::{ExplainOptions, ObjectOutcome, PredictionOutcome, explain};
use farsight_eval::{Difficulty, EvaluatedClass, Frame, Prediction};

const CAR: EvaluatedClass = EvaluatedClass::Car;

fn class(name: &str) -> ObjectClass {
    ObjectClass::from_name(name)
}

/// An object 100 px high whose place in the image and in space is given by `slot`.
fn label(name: &str, slot: f64) -> Label {
    Label {
        class: class(name),
        truncation: 0.0,
        occlusion: 0,
        alpha: 0.3,
        box2d: Box2d::new(200.0 * slot, 100.0, 200.0 * slot + 100.0, 200.0),
        box3d: Box3d {
            dimensions: Dimensions { height: 1.5, width: 2.0, length: 4.0 },
            location: [10.0 * slot, 1.6, 20.0],
            yaw: 0.0,
        },
    }
}

fn high(label: Label, height_px: f64) -> Label {
    let box2d = Box2d { y2: label.box2d.y1 + height_px, ..label.box2d };
    Label { box2d, ..label }
}

fn prediction(like: &Label, score: f64) -> Prediction {
    let Label { class, box2d, box3d, alpha, .. } = like.clone();
    Prediction { detection: Detection { class, score, box2d, box3d, range_sigma_m: None }, alpha_rad: alpha }
}

fn report(labels: Vec<Label>, predictions: Vec<Prediction>) -> ApReport {
    ApAccumulator::of_frame(&Frame { id: String::new(), labels, predictions }).report(None)
}

fn curve(report: &ApReport, metric: Metric, difficulty: Difficulty) -> &Curve {
    report.curve(OverlapSet::Strict, metric, CAR, difficulty).unwrap()
}

/// Objects, true positives, false positives and misses at the lowest threshold of the moderate car curve; no
/// threshold: no counts.
fn counts(labels: Vec<Label>, predictions: Vec<Prediction>, metric: Metric) -> (usize, usize, usize, usize) {
    let report = report(labels, predictions);
    let curve = curve(&report, metric, Difficulty::Moderate);
    curve.thresholds.last().map_or((curve.objects, 0, 0, curve.objects), |l| {
        (curve.objects, l.true_positives, l.false_positives, l.false_negatives)
    })
}

#[test]
fn rules_7_and_9_labels_of_exactly_the_least_height_do_not_count_and_detections_do() {
    for (height, objects) in [(25.0, 0), (25.01, 1)] {
        let car = high(label("Car", 0.0), height);
        assert_eq!(counts(vec![car.clone()], vec![prediction(&car, 0.9)], Metric::Image).0, objects, "{height}");
    }
    // Rule 9: the detection is right at 25.0 px and nothing at 24.9.
    let car = high(label("Car", 0.0), 26.0);
    for (height, found) in [(25.0, 1), (24.9, 0)] {
        let detection = prediction(&high(car.clone(), height), 0.9);
        assert_eq!(counts(vec![car.clone()], vec![detection], Metric::Image).1, found, "{height}");
    }
}

#[test]
fn rule_5_one_angle_of_minus_ten_turns_aos_off_for_every_class() {
    let (car, walker) = (label("Car", 0.0), label("Pedestrian", 1.0));
    let mut ignored = prediction(&label("DontCare", 2.0), 0.1);
    ignored.alpha_rad = -10.0;
    let predictions = vec![prediction(&car, 0.9), prediction(&walker, 0.9), ignored];
    let report = report(vec![car, walker], predictions);
    assert_eq!(report.aos(CAR), None);
    assert_eq!(report.aos(EvaluatedClass::Pedestrian), None);
    assert!(report.ap(OverlapSet::Strict, Metric::Image, CAR).is_some());
}

#[test]
fn rule_6_a_class_is_evaluated_only_where_some_detection_has_what_it_takes() {
    let car = label("Car", 0.0);
    let evaluated = |change: &dyn Fn(&mut Detection)| {
        let mut detection = prediction(&car, 0.9);
        change(&mut detection.detection);
        let report = report(vec![car.clone()], vec![detection]);
        Metric::ALL.map(|metric| report.ap(OverlapSet::Strict, metric, CAR).is_some())
    };
    assert_eq!(evaluated(&|_| ()), [true, true, true]);
    assert_eq!(evaluated(&|d| d.box2d.x1 = -1.0), [false, true, true]);
    assert_eq!(evaluated(&|d| d.box3d.location[0] = -1000.0), [true, false, false]);
    assert_eq!(evaluated(&|d| d.box3d.location[1] = -1000.0), [true, true, false]);
    assert_eq!(evaluated(&|d| d.box3d.dimensions.width = 0.0), [true, false, false]);
    assert_eq!(evaluated(&|d| d.box3d.dimensions.height = -1.0), [true, true, false]);
    assert_eq!(report(vec![car.clone()], vec![]).ap(OverlapSet::Strict, Metric::Image, CAR), None);
}

#[test]
fn rule_8_neighbours_excuse_and_other_classes_do_not() {
    let target = label("Car", 0.0);
    for (other, wrong) in [("Van", 0), ("van", 0), ("Truck", 1), ("Pedestrian", 1)] {
        let neighbour = label(other, 1.0);
        let on_it = Prediction {
            detection: Detection { class: class("Car"), ..prediction(&neighbour, 0.95).detection },
            alpha_rad: 0.0,
        };
        let got = counts(vec![target.clone(), neighbour], vec![prediction(&target, 0.9), on_it], Metric::Image);
        assert_eq!(got, (1, 1, wrong, 0), "{other}");
    }
}

#[test]
fn quirk_1_a_small_detection_of_any_class_swallows_an_object() {
    // 24 px of a 30 px car: too small, and its class does not matter.
    let car = high(label("Car", 0.0), 30.0);
    let mut small = prediction(&high(label("Pedestrian", 0.0), 24.0), 0.99);
    small.detection.box3d = car.box3d;
    let other = label("Car", 1.0);
    let got = counts(vec![car, other.clone()], vec![small, prediction(&other, 0.5)], Metric::Image);
    // Neither true, nor false, nor missed.
    assert_eq!(got, (2, 1, 0, 0));
}

#[test]
fn rule_10_the_least_height_of_a_detection_depends_on_the_difficulty() {
    let car = label("Car", 0.0);
    for (height, wrong) in [(24.9, [0, 0, 0]), (30.0, [0, 1, 1]), (39.9, [0, 1, 1]), (40.0, [1, 1, 1])] {
        let nothing_there = prediction(&high(label("Car", 2.0), height), 0.95);
        let report = report(vec![car.clone()], vec![prediction(&car, 0.9), nothing_there]);
        let got =
            Difficulty::ALL.map(|difficulty| curve(&report, Metric::Image, difficulty).thresholds[0].false_positives);
        assert_eq!(got, wrong, "{height}");
    }
}

#[test]
fn rule_11_other_classes_taken_detections_and_lower_scores_take_no_part() {
    let car = label("Car", 0.0);
    // Another class: neither its better score nor its better overlap counts.
    let pedestrian = prediction(&Label { class: class("Pedestrian"), ..car.clone() }, 0.95);
    let own = prediction(&high(car.clone(), 90.0), 0.9);
    let set = report(vec![car.clone()], vec![pedestrian, own]);
    let thresholds = &curve(&set, Metric::Image, Difficulty::Moderate).thresholds;
    assert_eq!(
        thresholds
            .iter()
            .map(|threshold| (threshold.score, threshold.true_positives, threshold.false_positives))
            .collect::<Vec<_>>(),
        [(0.9, 1, 0)]
    );
    // Already taken: one detection on two objects finds one of them, in both passes.
    let two = vec![car.clone(), car.clone()];
    assert_eq!(curve(&report(two.clone(), vec![prediction(&car, 0.9)]), Metric::Image, Difficulty::Easy).matched, 1);
    assert_eq!(counts(two, vec![prediction(&car, 0.9)], Metric::Image), (2, 1, 0, 1));
    // Scores below the threshold are out, the threshold itself stays in.
    let other = label("Car", 1.0);
    let set = report(vec![car.clone(), other.clone()], vec![prediction(&car, 0.9), prediction(&other, 0.4)]);
    let thresholds = &curve(&set, Metric::Image, Difficulty::Easy).thresholds;
    let got: Vec<_> = thresholds
        .iter()
        .map(|threshold| (threshold.score, threshold.true_positives, threshold.false_negatives))
        .collect();
    assert_eq!(got, [(0.9, 1, 1), (0.4, 2, 0)]);
}

#[test]
fn rule_12_the_overlap_must_be_exceeded_not_reached() {
    let car = label("Car", 0.0);
    for (height, found) in [(70.0, 0), (70.01, 1)] {
        let got = counts(vec![car.clone()], vec![prediction(&high(car.clone(), height), 0.9)], Metric::Image);
        assert_eq!(got.1, found, "{height}");
    }
}

#[test]
fn rules_12_and_13_the_best_score_sets_the_limit_and_the_best_overlap_matches() {
    let car = label("Car", 0.0);
    let loose_but_sure = prediction(&high(car.clone(), 80.0), 0.9);
    let tight = prediction(&car, 0.4);
    let sets = vec![loose_but_sure, tight];
    let report = report(vec![car.clone()], sets.clone());
    // One true positive of the first pass: the better score.
    assert_eq!(curve(&report, Metric::Image, Difficulty::Moderate).thresholds[0].score, 0.9);
    let options = ExplainOptions { metric: Metric::Image, overlaps: OverlapSet::Strict, min_score: None };
    let told = explain(&Frame { id: String::new(), labels: vec![car], predictions: sets }, &options);
    assert_eq!(told.objects[0][0], ObjectOutcome::Found { prediction: 1, overlap: 1.0 });
    assert!(matches!(told.predictions[0][0], PredictionOutcome::FalsePositive { nearest: Some((0, _)) }));
}

#[test]
fn rule_15_dont_care_excuses_by_the_share_of_the_detection() {
    let car = label("Car", 0.0);
    let mut region = label("DontCare", 1.0);
    // The region is far larger than the detection in it, so their IoU is small.
    region.box2d = Box2d::new(150.0, 0.0, 1150.0, 300.0);
    region.box3d.location = [-1000.0; 3];
    let inside = prediction(&label("Car", 1.0), 0.95);
    let labels = vec![car.clone(), region];
    let predictions = vec![prediction(&car, 0.9), inside];
    assert_eq!(counts(labels.clone(), predictions.clone(), Metric::Image), (1, 1, 0, 0));
    assert_eq!(counts(labels, predictions, Metric::Bev), (1, 1, 1, 0), "from above there is no excuse");
}

#[test]
fn quirk_2_detections_without_3d_box_are_excused_from_above_by_any_dont_care() {
    let car = label("Car", 0.0);
    let nowhere = Box3d {
        dimensions: Dimensions { height: -1.0, width: -1.0, length: -1.0 },
        location: [-1000.0; 3],
        yaw: -10.0,
    };
    let region = Label { box3d: nowhere, ..label("DontCare", 3.0) };
    let mut flat = prediction(&label("Car", 1.0), 0.95);
    flat.detection.box3d = nowhere;
    let predictions = vec![prediction(&car, 0.9), flat];
    assert_eq!(counts(vec![car.clone(), region.clone()], predictions.clone(), Metric::Bev), (1, 1, 0, 0));
    assert_eq!(counts(vec![car.clone()], predictions.clone(), Metric::Bev), (1, 1, 1, 0));
    assert_eq!(counts(vec![car, region], predictions, Metric::Box3d), (1, 1, 1, 0));
}

#[test]
fn rule_17_the_limits_are_the_scores_that_the_devkit_chooses() {
    /// Objects, how many of them are found, and the places of the chosen scores, best first, as the devkit's own
    /// `getThresholds` gives them. With the aim at k / 40 instead of the sum of fortieths, the first two rows differ
    /// from the fourth score on.
    const CHOSEN: [(usize, usize, &[usize]); 5] = [
        (
            60,
            60,
            &[
                0, 1, 2, 4, 5, 6, 8, 9, 11, 12, 14, 15, 17, 19, 20, 22, 23, 25, 26, 28, 29, 31, 32, 34, 35, 37, 38, 40,
                41, 43, 44, 46, 47, 49, 50, 52, 53, 55, 56, 58, 59,
            ],
        ),
        (
            100,
            83,
            &[
                0, 2, 4, 7, 9, 11, 14, 16, 19, 21, 24, 26, 29, 31, 34, 37, 39, 42, 44, 47, 49, 52, 54, 57, 59, 62, 64,
                67, 69, 72, 74, 77, 79, 82,
            ],
        ),
        // The last score is always a threshold, however far its recall is from the one aimed at.
        (300, 4, &[0, 3]),
        (20, 5, &[0, 1, 2, 3, 4]),
        (1, 1, &[0]),
    ];
    for (objects, found, places) in CHOSEN {
        let labels: Vec<_> = (0..objects).map(|i| label("Car", i as f64)).collect();
        let score = |place: usize| 1.0 - place as f64 / 1000.0;
        // Sorting is the evaluator's work, so the worst come first.
        let predictions = (0..found).rev().map(|place| prediction(&labels[place], score(place))).collect();
        let report = report(labels.clone(), predictions);
        let thresholds = &curve(&report, Metric::Image, Difficulty::Easy).thresholds;
        let got: Vec<_> = thresholds.iter().map(|threshold| threshold.score).collect();
        let want: Vec<_> = places.iter().map(|&place| score(place)).collect();
        assert_eq!(got, want, "{found} of {objects}");
    }
}

#[test]
fn rule_18_precision_and_orientation_fall_and_end_in_zeros() {
    let cars: Vec<_> = (0..3).map(|i| label("Car", f64::from(i))).collect();
    let mut turned = prediction(&cars[1], 0.8);
    turned.alpha_rad += std::f64::consts::PI;
    let nothing_there = prediction(&label("Car", 5.0), 0.85);
    let report =
        report(cars.clone(), vec![prediction(&cars[0], 0.9), nothing_there, turned, prediction(&cars[2], 0.7)]);
    let curve = curve(&report, Metric::Image, Difficulty::Easy);
    // True of claimed at the three thresholds: 1/1, 2/3, 3/4. A false positive adds no similarity, nor does a car that
    // faces the other way.
    let (mut precision, mut orientation) = ([0.0; 41], [0.0; 41]);
    precision[..3].copy_from_slice(&[1.0, 0.75, 0.75]);
    orientation[..3].copy_from_slice(&[1.0, 0.5, 0.5]);
    assert_eq!(curve.precision, precision);
    assert_eq!(curve.orientation, Some(orientation));
}

#[test]
fn rule_19_r40_leaves_the_first_point_out_and_r11_takes_every_fourth() {
    for point in 0..41 {
        let mut precision = [0.0; 41];
        precision[point] = 1.0;
        let curve =
            Curve { min_overlap: 0.7, objects: 41, matched: 41, thresholds: vec![], precision, orientation: None };
        assert_eq!(curve.ap_r40(), if point == 0 { 0.0 } else { 2.5 }, "{point}");
        assert_eq!(curve.ap_r11(), if point % 4 == 0 { 100.0 / 11.0 } else { 0.0 }, "{point}");
    }
}

#[test]
fn rule_20_few_objects_cannot_reach_100() {
    for (objects, r40) in [(1, 0.0), (39, 95.0), (41, 100.0)] {
        let labels: Vec<_> = (0..objects).map(|i| label("Car", f64::from(i))).collect();
        let predictions = labels.iter().map(|l| prediction(l, 1.0)).collect();
        let report = report(labels, predictions);
        let got = curve(&report, Metric::Box3d, Difficulty::Easy).ap_r40();
        assert!((got - r40).abs() < 1e-9, "{objects}: {got}");
    }
}

#[test]
fn rule_21_nothing_of_nothing_counts_as_zero_and_spoils_no_other_point() {
    // First pass: the small detection has the better score and goes to the van, so the car's own gives the threshold
    // 0.9. Second pass: the van takes the larger one, the car is left with the small one, and nothing is right, wrong
    // or missed.
    let (van, car, other) = (label("Van", 0.0), label("Car", 0.0), label("Car", 1.0));
    let mut small = prediction(&high(car.clone(), 20.0), 0.95);
    small.detection.box3d = car.box3d;
    let alone = (vec![van, car.clone()], vec![small, prediction(&car, 0.9)]);
    let report_alone = report(alone.0.clone(), alone.1.clone());
    let got = curve(&report_alone, Metric::Bev, Difficulty::Moderate);
    let counts: Vec<_> = got
        .thresholds
        .iter()
        .map(|threshold| {
            (threshold.score, threshold.true_positives, threshold.false_positives, threshold.false_negatives)
        })
        .collect();
    assert_eq!(counts, [(0.9, 0, 0, 0)]);
    assert_eq!(got.precision, [0.0; 41]);
    // With another car found at a lower threshold, the maximum over 0 / 0 and what follows is what follows.
    let labels = [alone.0, vec![other.clone()]].concat();
    let predictions = [alone.1, vec![prediction(&other, 0.5)]].concat();
    let report = report(labels, predictions);
    let got = curve(&report, Metric::Bev, Difficulty::Moderate);
    assert_eq!((got.thresholds[0].true_positives, got.thresholds[0].false_positives), (0, 0));
    assert_eq!(got.precision[..3], [1.0, 1.0, 0.0]);
}

#[test]
fn rule_22_a_score_that_is_no_number_is_wrong_at_every_limit() {
    let (car, empty) = (label("Car", 0.0), label("Car", 1.0));
    let predictions = vec![prediction(&car, 0.9), prediction(&empty, f64::NAN)];
    assert_eq!(counts(vec![car], predictions, Metric::Image), (1, 1, 1, 0));
}

#[test]
fn rule_27_boxes_with_swapped_edges_are_false_positives() {
    let car = label("Car", 0.0);
    let mut swapped = prediction(&car, 0.95);
    let Box2d { x1, y1, x2, y2 } = swapped.detection.box2d;
    swapped.detection.box2d = Box2d::new(x2, y2, x1, y1);
    assert_eq!(counts(vec![car.clone()], vec![prediction(&car, 0.9), swapped], Metric::Image), (1, 1, 1, 0));
}

#[test]
fn nobody_counts_in_an_empty_set() {
    let report = report(vec![], vec![]);
    assert_eq!(report.ap(OverlapSet::Strict, Metric::Image, CAR), None);
}

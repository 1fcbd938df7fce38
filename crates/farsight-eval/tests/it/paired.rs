//! Two arms over several seeds, against the same draws evaluated from scratch.

use crate::common::awkward::{awkward_frames, label};
use farsight_core::{Detection, ObjectClass};
use farsight_eval::ap::{CurveSpec, Metric, OverlapSet};
use farsight_eval::paired::{Endpoint, PairedDifference, PairedRuns};
use farsight_eval::ranging::{Group, RangingComparison, RangingMetric, RangingOptions, Slice};
use farsight_eval::{Bootstrap, Difficulty, EvaluatedClass, Evaluation, Frame, Part};
use rand::RngExt;
use rand_pcg::Pcg64;

const TOLERANCE: f64 = 1e-9;
const CAR: EvaluatedClass = EvaluatedClass::Car;
const AP: Endpoint = Endpoint::Ap(CurveSpec {
    overlaps: OverlapSet::Loose,
    metric: Metric::Box3d,
    class: CAR,
    difficulty: Difficulty::Hard,
    part: Part::Whole,
});
const MODERATE: Slice = Slice { group: Group::Level(Difficulty::Moderate), part: Part::Whole };
const MAE: Endpoint = Endpoint::Ranging { metric: RangingMetric::MaeZ, class: CAR, slice: MODERATE };
const FEW_ALARMS: f64 = 0.3;
const FOUND: Endpoint = Endpoint::FoundAtAlarms { class: CAR, most_per_frame: FEW_ALARMS };

fn evaluation(frames: &[Frame]) -> Evaluation {
    let mut evaluation = Evaluation::new(RangingOptions { bootstrap: None, ..RangingOptions::default() });
    for frame in frames {
        evaluation.add(frame);
    }
    evaluation
}

/// The same frames with every detection some way off and of another score, differently for each seed.
fn disturbed(frames: &[Frame], spread_m: f64, seed: u128) -> Vec<Frame> {
    let mut random = Pcg64::new(seed, 77);
    let mut frames = frames.to_vec();
    for prediction in frames.iter_mut().flat_map(|frame| &mut frame.predictions) {
        prediction.detection.box3d.location[2] += random.random_range(-spread_m..spread_m);
        prediction.detection.score += random.random_range(-0.2..0.2);
    }
    frames
}

/// The share of cars that is found at the lowest score with few false alarms, from the report; NaN without cars.
fn found_at_few_alarms(arm: &Evaluation) -> f64 {
    let operating = arm.report().operating;
    let Some((_, rows)) = operating.classes.iter().find(|(class, _)| *class == CAR) else { return f64::NAN };
    let lowest = rows.iter().find(|row| row.false_alarms_per_frame <= FEW_ALARMS);
    lowest.map_or(0.0, |row| row.found as f64 / row.objects as f64)
}

/// AP, MAE and the share found of both arms on frames as if there were so many of each, from scratch.
fn from_scratch(arms: [&[Frame]; 2], drawn: &[u32]) -> [[f64; 2]; 3] {
    let repeated = arms.map(|frames| {
        let frames = frames.iter().zip(drawn).flat_map(|(frame, count)| vec![frame.clone(); *count as usize]);
        evaluation(&frames.collect::<Vec<_>>())
    });
    let ap = repeated.each_ref().map(|arm| {
        let report = arm.report();
        report.ap.curve(OverlapSet::Loose, Metric::Box3d, CAR, Difficulty::Hard).unwrap().ap_r40()
    });
    let [ours, theirs] = &repeated;
    let none = Bootstrap { resamples: 0, seed: 0 };
    let compared = RangingComparison::new(ours.targets(), theirs.targets(), ours.frames(), &none).unwrap();
    let row =
        compared.rows.into_iter().find(|row| row.class == CAR && row.group == "moderate" && row.distance == "all");
    let mae = row.unwrap().metrics.get(RangingMetric::MaeZ).unwrap();
    [ap, [mae.value, mae.against], repeated.each_ref().map(found_at_few_alarms)]
}

#[test]
fn resamples_of_seeds_and_frames_equal_evaluations_from_scratch() {
    let base = awkward_frames(18, 3);
    let arms: Vec<[Vec<Frame>; 2]> =
        (0..3).map(|seed| [disturbed(&base, 0.5, seed), disturbed(&base, 1.5, 10 + seed)]).collect();
    let evaluated: Vec<_> = arms.iter().map(|[a, b]| [evaluation(a), evaluation(b)]).collect();
    let runs = PairedRuns::new(evaluated.iter().map(|[a, b]| (a, b)).collect()).unwrap();
    let bootstrap = Bootstrap { resamples: 41, seed: 8 };
    let found: Vec<PairedDifference> =
        runs.compare(&[AP, MAE, FOUND], &bootstrap).into_iter().map(Option::unwrap).collect();

    let ones = vec![1; base.len()];
    let all: Vec<_> = arms.iter().map(|[a, b]| from_scratch([a, b], &ones)).collect();
    let mut resamples = [Vec::new(), Vec::new(), Vec::new()];
    for index in 0..bootstrap.resamples {
        let drawn = bootstrap.draw(base.len(), index);
        let seeds = bootstrap.draw_runs(arms.len(), index);
        let mut sums = [0.0; 3];
        for ([a, b], count) in arms.iter().zip(seeds) {
            let values = from_scratch([a, b], &drawn);
            (0..3).for_each(|i| sums[i] += f64::from(count) * (values[i][0] - values[i][1]) / arms.len() as f64);
        }
        (0..3).for_each(|i| resamples[i].push(sums[i]));
    }
    for (i, difference) in found.iter().enumerate() {
        let mean = |arm: usize| all.iter().map(|values| values[i][arm]).sum::<f64>() / 3.0;
        assert!((difference.value - mean(0)).abs() < TOLERANCE, "{difference:?}");
        assert!((difference.against - mean(1)).abs() < TOLERANCE, "{difference:?}");
        for (got, values) in difference.by_seed.iter().zip(&all) {
            assert!((got - (values[i][0] - values[i][1])).abs() < TOLERANCE, "{difference:?}");
        }
        // 41 values: the ends of the interval are the second and the last but one.
        resamples[i].sort_by(f64::total_cmp);
        let interval = difference.interval.unwrap();
        assert!((interval.low - resamples[i][1]).abs() < TOLERANCE, "{interval:?}");
        assert!((interval.high - resamples[i][39]).abs() < TOLERANCE, "{interval:?}");
        assert!(interval.low < interval.high);
    }
}

#[test]
fn the_same_results_do_not_differ() {
    let arm = evaluation(&awkward_frames(20, 4));
    let runs = PairedRuns::new(vec![(&arm, &arm), (&arm, &arm)]).unwrap();
    for difference in runs.compare(&[AP, MAE, FOUND], &Bootstrap { resamples: 50, seed: 0 }) {
        let difference = difference.unwrap();
        let interval = difference.interval.unwrap();
        assert!(
            [difference.difference, interval.low, interval.high].iter().all(|value| *value == 0.0),
            "{difference:?}"
        );
        assert!((difference.p_value(0.0) - 1.0).abs() < TOLERANCE);
        let alone = difference.value_interval.unwrap();
        assert!(alone.low < alone.high && (alone.low..=alone.high).contains(&difference.value), "{difference:?}");
    }
}

/// One car a frame, found `offset_m` too far away in every frame.
fn offset(frames: usize, offset_m: f64) -> Evaluation {
    let frames = (0..frames).map(|i| {
        let label = label(&ObjectClass::Car, 1.0, 10.0 + i as f64, 0);
        let mut box3d = label.box3d;
        box3d.location[2] += offset_m;
        let (class, box2d) = (label.class.clone(), label.box2d);
        Frame::new("", vec![label], vec![Detection { class, score: 0.9, box2d, box3d, range_sigma_m: None }])
    });
    evaluation(&frames.collect::<Vec<_>>())
}

#[test]
fn what_differs_between_seeds_only_widens_the_interval() {
    // Errors do not depend on the frame, so nothing but the draw of the seeds moves the difference.
    let (low, high, base) = (offset(20, 0.5), offset(20, 0.9), offset(20, 1.0));
    let bootstrap = Bootstrap { resamples: 400, seed: 1 };
    let interval = |pairs| {
        let difference = PairedRuns::new(pairs).unwrap().compare(&[MAE], &bootstrap).remove(0).unwrap();
        (difference.difference, difference.interval.unwrap())
    };
    let (difference, one) = interval(vec![(&low, &base)]);
    assert!([difference, one.low, one.high].iter().all(|value| (value + 0.5).abs() < TOLERANCE), "{one:?}");
    let (difference, two) = interval(vec![(&low, &base), (&high, &base)]);
    assert!((difference + 0.3).abs() < TOLERANCE);
    assert!((two.low + 0.5).abs() < TOLERANCE && (two.high + 0.1).abs() < TOLERANCE, "{two:?}");
}

#[test]
fn an_arm_that_finds_nothing_has_an_ap_of_0_and_no_errors() {
    let frames = awkward_frames(20, 5);
    let silent: Vec<_> = frames.iter().map(|frame| Frame { predictions: Vec::new(), ..frame.clone() }).collect();
    let (arm, silent) = (evaluation(&frames), evaluation(&silent));
    let runs = PairedRuns::new(vec![(&arm, &silent)]).unwrap();
    let differences = runs.compare(&[AP, MAE, FOUND], &Bootstrap { resamples: 20, seed: 0 });
    let ap = differences[0].as_ref().unwrap();
    assert!(ap.against == 0.0 && ap.value > 0.0, "{ap:?}");
    assert_eq!(ap.value_interval, ap.interval, "what it is less nothing is what it is");
    assert_eq!(differences[1], None);
}

#[test]
fn other_labels_cannot_be_compared() {
    let (one, other) = (evaluation(&awkward_frames(5, 1)), evaluation(&awkward_frames(5, 2)));
    assert!(PairedRuns::new(vec![(&one, &one), (&one, &other)]).is_none());
    assert!(PairedRuns::new(Vec::new()).is_none());
}

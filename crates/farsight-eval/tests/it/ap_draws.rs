//! AP of frames drawn at random, against the evaluation of the drawn frames from scratch.

use crate::common::{self, awkward::awkward_frames};
use farsight_eval::ap::{ApAccumulator, ApSample, CurveSpec, Metric, OverlapSet};
use farsight_eval::{Bootstrap, Difficulty, EvaluatedClass, Frame, Part};
use rand::RngExt;
use rand_pcg::Pcg64;

/// Both take the same steps; only the means over the points of recall may round differently.
const TOLERANCE: f64 = 1e-10;

fn set(frames: &[Frame]) -> ApAccumulator {
    let mut set = ApAccumulator::new();
    for frame in frames {
        set.append(ApAccumulator::of_frame(frame));
    }
    set
}

/// Every curve of the devkit, the loose ones, and some over parts of the data.
fn curves() -> Vec<CurveSpec> {
    let mut curves = Vec::new();
    for class in EvaluatedClass::ALL {
        for metric in Metric::ALL {
            for overlaps in OverlapSet::ALL {
                for difficulty in Difficulty::ALL {
                    let whole = CurveSpec::new(overlaps, metric, class, difficulty);
                    curves.push(whole);
                    if class == EvaluatedClass::Car && difficulty == Difficulty::Hard {
                        let parts = Part::divisions().into_iter().flatten();
                        curves.extend(parts.map(|(_, part)| whole.of_part(part)));
                    }
                }
            }
        }
    }
    curves
}

/// A few draws of the frames against the same frames evaluated as if there were so many of them. Returns how many
/// answers were compared.
fn assert_draws_equal_evaluations(frames: &[Frame], name: &str) -> usize {
    let curves = curves();
    let outcomes = set(frames).outcomes(&curves);
    let mut random = Pcg64::new(7, 7);
    let mut compared = 0;
    for draw in 0..6 {
        let mut drawn = vec![0_u32; frames.len()];
        if draw == 0 {
            drawn.fill(1);
        } else {
            (0..frames.len()).for_each(|_| drawn[random.random_range(0..frames.len())] += 1);
        }
        let repeated = frames.iter().zip(&drawn).flat_map(|(frame, count)| vec![frame.clone(); *count as usize]);
        let evaluated = set(&repeated.collect::<Vec<_>>());
        let report = evaluated.report(None);
        let ones = vec![1; drawn.iter().sum::<u32>() as usize];
        for ((curve, outcomes), scratch) in curves.iter().zip(&outcomes).zip(evaluated.outcomes(&curves)) {
            // A draw without any detection of the class is not evaluated; its frames without a detection find nothing.
            let (Some(outcomes), Some(scratch)) = (outcomes, scratch) else { continue };
            let place = format!("{name}, draw {draw}, {curve:?}");
            let got = outcomes.drawn_ap(&drawn);
            assert_same(got, scratch.drawn_ap(&ones), &place);
            let CurveSpec { overlaps, metric, class, difficulty, part } = *curve;
            if part == Part::Whole {
                let devkit = report.curve(overlaps, metric, class, difficulty).unwrap();
                let (r40, r11) = (devkit.ap_r40(), devkit.ap_r11());
                let is_empty = devkit.objects == 0;
                let nan = |ap| if is_empty { f64::NAN } else { ap };
                assert_same(got, ApSample { r40: nan(r40), r11: nan(r11) }, &place);
            }
            compared += usize::from(got.r40 > 0.0);
        }
    }
    compared
}

fn assert_same(got: ApSample, want: ApSample, place: &str) {
    for (got, want) in [(got.r40, want.r40), (got.r11, want.r11)] {
        let is_same = (got - want).abs() < TOLERANCE || got.is_nan() && want.is_nan();
        assert!(is_same, "{place}: {got}, from scratch {want}");
    }
}

#[test]
fn draws_of_the_devkits_cases_equal_evaluations_from_scratch() {
    let Some(cases) = farsight_testing::folder("FARSIGHT_EVAL_CASES", "../shared/kitti-eval", "") else { return };
    let mut compared = 0;
    for case in std::fs::read_dir(cases).unwrap().map(|entry| entry.unwrap().path()).filter(|path| path.is_dir()) {
        let (labels, results) = (case.join("gt"), case.join("det"));
        let frames: Vec<_> = common::ids(&labels).iter().map(|id| common::frame(&labels, &results, id)).collect();
        compared += assert_draws_equal_evaluations(&frames, &case.file_name().unwrap().to_string_lossy());
    }
    assert!(compared > 1000, "only {compared} answers were compared");
}

#[test]
fn draws_of_awkward_frames_equal_evaluations_from_scratch() {
    let compared: usize = (0..8)
        .map(|seed| {
            let frames = awkward_frames([1, 2, 5, 12, 30, 47, 60, 80][seed], seed as u128);
            assert_draws_equal_evaluations(&frames, &format!("seed {seed}"))
        })
        .sum();
    assert!(compared > 500, "only {compared} answers were compared");
}

#[test]
fn the_interval_is_that_of_the_frames_drawn_and_evaluated() {
    let frames = awkward_frames(25, 99);
    let bootstrap = Bootstrap { resamples: 57, seed: 5 };
    let set = set(&frames);
    let report = set.report(Some(&bootstrap));
    let spec = CurveSpec::new(OverlapSet::Loose, Metric::Bev, EvaluatedClass::Car, Difficulty::Hard);
    let outcomes = set.outcomes(&[spec]).remove(0).unwrap();
    let mut drawn: Vec<f64> = (0..57).map(|i| outcomes.drawn_ap(&bootstrap.draw(frames.len(), i)).r40).collect();
    drawn.sort_by(f64::total_cmp);
    let ap = report.ap(spec.overlaps, spec.metric, spec.class).unwrap();
    let interval = ap.intervals.unwrap().r40[2].unwrap();
    // 2.5% and 97.5% of the way from the first of 57 values to the last.
    let at = |position: f64| {
        let (low, part) = (position.floor() as usize, position.fract());
        drawn[low] + part * (drawn[low + 1] - drawn[low])
    };
    assert!((interval.low - at(0.025 * 56.0)).abs() < TOLERANCE, "{interval:?}");
    assert!((interval.high - at(0.975 * 56.0)).abs() < TOLERANCE, "{interval:?}");
    assert!(interval.low < ap.r40[2] && ap.r40[2] < interval.high, "{interval:?} around {}", ap.r40[2]);
}

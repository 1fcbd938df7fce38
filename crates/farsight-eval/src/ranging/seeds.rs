//! Two arms of an experiment over several seeds: is the difference more than an accident of seeds and frames?

use std::collections::BTreeMap;

use super::bootstrap::{Bootstrap, Interval};
use super::matching::Target;
use super::metrics::RangingMetric;
use super::tally::Tally;

/// One metric of two arms, means over the seeds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeedDifference {
    /// Of the arm.
    pub value: f64,
    /// Of the arm that it is compared with.
    pub against: f64,
    /// `value - against`.
    pub difference: f64,
    /// 95% interval of the difference, over seeds and frames; of one seed, over frames.
    pub interval: Option<Interval>,
}

/// One arm's tallies by frame; frames without objects are left out.
type ByFrame = Vec<(usize, Tally)>;

/// Compares two arms on the same `frames`; a pair is what they answered with one seed, arm first.
///
/// Of each pair only objects that `holds` are looked at, and for errors only those that **both** arms found. Every resample draws seeds and frames with
/// replacement, the same frames for both arms and all seeds, as these were looked at by all of them: what makes a frame hard for everybody cancels in a
/// pair, and does not average out over seeds.
///
/// `None` when there is no pair, the labels within a pair differ, or an arm has no such figure.
pub fn compare_seeds(
    pairs: &[[&[Target]; 2]],
    frames: usize,
    metric: RangingMetric,
    holds: impl Fn(&Target) -> bool,
    bootstrap: &Bootstrap,
) -> Option<SeedDifference> {
    let needs_both = metric != RangingMetric::Share;
    let mut seeds = Vec::with_capacity(pairs.len());
    for [ours, theirs] in pairs {
        let is_same = |(a, b): (&Target, &Target)| (a.frame, a.label, a.class) == (b.frame, b.label, b.class);
        if ours.len() != theirs.len() || !ours.iter().zip(*theirs).all(is_same) {
            return None;
        }
        let chosen = |(a, b): &(&Target, &Target)| holds(a) && (!needs_both || (a.found.is_some() && b.found.is_some()));
        let (mut a, mut b) = (BTreeMap::<usize, Tally>::new(), BTreeMap::<usize, Tally>::new());
        for (our, their) in ours.iter().zip(*theirs).filter(chosen) {
            a.entry(our.frame as usize).or_default().add(&Tally::of(our), 1.0);
            b.entry(their.frame as usize).or_default().add(&Tally::of(their), 1.0);
        }
        seeds.push([a, b].map(|tallies| tallies.into_iter().collect::<ByFrame>()));
    }
    let figure = |tallies: &ByFrame, drawn: Option<&[f64]>| {
        let mut sum = Tally::default();
        for (frame, tally) in tallies {
            sum.add(tally, drawn.map_or(1.0, |drawn| drawn[*frame]));
        }
        sum.metrics().get(metric).unwrap_or(f64::NAN)
    };
    let means = |seed_weights: &[f64], drawn: Option<&[f64]>| {
        let total: f64 = seed_weights.iter().sum();
        [0, 1].map(|arm| {
            let drawn_seeds = seeds.iter().zip(seed_weights).filter(|(_, weight)| **weight > 0.0);
            drawn_seeds.map(|(seed, weight)| weight * figure(&seed[arm], drawn)).sum::<f64>() / total
        })
    };
    let [value, against] = means(&vec![1.0; seeds.len()], None);
    let difference = value - against;
    let interval = bootstrap.crossed_interval([seeds.len(), frames], |seed_weights, drawn| {
        let [value, against] = means(seed_weights, Some(drawn));
        value - against
    });
    difference.is_finite().then_some(SeedDifference { value, against, difference, interval })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ranging::Measurement;
    use crate::{Difficulty, EvaluatedClass};

    /// One car in each of 200 frames, 20 m away; `error_m` of frame number, or missed.
    fn targets(error_m: impl Fn(u32) -> Option<f64>) -> Vec<Target> {
        let target = |frame| Target {
            frame,
            label: 0,
            class: EvaluatedClass::Car,
            difficulty: Some(Difficulty::Easy),
            occlusion: 0,
            truncation: 0.0,
            depth_m: 20.0,
            ground_m: 20.0,
            found: error_m(frame).map(|error| Measurement {
                prediction: 0,
                score: 0.9,
                depth_m: 20.0 + error,
                ground_m: 20.0 + error,
                sigma_m: None,
            }),
        };
        (0..200).map(target).collect()
    }

    fn noise(frame: u32, salt: u32) -> f64 {
        f64::from(frame.wrapping_mul(2_654_435_761).wrapping_add(salt.wrapping_mul(40_503)) >> 16 & 0xff) / 255.0
    }

    const BOOTSTRAP: Bootstrap = Bootstrap { resamples: 500, seed: 1 };

    #[test]
    fn what_is_hard_for_both_cancels_and_seeds_that_disagree_widen() {
        let base: Vec<Vec<Target>> = (0..3).map(|_| targets(|frame| Some(5.0 * noise(frame, 0)))).collect();
        let better = |gains: [f64; 3]| -> Vec<Vec<Target>> {
            gains.iter().map(|gain| targets(|frame| Some(5.0 * noise(frame, 0) + 1.0 - gain))).collect()
        };
        let compared = |ours: &[Vec<Target>]| {
            let pairs: Vec<[&[Target]; 2]> = ours.iter().zip(&base).map(|(a, b)| [&a[..], &b[..]]).collect();
            compare_seeds(&pairs, 200, RangingMetric::MaeZ, |_| true, &BOOTSTRAP).unwrap()
        };
        let agreed = compared(&better([0.5, 0.5, 0.5]));
        assert!((agreed.difference - 0.5).abs() < 1e-9);
        let interval = agreed.interval.unwrap();
        assert!(interval.high - interval.low < 1e-9, "{interval:?}");
        let disagreed = compared(&better([0.2, 0.5, 0.8]));
        assert!((disagreed.difference - 0.5).abs() < 1e-9);
        let interval = disagreed.interval.unwrap();
        // The mean of three draws of 0.2, 0.5 and 0.8, wide as seeds are, not as frames are.
        assert!(interval.low < 0.35 && interval.high > 0.65, "{interval:?}");
    }

    #[test]
    fn errors_are_of_what_both_found_and_shares_of_all() {
        let (ours, theirs) = (targets(|frame| (frame % 2 == 0).then_some(1.0)), targets(|_| Some(2.0)));
        let pairs: [[&[Target]; 2]; 1] = [[&ours, &theirs]];
        let mae = compare_seeds(&pairs, 200, RangingMetric::MaeZ, |_| true, &BOOTSTRAP).unwrap();
        assert_eq!((mae.value, mae.against), (1.0, 2.0));
        let share = compare_seeds(&pairs, 200, RangingMetric::Share, |_| true, &BOOTSTRAP).unwrap();
        assert!((share.difference + 0.5).abs() < 1e-9);
        let interval = share.interval.unwrap();
        assert!(interval.low < -0.45 && interval.high > -0.55 && interval.low > -0.65, "{interval:?}");
        assert!(compare_seeds(&pairs, 200, RangingMetric::MaeZ, |_| false, &BOOTSTRAP).is_none());
        assert!(compare_seeds(&[], 200, RangingMetric::MaeZ, |_| true, &BOOTSTRAP).is_none());
        let shorter: [[&[Target]; 2]; 1] = [[&ours[1..], &theirs]];
        assert!(compare_seeds(&shorter, 200, RangingMetric::MaeZ, |_| true, &BOOTSTRAP).is_none());
    }
}

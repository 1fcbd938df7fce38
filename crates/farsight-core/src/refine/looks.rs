//! One answer from two looks: how far to trust each, fitted on labelled frames.

use serde::{Deserialize, Serialize};

use super::kinds::{likeliest, log_odds};
use super::{Evidence, LooksScores, Refinement, kind_of};
use crate::detection::SCORE_LIMITS;
use crate::overlap::iou_2d;
use crate::range_error::WITHIN_ONE_SIGMA;
use crate::score::LEAST_EXAMPLES;
use crate::statistics::{quantile, sorted};
use crate::{Camera, Detection};

/// Boxes in the image that overlap less are of two different things.
const LEAST_OVERLAP: f64 = 0.3;

/// How the two looks go together, fitted on labelled frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TwoLooks {
    /// Factor on the second look's depths.
    pub depth_factor: f64,
    /// Factor on the error bars of the second look.
    pub error_factor: f64,
    /// Correlation of the two looks' errors: neither knows how large a car is, so they err alike.
    pub correlation: f64,
    /// Factor on the error bars of both together.
    pub joint_error_factor: f64,
    /// How likely a detection is right after both; unfitted, the first look's scores stay.
    pub scores: LooksScores,
}

impl Default for TwoLooks {
    /// Unfitted.
    fn default() -> Self {
        Self {
            depth_factor: 1.0,
            error_factor: 1.0,
            correlation: 0.5,
            joint_error_factor: 1.0,
            scores: LooksScores::default(),
        }
    }
}

/// An object that both looks saw and of which the depth is known, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LooksExample {
    /// What is right.
    pub true_m: f64,
    /// The first look's depth and its error bar.
    pub first: [f64; 2],
    /// The second look's depth, and the standard deviation of its logarithm.
    pub second: [f64; 2],
}

impl TwoLooks {
    /// What makes the depths of `examples` right in the median and the error bars hold two thirds of them, with unfitted scores; none when they are
    /// fewer than [`LEAST_EXAMPLES`].
    pub fn fit(examples: &[LooksExample]) -> Option<Self> {
        if examples.len() < LEAST_EXAMPLES {
            return None;
        }
        let off = |example: &LooksExample, found_m: f64| (found_m / example.true_m).ln();
        let depth_factor = (-median(examples.iter().map(|example| off(example, example.second[0])))).exp();
        let second = |example: &LooksExample| off(example, example.second[0] * depth_factor) / example.second[1];
        let error_factor = one_sigma(examples.iter().map(second));
        let first = |example: &LooksExample| off(example, example.first[0]) / (example.first[1] / example.first[0]);
        let pairs: Vec<[f64; 2]> = examples
            .iter()
            .map(|example| [first(example), second(example) / error_factor].map(|off| off.clamp(-3.0, 3.0)))
            .collect();
        let product = |a: usize, b: usize| pairs.iter().map(|pair| pair[a] * pair[b]).sum::<f64>();
        let correlation = product(0, 1) / (product(0, 0) * product(1, 1)).sqrt();
        let unfinished = Self { depth_factor, error_factor, correlation, ..Self::default() };
        let joint = |example: &LooksExample| {
            let [first_m, first_sigma_m] = example.first;
            let [second_m, second_sigma] = example.second;
            let first = Some((first_m.ln(), first_sigma_m / first_m));
            let second = ((second_m * depth_factor).ln(), second_sigma * error_factor);
            let (log, sigma) = unfinished.agreed(first, second);
            off(example, log.exp()) / sigma
        };
        let fitted = Self { joint_error_factor: one_sigma(examples.iter().map(joint)), ..unfinished };
        fitted.is_usable().then_some(fitted)
    }

    /// Whether these are numbers that a fit could have given: files from strangers may hold others.
    pub fn is_usable(&self) -> bool {
        let factors = [self.depth_factor, self.error_factor, self.joint_error_factor];
        let are_factors = factors.iter().all(|factor| (0.01..100.0).contains(factor));
        are_factors && (-0.99..=0.99).contains(&self.correlation) && self.scores.is_usable()
    }

    /// `first`, found in an image of this size (width, height) that `camera` takes, with what the second look says of it, if it says anything.
    ///
    /// Direction, heading and proportions are the second look's; its box is moved along its rays, growing with the distance, to the depth on which
    /// both agree best. A first look without error bar has no say in that. Where the second look sees something else than the first, or
    /// something that is not in the image, the place of `first` stays. The score is that of both, the class the likeliest of those that are easily taken for
    /// that of `first`.
    pub fn joined(
        &self,
        first: &Detection,
        second: Option<&Refinement>,
        camera: &Camera,
        image_size: [usize; 2],
    ) -> Detection {
        let Some(second) = second else { return first.clone() };
        let placed = self.placed(first, second, camera, image_size);
        let evidence = evidence(first, second, placed.as_ref());
        let (least, most) = SCORE_LIMITS;
        let score = self.scores.probability(&first.class, &evidence).clamp(least, most);
        let agreed = placed.filter(|_| evidence.overlap >= LEAST_OVERLAP);
        let class = likeliest(&second.kinds, &first.class);
        Detection { class, score, ..agreed.unwrap_or_else(|| first.clone()) }
    }

    /// What speaks for `first` after a second look.
    pub fn evidence(
        &self,
        first: &Detection,
        second: &Refinement,
        camera: &Camera,
        image_size: [usize; 2],
    ) -> Evidence {
        evidence(first, second, self.placed(first, second, camera, image_size).as_ref())
    }

    /// `first` where the second look has it, at the depth of both; none when that is not in front of the camera.
    fn placed(
        &self,
        first: &Detection,
        second: &Refinement,
        camera: &Camera,
        image_size: [usize; 2],
    ) -> Option<Detection> {
        let seen = second.box3d.scaled(self.depth_factor);
        let depth_m = first.box3d.depth_m();
        let first_look = first.range_sigma_m.map(|sigma_m| (depth_m.ln(), sigma_m / depth_m));
        let (log, sigma) = self.agreed(first_look, (seen.depth_m().ln(), second.depth_sigma * self.error_factor));
        let box3d = seen.scaled(log.exp() / seen.depth_m());
        let [width, height] = image_size.map(|side| side as f64);
        let box2d = box3d.projected(camera)?.clamped(width, height);
        let range_sigma_m = Some(sigma * self.joint_error_factor * box3d.depth_m());
        Some(Detection { box2d, box3d, range_sigma_m, ..first.clone() })
    }

    /// Mean and deviation of two measurements, of which the first may be missing, whose errors are correlated: the best linear combination.
    fn agreed(&self, first: Option<(f64, f64)>, second: (f64, f64)) -> (f64, f64) {
        let Some(first) = first else { return second };
        let (a, b) = (first.1, second.1);
        let shared = self.correlation * a * b;
        let spread = a * a + b * b - 2.0 * shared;
        let weight = if spread > 0.0 { ((a * a - shared) / spread).clamp(0.0, 1.0) } else { 0.5 };
        let rest = 1.0 - weight;
        let variance = weight * weight * b * b + rest * rest * a * a + 2.0 * weight * rest * shared;
        (rest * first.0 + weight * second.0, variance.sqrt())
    }
}

/// What speaks for `first`, which the second look places so, or nowhere.
fn evidence(first: &Detection, second: &Refinement, placed: Option<&Detection>) -> Evidence {
    let (least, most) = SCORE_LIMITS;
    Evidence {
        score: first.score.clamp(least, most),
        kind: kind_of(&first.class).map_or(0.0, |kind| log_odds(&second.kinds, kind)),
        overlap: placed.map_or(0.0, |placed| iou_2d(&placed.box2d, &first.box2d)),
    }
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    quantile(&sorted(values), 0.5)
}

/// What as many of the values lie within, either way, as of a normal distribution within one standard deviation.
fn one_sigma(values: impl Iterator<Item = f64>) -> f64 {
    quantile(&sorted(values.map(f64::abs)), WITHIN_ONE_SIGMA)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::SQRT_2;

    use proptest::prelude::*;

    use super::super::tests::{camera, car};
    use super::super::{KINDS, NOTHING, ScoredLooks};
    use super::*;
    use crate::{Box3d, ObjectClass};

    const IMAGE: [usize; 2] = [1242, 375];

    /// Three independent numbers of mean 0 and deviation 1 for each `k`: an even spread over a unit cube, made normal (Box and Muller).
    fn normals(k: u32) -> [f64; 3] {
        let share = |power: i32| (0.5 + f64::from(k) * 0.856_674_883_854_502_9_f64.powi(power)).fract();
        let pair = |a: f64, b: f64| {
            let (radius, angle) = ((-2.0 * (1.0 - a).ln()).sqrt(), std::f64::consts::TAU * b);
            [radius * angle.cos(), radius * angle.sin()]
        };
        let ([first, second], [third, _]) = (pair(share(1), share(2)), pair(share(3), share(4)));
        [first, second, third]
    }

    fn detection(box3d: Box3d, range_sigma_m: Option<f64>) -> Detection {
        let box2d = box3d.projected(&camera()).expect("in front").clamped(1242.0, 375.0);
        Detection { class: ObjectClass::Car, score: 0.7, box2d, box3d, range_sigma_m }
    }

    proptest! {
        #[test]
        fn two_looks_meet_between_them_and_the_surer_one_counts_more(
            first_m in 10.0..40.0_f64, share in 0.9..1.1_f64, a in 0.01..0.2_f64, b in 0.01..0.2_f64, correlation in -0.5..0.9_f64,
        ) {
            let looks = TwoLooks { correlation, ..TwoLooks::default() };
            let second_m = first_m * share;
            let (log, sigma) = looks.agreed(Some((first_m.ln(), a)), (second_m.ln(), b));
            prop_assert!(log >= first_m.min(second_m).ln() - 1e-9 && log <= first_m.max(second_m).ln() + 1e-9);
            prop_assert!(sigma <= a.min(b) + 1e-12, "{} of {} and {}", sigma, a, b);
            let middle = f64::midpoint(first_m.ln(), second_m.ln());
            let towards_second = (log - middle) * (second_m.ln() - first_m.ln()).signum();
            let as_it_should = towards_second * (a - b) >= -1e-9;
            prop_assert!(as_it_should, "{} of {} and {}", towards_second, a, b);
        }
    }

    fn second_look(location: [f64; 3], yaw: f64, depth_sigma: f64) -> Refinement {
        Refinement { box3d: car(location, yaw), depth_sigma, kinds: [0.0; KINDS] }
    }

    #[test]
    fn a_joined_box_looks_like_the_second_at_the_depth_of_both() {
        let first = detection(car([2.0, 1.6, 20.0], 0.4), Some(1.0));
        let second = second_look([2.2, 1.65, 22.0], 0.5, 0.05);
        let looks = TwoLooks { correlation: 0.0, ..TwoLooks::default() };
        let joined = looks.joined(&first, Some(&second), &camera(), IMAGE);
        let depth_m = joined.box3d.depth_m();
        assert!((depth_m - (20.0_f64 * 22.0).sqrt()).abs() < 1e-9, "as sure as each other: {depth_m}");
        assert!((joined.box3d.dimensions.height - 1.5 * depth_m / 22.0).abs() < 1e-9);
        assert!((joined.box3d.yaw - 0.5).abs() < 1e-12);
        let sigma_m = joined.range_sigma_m.expect("both have one");
        assert!((sigma_m - 0.05 / SQRT_2 * depth_m).abs() < 1e-9, "{sigma_m}");
        // Without an error bar the first look has no say.
        let unsure = detection(first.box3d, None);
        let alone = looks.joined(&unsure, Some(&second), &camera(), IMAGE);
        assert!((alone.box3d.depth_m() - 22.0).abs() < 1e-9);
    }

    #[test]
    fn a_second_look_at_something_else_moves_nothing() {
        let first = detection(car([2.0, 1.6, 20.0], 0.4), Some(1.0));
        for location in [[7.0, 1.6, 20.0], [2.0, 1.6, -20.0]] {
            let second = second_look(location, 0.4, 0.01);
            assert_eq!(TwoLooks::default().joined(&first, Some(&second), &camera(), IMAGE), first);
        }
        assert_eq!(TwoLooks::default().joined(&first, None, &camera(), IMAGE), first);
    }

    #[test]
    fn a_score_falls_where_the_second_look_sees_nothing_or_something_else() {
        let first = detection(car([2.0, 1.6, 20.0], 0.4), Some(1.0));
        let right_of = |kind: f64, overlap: f64| kind > 0.0 && overlap > 0.5;
        let examples: Vec<ScoredLooks> = (0..400)
            .map(|i| {
                let (kind, overlap) = (f64::from(i % 20) - 9.5, f64::from(i / 20) / 20.0);
                let evidence = Evidence { score: 0.5, kind, overlap };
                ScoredLooks { class: ObjectClass::Car, evidence, is_right: right_of(kind, overlap) }
            })
            .collect();
        let scores = LooksScores::fit(&examples, &[ObjectClass::Car]).expect("enough examples");
        let looks = TwoLooks { scores, ..TwoLooks::default() };
        let score = |second: &Refinement| looks.joined(&first, Some(second), &camera(), IMAGE).score;
        let seen_as = |kind: usize, second: Refinement| {
            let kinds = std::array::from_fn(|other| if other == kind { 5.0 } else { 0.0 });
            Refinement { kinds, ..second }
        };
        let here = second_look([2.0, 1.6, 20.0], 0.4, 0.05);
        let elsewhere = second_look([7.0, 1.6, 20.0], 0.4, 0.05);
        let car = kind_of(&first.class).expect("a kind");
        let [agreed, nothing, moved] =
            [seen_as(car, here), seen_as(NOTHING, here), seen_as(car, elsewhere)].map(|second| score(&second));
        assert!(agreed > first.score, "{agreed}");
        assert!(nothing < first.score && moved < first.score, "{nothing}, {moved}");
    }

    #[test]
    fn a_fit_finds_factors_and_correlation() {
        let truth = TwoLooks { depth_factor: 1.03, error_factor: 2.0, correlation: 0.6, ..TwoLooks::default() };
        let examples: Vec<LooksExample> = (0..4000)
            .map(|k| {
                let true_m = 5.0 + f64::from(k % 60);
                let [common, a, b] = normals(k);
                let mixed = |own: f64| 0.6_f64.sqrt() * common + 0.4_f64.sqrt() * own;
                let first_m = true_m * (0.06 * mixed(a)).exp();
                let second_m = true_m * (0.04 * mixed(b)).exp() / truth.depth_factor;
                LooksExample { true_m, first: [first_m, 0.06 * first_m], second: [second_m, 0.02] }
            })
            .collect();
        let found = TwoLooks::fit(&examples).expect("enough examples");
        assert!((found.depth_factor - truth.depth_factor).abs() < 0.003, "{found:?}");
        assert!((found.error_factor - truth.error_factor).abs() < 0.08, "{found:?}");
        assert!((found.correlation - truth.correlation).abs() < 0.04, "{found:?}");
        assert!((found.joint_error_factor - 1.0).abs() < 0.05, "{found:?}");
        assert_eq!(TwoLooks::fit(&examples[..3]), None);
    }
}

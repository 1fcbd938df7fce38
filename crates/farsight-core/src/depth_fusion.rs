//! One depth from two measurements of it, whose errors go together: how far to trust each, fitted on labelled frames.

use serde::{Deserialize, Serialize};

use crate::range_error::WITHIN_ONE_SIGMA;
use crate::score::MIN_EXAMPLES;
use crate::statistics::{conformal_quantile, quantile, sorted};

/// The shares of truths that the intervals beside the error bar hold; the error bar is half of the interval that holds
/// 68%.
const INTERVAL_SHARES: [f64; 2] = [0.5, 0.9];

/// Half the width of those intervals in standard deviations of a normal distribution.
pub const NORMAL_INTERVAL_SIGMAS: [f64; 2] = [0.674_489_750_196_081_7, 1.644_853_626_951_472_2];

/// Between these lies the factor on the error bars of what each object errs by itself.
const JOINT_FACTORS: [f64; 2] = [0.1, 10.0];

/// A factor is known to a billionth after so many halvings.
const HALVINGS: usize = 40;

/// The powers that are tried: from 0.5 to 2.5 in tenths.
const JOINT_POWERS: std::ops::RangeInclusive<u8> = 5..=25;

/// Before errors are seen, the logarithm of the power is 0 with this standard deviation: where they cannot tell, it is
/// 1.
const POWER_LOG_SIGMA: f64 = 1.0;

/// An error bar that no power changes.
const POWER_UNIT: f64 = 0.05;

/// Degrees of freedom of the distribution (Student's) by which errors are likely: it has their long tails.
const TAIL_FREEDOM: f64 = 5.0;

/// A depth and how sure it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeasuredDepth {
    /// Metres.
    pub depth_m: f64,
    /// Standard deviation of its logarithm.
    pub log_sigma: f64,
}

impl MeasuredDepth {
    /// How far this is from the truth, in its own standard deviations.
    fn off(&self, true_m: f64) -> f64 {
        (self.depth_m / true_m).ln() / self.log_sigma
    }
}

/// A depth that was measured twice and is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthPair {
    /// What is right, metres.
    pub true_m: f64,
    /// The measurement that counts as it is.
    pub first: MeasuredDepth,
    /// The measurement that is to be corrected.
    pub second: MeasuredDepth,
}

/// How two measurements of one depth go together, fitted on labelled frames.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DepthFusion {
    /// Factor on the second one's depths.
    pub depth_factor: f64,
    /// Factor on the error bars of the second one.
    pub error_factor: f64,
    /// Correlation of their errors.
    pub correlation: f64,
    /// Factor on the error bars of both together.
    pub joint_error_factor: f64,
    /// Power of these: above 1 the narrow ones are narrower than they were said to be, and the wide ones wider.
    #[serde(skip_serializing_if = "is_one")]
    pub joint_error_power: f64,
    /// Half the width of the intervals that hold half of the truths and 90% of them, joint error bars.
    pub interval_sigmas: [f64; 2],
    /// The first one has no say: it measures nothing.
    #[serde(skip_serializing_if = "is_false")]
    pub is_second_alone: bool,
}

/// Files of before there was a choice do not name it.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_false(value: &bool) -> bool {
    !*value
}

/// Files of before error bars had a power do not name it.
#[expect(clippy::trivially_copy_pass_by_ref, clippy::float_cmp, reason = "serde passes a reference; the very default")]
fn is_one(value: &f64) -> bool {
    *value == 1.0
}

impl Default for DepthFusion {
    /// Unfitted.
    fn default() -> Self {
        Self {
            depth_factor: 1.0,
            error_factor: 1.0,
            correlation: 0.5,
            joint_error_factor: 1.0,
            joint_error_power: 1.0,
            interval_sigmas: NORMAL_INTERVAL_SIGMAS,
            is_second_alone: false,
        }
    }
}

impl DepthFusion {
    /// What makes the second depths of `pairs` right in the median and all error bars hold two thirds of them; none
    /// when they are fewer than [`MIN_EXAMPLES`]. The first depths have a say unless `is_second_alone`.
    pub fn fit(pairs: &[DepthPair], is_second_alone: bool) -> Option<Self> {
        if pairs.len() < MIN_EXAMPLES {
            return None;
        }
        let log_off = |pair: &DepthPair| (pair.second.depth_m / pair.true_m).ln();
        let depth_factor = (-quantile(&sorted(pairs.iter().map(log_off)), 0.5)).exp();
        let unfitted = Self { depth_factor, is_second_alone, ..Self::default() };
        let second = |fitted: &Self, pair: &DepthPair| fitted.corrected(pair.second).off(pair.true_m);
        let fitted = Self { error_factor: one_sigma(pairs.iter().map(|pair| second(&unfitted, pair))), ..unfitted };
        let offs =
            |pair: &DepthPair| [pair.first.off(pair.true_m), second(&fitted, pair)].map(|off| off.clamp(-3.0, 3.0));
        let offs: Vec<[f64; 2]> = pairs.iter().map(offs).collect();
        let product = |a: usize, b: usize| offs.iter().map(|pair| pair[a] * pair[b]).sum::<f64>();
        let fitted = Self { correlation: product(0, 1) / (product(0, 0) * product(1, 1)).sqrt(), ..fitted };
        let fitted = fitted.with_shared_error(pairs, &vec![0.0; pairs.len()]);
        fitted.is_usable().then_some(fitted)
    }

    /// The same with error bars of what each object errs by itself: `shared` are the standard deviations of what the
    /// logarithms of the depths of `pairs` have in common with others in their images. Both together hold two thirds of
    /// the errors, by the power under which the errors are likeliest. The intervals are multiples of both together, by
    /// split conformal prediction.
    #[must_use]
    pub fn with_shared_error(self, pairs: &[DepthPair], shared: &[f64]) -> Self {
        let plain = Self { joint_error_factor: 1.0, joint_error_power: 1.0, ..self };
        let errors: Vec<JointError> = pairs
            .iter()
            .zip(shared)
            .map(|(pair, shared)| {
                let joint = plain.joint(Some(pair.first), pair.second);
                JointError { error: (joint.depth_m / pair.true_m).ln(), own: joint.log_sigma, shared: *shared }
            })
            .collect();
        let of_power = |tenths: u8| {
            let fitted = Self { joint_error_power: f64::from(tenths) / 10.0, ..plain };
            let fitted = Self { joint_error_factor: fitted.holding_factor(&errors), ..fitted };
            let prior = 0.5 * (fitted.joint_error_power.ln() / POWER_LOG_SIGMA).powi(2);
            (fitted, prior + errors.iter().map(|error| error.surprise(&fitted)).sum::<f64>())
        };
        let likeliest = JOINT_POWERS.map(of_power).min_by(|(_, a), (_, b)| a.total_cmp(b));
        let Some((fitted, _)) = likeliest else { return self };
        let offs = sorted(errors.iter().map(|error| error.off(&fitted)));
        let fitted = Self { interval_sigmas: INTERVAL_SHARES.map(|share| conformal_quantile(&offs, share)), ..fitted };
        if fitted.is_usable() { fitted } else { self }
    }

    /// The factor by which the error bars hold two thirds of `errors`.
    fn holding_factor(&self, errors: &[JointError]) -> f64 {
        // The larger the error bars, the smaller are the errors in them: it is looked for by halves.
        let [mut least, mut most] = JOINT_FACTORS;
        for _ in 0..HALVINGS {
            let middle = f64::midpoint(least, most);
            let tried = Self { joint_error_factor: middle, ..*self };
            let offs = sorted(errors.iter().map(|error| error.off(&tried)));
            if conformal_quantile(&offs, WITHIN_ONE_SIGMA) < 1.0 { most = middle } else { least = middle }
        }
        f64::midpoint(least, most)
    }

    /// The error bar of both together where this comes out of them.
    fn joint_sigma(&self, log_sigma: f64) -> f64 {
        self.joint_error_factor * POWER_UNIT * (log_sigma / POWER_UNIT).powf(self.joint_error_power)
    }

    /// By what the joint error bars of `pairs` are to be multiplied, so that they hold two thirds of the errors; none
    /// when they are fewer than [`MIN_EXAMPLES`].
    pub fn missing_error_factor(&self, pairs: &[DepthPair]) -> Option<f64> {
        let joint = |pair: &DepthPair| self.joint(Some(pair.first), pair.second).off(pair.true_m);
        (pairs.len() >= MIN_EXAMPLES).then(|| one_sigma(pairs.iter().map(joint)))
    }

    /// Whether these are numbers that a fit could have given: files from strangers may hold others.
    pub fn is_usable(&self) -> bool {
        let factors = [self.depth_factor, self.error_factor, self.joint_error_factor];
        let are_factors = factors.iter().all(|factor| (0.01..100.0).contains(factor));
        let is_power = (0.1..4.0).contains(&self.joint_error_power);
        let [half, most] = self.interval_sigmas;
        let are_intervals = half > 0.0 && half <= most && most < 100.0;
        are_factors && is_power && are_intervals && (-0.99..=0.99).contains(&self.correlation)
    }

    /// The best linear combination of both measurements, of which the first may be missing or have no say.
    pub fn joint(&self, first: Option<MeasuredDepth>, second: MeasuredDepth) -> MeasuredDepth {
        let second = self.corrected(second);
        let first = first.filter(|_| !self.is_second_alone);
        let MeasuredDepth { depth_m, log_sigma } =
            first.map_or(second, |first| combined(first, second, self.correlation));
        MeasuredDepth { depth_m, log_sigma: self.joint_sigma(log_sigma) }
    }

    /// The second measurement as it counts.
    pub fn corrected(&self, second: MeasuredDepth) -> MeasuredDepth {
        MeasuredDepth { depth_m: second.depth_m * self.depth_factor, log_sigma: second.log_sigma * self.error_factor }
    }
}

/// How far off the depth from two measurements is.
#[derive(Debug, Clone, Copy)]
struct JointError {
    /// Logarithm of found over true depth.
    error: f64,
    /// The error bar that comes out of the measurements.
    own: f64,
    /// Standard deviation of what others in the image err by as well.
    shared: f64,
}

impl JointError {
    /// The error bar with what is shared.
    fn sigma(&self, fusion: &DepthFusion) -> f64 {
        fusion.joint_sigma(self.own).hypot(self.shared).max(f64::EPSILON)
    }

    /// How far off it is, in standard deviations.
    fn off(&self, fusion: &DepthFusion) -> f64 {
        self.error.abs() / self.sigma(fusion)
    }

    /// The negative logarithm of its likelihood, but for what all have.
    fn surprise(&self, fusion: &DepthFusion) -> f64 {
        let tail = f64::midpoint(TAIL_FREEDOM, 1.0) * (self.off(fusion).powi(2) / TAIL_FREEDOM).ln_1p();
        self.sigma(fusion).ln() + tail
    }
}

/// Mean of two measurements that deviates least, when the correlation of their errors is this.
fn combined(first: MeasuredDepth, second: MeasuredDepth, correlation: f64) -> MeasuredDepth {
    let (a, b) = (first.log_sigma, second.log_sigma);
    let shared = correlation * a * b;
    let spread = a * a + b * b - 2.0 * shared;
    let weight = if spread > 0.0 { ((a * a - shared) / spread).clamp(0.0, 1.0) } else { 0.5 };
    let rest = 1.0 - weight;
    let variance = weight * weight * b * b + rest * rest * a * a + 2.0 * weight * rest * shared;
    let log = rest * first.depth_m.ln() + weight * second.depth_m.ln();
    MeasuredDepth { depth_m: log.exp(), log_sigma: variance.sqrt() }
}

/// What as many of the values lie within, either way, as of a normal distribution within one standard deviation.
fn one_sigma(values: impl Iterator<Item = f64>) -> f64 {
    conformal_quantile(&sorted(values.map(f64::abs)), WITHIN_ONE_SIGMA)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Three independent numbers of mean 0 and deviation 1 for each `k`: an even spread over a unit cube, made normal
    /// (Box and Muller).
    fn normals(k: u32) -> [f64; 3] {
        let share = |power: i32| (0.5 + f64::from(k) * 0.856_674_883_854_502_9_f64.powi(power)).fract();
        let pair = |a: f64, b: f64| {
            let (radius, angle) = ((-2.0 * (1.0 - a).ln()).sqrt(), std::f64::consts::TAU * b);
            [radius * angle.cos(), radius * angle.sin()]
        };
        let ([first, second], [third, _]) = (pair(share(1), share(2)), pair(share(3), share(4)));
        [first, second, third]
    }

    proptest! {
        #[test]
        fn two_measurements_meet_between_them_and_the_surer_one_counts_more(
            first_m in 10.0..40.0_f64, share in 0.9..1.1_f64, a in 0.01..0.2_f64, b in 0.01..0.2_f64, correlation in -0.5..0.9_f64,
        ) {
            let fusion = DepthFusion { correlation, ..DepthFusion::default() };
            let second_m = first_m * share;
            let first = MeasuredDepth { depth_m: first_m, log_sigma: a };
            let both = fusion.joint(Some(first), MeasuredDepth { depth_m: second_m, log_sigma: b });
            let log = both.depth_m.ln();
            prop_assert!(log >= first_m.min(second_m).ln() - 1e-9 && log <= first_m.max(second_m).ln() + 1e-9);
            prop_assert!(both.log_sigma <= a.min(b) + 1e-12, "{} of {} and {}", both.log_sigma, a, b);
            let middle = f64::midpoint(first_m.ln(), second_m.ln());
            let towards_second = (log - middle) * (second_m.ln() - first_m.ln()).signum();
            let as_it_should = towards_second * (a - b) >= -1e-9;
            prop_assert!(as_it_should, "{} of {} and {}", towards_second, a, b);
        }
    }

    #[test]
    fn a_fit_finds_factors_and_correlation() {
        let truth = DepthFusion { depth_factor: 1.03, error_factor: 2.0, correlation: 0.6, ..DepthFusion::default() };
        let pairs: Vec<DepthPair> = (0..4000)
            .map(|k| {
                let true_m = 5.0 + f64::from(k % 60);
                let [common, a, b] = normals(k);
                let mixed = |own: f64| 0.6_f64.sqrt() * common + 0.4_f64.sqrt() * own;
                let first = MeasuredDepth { depth_m: true_m * (0.06 * mixed(a)).exp(), log_sigma: 0.06 };
                let second_m = true_m * (0.04 * mixed(b)).exp() / truth.depth_factor;
                DepthPair { true_m, first, second: MeasuredDepth { depth_m: second_m, log_sigma: 0.02 } }
            })
            .collect();
        let found = DepthFusion::fit(&pairs, false).expect("enough pairs");
        assert!((found.depth_factor - truth.depth_factor).abs() < 0.003, "{found:?}");
        assert!((found.error_factor - truth.error_factor).abs() < 0.08, "{found:?}");
        assert!((found.correlation - truth.correlation).abs() < 0.04, "{found:?}");
        assert!((found.joint_error_factor - 1.0).abs() < 0.05, "{found:?}");
        assert!(!found.is_second_alone);
        assert_eq!(DepthFusion::fit(&pairs[..3], false), None);
    }

    #[test]
    fn a_first_one_without_a_say_changes_nothing() {
        let pair = |k: u32| {
            let true_m = 5.0 + f64::from(k % 60);
            let [_, a, b] = normals(k);
            let first = MeasuredDepth { depth_m: 0.4 * true_m * (0.15 * a).exp(), log_sigma: 0.15 };
            let second = MeasuredDepth { depth_m: true_m * (0.08 * b).exp(), log_sigma: 0.04 };
            DepthPair { true_m, first, second }
        };
        let pairs: Vec<DepthPair> = (0..2000).map(pair).collect();
        let found = DepthFusion::fit(&pairs, true).expect("enough pairs");
        let DepthPair { first, second, .. } = pairs[0];
        assert_eq!(found.joint(Some(first), second), found.joint(None, second));
        assert!((found.error_factor - 2.0).abs() < 0.1 && (found.joint_error_factor - 1.0).abs() < 0.01, "{found:?}");
        let narrow = DepthFusion { joint_error_factor: found.joint_error_factor / 3.0, ..found };
        let missing = narrow.missing_error_factor(&pairs).expect("enough pairs");
        assert!((missing - 3.0).abs() < 1e-9, "{missing}");
        assert_eq!(narrow.missing_error_factor(&pairs[..3]), None);
    }

    #[test]
    fn error_bars_that_do_not_spread_enough_are_spread() {
        let truth = DepthFusion { joint_error_factor: 1.3, joint_error_power: 1.7, ..DepthFusion::default() };
        let pairs: Vec<DepthPair> = (0..4000)
            .map(|k| {
                let [_, own, other] = normals(k);
                let said = 0.03 + 0.09 * f64::from(k % 97) / 97.0;
                let second_m = 20.0 * (truth.joint_sigma(said) * own).exp();
                let first = MeasuredDepth { depth_m: 20.0 * other.exp(), log_sigma: 1.0 };
                DepthPair { true_m: 20.0, first, second: MeasuredDepth { depth_m: second_m, log_sigma: said } }
            })
            .collect();
        let found = DepthFusion::fit(&pairs, true).expect("enough pairs");
        assert!((found.joint_error_power - 1.7).abs() < 0.15, "{found:?}");
        let sigma = |fusion: &DepthFusion, said: f64| {
            fusion.joint(None, MeasuredDepth { depth_m: 20.0, log_sigma: said }).log_sigma
        };
        for said in [0.04, 0.06, 0.1] {
            let off = sigma(&found, said) / truth.joint_sigma(said);
            assert!((off - 1.0).abs() < 0.06, "{off} at {said}: {found:?}");
        }
        assert!(!DepthFusion { joint_error_power: 9.0, ..found }.is_usable());
    }

    #[test]
    fn error_bars_beside_a_shared_error_leave_it_out() {
        let pairs: Vec<DepthPair> = (0..4000)
            .map(|k| {
                let [shared, own, other] = normals(k);
                let true_m = 20.0;
                let second_m = true_m * (0.06 * shared + 0.05 * own).exp();
                let second = MeasuredDepth { depth_m: second_m, log_sigma: 0.05 };
                let first = MeasuredDepth { depth_m: true_m * (0.9 * other).exp(), log_sigma: 0.9 };
                DepthPair { true_m, first, second }
            })
            .collect();
        let fitted = DepthFusion::fit(&pairs, false).expect("enough pairs");
        let sigma = |fusion: &DepthFusion| fusion.joint(Some(pairs[0].first), pairs[0].second).log_sigma;
        assert!((sigma(&fitted) - 0.06_f64.hypot(0.05)).abs() < 0.003, "{fitted:?}");
        let own = fitted.with_shared_error(&pairs, &vec![0.06; pairs.len()]);
        assert!((sigma(&own) - 0.05).abs() < 0.004, "{own:?}");
        for (found, normal) in own.interval_sigmas.iter().zip(NORMAL_INTERVAL_SIGMAS) {
            assert!((found - normal).abs() < 0.06, "{own:?}");
        }
        let alone = fitted.with_shared_error(&pairs, &vec![0.0; pairs.len()]);
        assert!((alone.joint_error_factor - fitted.joint_error_factor).abs() < 1e-6, "{alone:?} and {fitted:?}");
    }
}

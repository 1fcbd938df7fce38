//! Distances judged on labelled frames: put right in the median, and given an error bar.

use serde::{Deserialize, Serialize};

use crate::linear::{dot, solved};
use crate::score::{MIN_EXAMPLES, logit};
use crate::statistics::{conformal_quantile, sorted};

/// Errors smaller than this, metres, count as so large: labels are no better, and their logarithm would rule the fit.
const MIN_ERROR_M: f64 = 0.02;

/// Share of the errors that lie within one standard deviation of a normal distribution.
pub(crate) const WITHIN_ONE_SIGMA: f64 = 0.6827;

/// A found object of which the distance is known. Depths are virtual ones ([`crate::DepthReference::virtual_depth_m`]).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthExample {
    /// What the model said, metres.
    pub found_m: f64,
    /// What is right, metres.
    pub true_m: f64,
    /// The model's score, between 0 and 1.
    pub score: f64,
    /// Whether the image's border cuts its box.
    pub is_cut: bool,
}

/// How far off a model's depths are: the logarithm of the standard deviation, in metres of virtual depth, is linear in
/// these terms.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RangeError {
    /// Added.
    pub bias: f64,
    /// Of the logarithm of the virtual depth in metres.
    pub depth: f64,
    /// Of the score's logit.
    pub score: f64,
    /// Added where the image's border cuts the box: its size says less there.
    #[serde(default)]
    pub cut: f64,
}

impl RangeError {
    /// Whether these are numbers that a fit could have given: files from strangers may hold others.
    pub fn is_usable(&self) -> bool {
        self.factors().iter().all(|number| number.is_finite() && number.abs() < 20.0)
    }

    /// Standard deviation, metres, of a positive virtual depth of a detection with this score (0 to 1, both excluded),
    /// whose box the image's border cuts or not.
    pub fn sigma_m(&self, depth_m: f64, score: f64, is_cut: bool) -> f64 {
        dot(&terms(depth_m, score, is_cut), &self.factors()).exp()
    }

    /// The factors of [`terms`].
    fn factors(&self) -> [f64; 4] {
        [self.bias, self.depth, self.score, self.cut]
    }

    /// The fit to `examples`: least squares in the logarithm of the error, then moved so that as many errors lie within
    /// one standard deviation as of a normal distribution. None with fewer than [`MIN_EXAMPLES`].
    pub fn fit(examples: &[DepthExample]) -> Option<Self> {
        if examples.len() < MIN_EXAMPLES {
            return None;
        }
        let (mut matrix, mut right) = ([[0.0; 4]; 4], [0.0; 4]);
        for example in examples {
            let terms = terms(example.found_m, example.score, example.is_cut);
            for (i, term) in terms.iter().enumerate() {
                matrix[i] = std::array::from_fn(|j| matrix[i][j] + term * terms[j]);
                right[i] += term * log_error(example);
            }
        }
        if examples.iter().all(|example| !example.is_cut) {
            // Nothing is known of cut boxes: no term for them.
            matrix[3][3] = 1.0;
        }
        let [bias, depth, score, cut] = solved(matrix, right)?;
        let fit = Self { bias, depth, score, cut };
        let over = examples.iter().map(|e| log_error(e) - fit.sigma_m(e.found_m, e.score, e.is_cut).ln());
        let moved = Self { bias: bias + conformal_quantile(&sorted(over), WITHIN_ONE_SIGMA), ..fit };
        moved.is_usable().then_some(moved)
    }
}

fn terms(depth_m: f64, score: f64, is_cut: bool) -> [f64; 4] {
    [1.0, depth_m.ln(), logit(score), f64::from(is_cut)]
}

fn log_error(example: &DepthExample) -> f64 {
    (example.found_m - example.true_m).abs().max(MIN_ERROR_M).ln()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::DepthReference;

    /// A number in `[-1, 1)`, the same for the same `i`.
    fn noise(i: usize) -> f64 {
        (i as f64 * 0.618_033_988_75).fract() * 2.0 - 1.0
    }

    #[test]
    fn a_line_with_outliers_is_found_and_found_again() {
        let reference = DepthReference::KITTI;
        let example = |i: usize| {
            let found_m = 4.0 + (i as f64 * 0.37) % 60.0;
            let outlier = if i.is_multiple_of(9) { 40.0 } else { 0.0 };
            DepthExample { found_m, true_m: 0.5 + 0.95 * found_m + 0.3 * noise(i) + outlier, score: 0.5, is_cut: false }
        };
        let examples: Vec<_> = (0..4000).map(example).collect();
        let fit = reference.refitted(&examples).expect("a line");
        // A depth of `mean_m` comes out where the line has it, and so does one a deviation farther.
        for (found, expected) in [
            (fit.mean_m, 0.5 + 0.95 * reference.mean_m),
            (fit.mean_m + fit.std_m, 0.5 + 0.95 * (reference.mean_m + reference.std_m)),
        ] {
            assert!((found - expected).abs() < 0.1, "{found}, not {expected}");
        }
        let slope = fit.std_m / reference.std_m;
        let again =
            |e: &DepthExample| DepthExample { found_m: fit.mean_m + slope * (e.found_m - reference.mean_m), ..*e };
        let twice = fit.refitted(&examples.iter().map(again).collect::<Vec<_>>()).expect("a line");
        assert!(
            (twice.mean_m - fit.mean_m).abs() < 0.02 && (twice.std_m - fit.std_m).abs() < 0.02,
            "{twice:?}, {fit:?}"
        );
    }

    #[test]
    fn too_few_or_falling_examples_are_no_line() {
        let example =
            |i: usize| DepthExample { found_m: i as f64, true_m: 100.0 - i as f64, score: 0.5, is_cut: false };
        let falling: Vec<_> = (1..80).map(example).collect();
        assert_eq!(DepthReference::KITTI.refitted(&falling), None);
        assert_eq!(DepthReference::KITTI.refitted(&falling[..10]), None);
        let one_place = [DepthExample { found_m: 10.0, true_m: 11.0, score: 0.5, is_cut: false }; 60];
        assert_eq!(DepthReference::KITTI.refitted(&one_place), None);
        assert_eq!(RangeError::fit(&one_place), None);
        assert_eq!(RangeError::fit(&falling[..10]), None);
    }

    #[test]
    fn error_bars_grow_with_what_makes_errors_grow_and_hold_their_share() {
        let truth = RangeError { bias: -3.0, depth: 1.2, score: -0.4, cut: 0.7 };
        let example = |i: usize| {
            let (found_m, score) = (4.0 + (i as f64 * 0.37) % 60.0, 0.05 + (i as f64 * 0.0123) % 0.9);
            let is_cut = i.is_multiple_of(7);
            let sigma = truth.sigma_m(found_m, score, is_cut);
            // Of an even distribution this share lies within one sigma.
            DepthExample { found_m, true_m: found_m + sigma * noise(i) / WITHIN_ONE_SIGMA, score, is_cut }
        };
        let examples: Vec<_> = (0..5000).map(example).collect();
        let fit = RangeError::fit(&examples).expect("a fit");
        assert!((fit.depth - truth.depth).abs() < 0.1 && (fit.score - truth.score).abs() < 0.05, "{fit:?}");
        assert!((fit.cut - truth.cut).abs() < 0.1, "{fit:?}");
        let within = |e: &&DepthExample| (e.true_m - e.found_m).abs() <= fit.sigma_m(e.found_m, e.score, e.is_cut);
        let share = examples.iter().filter(within).count() as f64 / 5000.0;
        assert!((share - WITHIN_ONE_SIGMA).abs() < 0.01, "{share}");

        let whole: Vec<_> = examples.into_iter().filter(|e| !e.is_cut).collect();
        let fit = RangeError::fit(&whole).expect("a fit");
        assert!((fit.depth - truth.depth).abs() < 0.1 && fit.cut == 0.0, "none is cut: {fit:?}");
    }

    #[test]
    fn numbers_that_no_fit_gives_are_told_apart() {
        let fit = RangeError { bias: -3.0, depth: 1.2, score: -0.4, cut: 0.0 };
        assert!(fit.is_usable());
        assert!(!RangeError { depth: f64::NAN, ..fit }.is_usable() && !RangeError { bias: 1e3, ..fit }.is_usable());
    }
}

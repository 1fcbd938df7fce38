//! From the height of a peak to the probability that the detection is right.
//!
//! A near car's centre can lie in many cells, so its peak stays low however plain the car; a far one has a single cell
//! and a high peak. Ranked by their peaks, far cars and what looks like them come before near ones. A fit on labelled
//! frames puts that right: logistic regression on the peak's logit and on the logarithm of the box's height and its
//! square.

use serde::{Deserialize, Serialize};

use crate::linear::{dot, solved};

/// Height that the logarithms are taken against, pixels of the network's input.
const REFERENCE_HEIGHT_PX: f64 = 25.0;

/// Bounds of a score (SMOKE, spec section 4).
pub const SCORE_LIMITS: (f64, f64) = (1e-4, 1.0 - 1e-4);

/// Pull of the coefficients towards zero, in examples: keeps the fit finite when right and wrong can be told apart
/// perfectly.
const RIDGE: f64 = 1e-3;

/// Newton's method has long converged after so many steps.
const STEPS: usize = 50;

/// Peaks lower than this are looked at neither when fitting nor afterwards.
pub const MIN_PEAK: f64 = 0.03;

/// The least number of examples, here of right and of wrong ones each, that a fit is made of.
pub const MIN_EXAMPLES: usize = 50;

/// A fit: coefficients of the logit of the probability.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScoreCalibration {
    /// Of the peak's logit.
    pub peak: f64,
    /// Of the logarithm of the box's height over 25 pixels of the network's input.
    pub height: f64,
    /// Of that logarithm's square.
    pub height_squared: f64,
    /// Added.
    pub bias: f64,
    /// Smallest and largest height among the examples, pixels of the network's input; others count as these.
    pub heights_px: [f64; 2],
}

/// A detection of which is known whether it is right.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScoreExample {
    /// Height of its peak, 0 to 1.
    pub peak: f64,
    /// Height of its 2D box, pixels of the network's input.
    pub height_px: f64,
    /// Whether there is such an object.
    pub is_right: bool,
}

/// More than what rounding does to the logit of a peak, which comes as a single-precision number.
const ROUNDING: f64 = 1e-4;

/// Fits give numbers far below this.
const MAX_FACTOR: f64 = 100_000.0;

impl ScoreCalibration {
    /// Whether these are numbers that a fit could have given: files from strangers may hold others.
    pub fn is_usable(&self) -> bool {
        let [least, most] = self.heights_px;
        let numbers = [self.peak, self.height, self.height_squared, self.bias, most];
        numbers.iter().all(|number| number.abs() <= MAX_FACTOR) && 0.0 < least && least <= most
    }

    /// The probability that a detection with this peak (0 to 1, both excluded) and a 2D box of this height, pixels of
    /// the network's input, is right.
    pub fn probability(&self, peak: f64, height_px: f64) -> f64 {
        let [least, most] = self.heights_px;
        let terms = terms(peak, height_px.clamp(least, most));
        logistic(dot(&terms, &[self.peak, self.height, self.height_squared, self.bias]))
    }

    /// A peak below which the probability is less than `probability`, whatever the height; 0 where there is none.
    pub fn least_peak(&self, probability: f64) -> f64 {
        if self.peak <= 0.0 {
            return 0.0;
        }
        let [least, most] = self.heights_px.map(|height_px| (height_px / REFERENCE_HEIGHT_PX).ln());
        let summit = -self.height / (2.0 * self.height_squared);
        let inside = (summit > least && summit < most).then_some(summit);
        let of_height = |height: f64| self.height * height + self.height_squared * height * height;
        let best = [least, most].into_iter().chain(inside).map(of_height).fold(f64::NEG_INFINITY, f64::max);
        logistic((logit(probability) - best - self.bias) / self.peak - ROUNDING)
    }

    /// The fit to `examples`; none with fewer than [`MIN_EXAMPLES`] right or wrong ones.
    pub fn fit(examples: &[ScoreExample]) -> Option<Self> {
        let rows: Vec<([f64; 4], f64)> =
            examples.iter().map(|e| (terms(e.peak, e.height_px), f64::from(u8::from(e.is_right)))).collect();
        let [peak, height, height_squared, bias] = most_likely(&rows)?;
        let heights = examples.iter().map(|example| example.height_px);
        let heights_px = [heights.clone().fold(f64::INFINITY, f64::min), heights.fold(0.0, f64::max)];
        Some(Self { peak, height, height_squared, bias, heights_px })
    }
}

fn terms(peak: f64, height_px: f64) -> [f64; 4] {
    let height = (height_px / REFERENCE_HEIGHT_PX).ln();
    [logit(peak), height, height * height, 1.0]
}

/// The least peak of a class worth a look where detections are to have a score above `min_score`; what is below cannot
/// reach it.
pub fn least_peak(calibration: Option<&ScoreCalibration>, min_score: f64) -> f64 {
    // No score is less than the least one.
    let reached = if min_score < SCORE_LIMITS.0 { 0.0 } else { min_score };
    calibration.map_or(min_score, |calibration| calibration.least_peak(reached).max(MIN_PEAK))
}

/// The logarithm of the odds of a probability. Inverse of [`logistic`].
pub fn logit(probability: f64) -> f64 {
    (probability / (1.0 - probability)).ln()
}

/// The probability whose odds have this logarithm.
pub fn logistic(log_odds: f64) -> f64 {
    1.0 / (1.0 + (-log_odds).exp())
}

/// Logistic regression: the weights of the terms in each row that make its answers (1 for right, 0 for wrong) most
/// likely; none with fewer than [`MIN_EXAMPLES`] right or wrong ones.
pub fn most_likely(rows: &[([f64; 4], f64)]) -> Option<[f64; 4]> {
    let right = rows.iter().filter(|(_, is_right)| *is_right > 0.5).count();
    if right < MIN_EXAMPLES || rows.len() - right < MIN_EXAMPLES {
        return None;
    }
    let mut weights = [0.0; 4];
    for _ in 0..STEPS {
        let step = newton_step(rows, &weights)?;
        weights = std::array::from_fn(|i| weights[i] + step[i]);
    }
    weights.iter().all(|weight| weight.is_finite()).then_some(weights)
}

/// The step of Newton's method towards the most likely weights.
fn newton_step(rows: &[([f64; 4], f64)], weights: &[f64; 4]) -> Option<[f64; 4]> {
    let mut curvature = [[0.0; 4]; 4];
    let mut slope = weights.map(|weight| -RIDGE * weight);
    for (i, row) in curvature.iter_mut().enumerate() {
        row[i] = RIDGE;
    }
    for (terms, is_right) in rows {
        let probability = logistic(dot(terms, weights));
        for (i, row) in curvature.iter_mut().enumerate() {
            for (cell, term) in row.iter_mut().zip(terms) {
                *cell += probability * (1.0 - probability) * terms[i] * term;
            }
            slope[i] += terms[i] * (is_right - probability);
        }
    }
    solved(curvature, slope)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRUTH: ScoreCalibration =
        ScoreCalibration { peak: 1.5, height: 0.8, height_squared: 0.3, bias: 0.4, heights_px: [5.0, 160.0] };

    /// Examples on a grid, each as often right as the law says.
    fn examples() -> Vec<ScoreExample> {
        let mut examples = Vec::new();
        for peak in [0.04, 0.1, 0.2, 0.3, 0.5, 0.8] {
            for height_px in [5.0, 12.0, 30.0, 70.0, 160.0] {
                let right = (TRUTH.probability(peak, height_px) * 1000.0).round() as usize;
                examples.extend((0..1000).map(|i| ScoreExample { peak, height_px, is_right: i < right }));
            }
        }
        examples
    }

    #[test]
    fn a_fit_finds_the_law_that_made_the_examples() {
        let fit = ScoreCalibration::fit(&examples()).expect("enough examples");
        for (found, expected) in [
            (fit.peak, TRUTH.peak),
            (fit.height, TRUTH.height),
            (fit.height_squared, TRUTH.height_squared),
            (fit.bias, TRUTH.bias),
        ] {
            assert!((found - expected).abs() < 0.02, "{found}, not {expected}");
        }
        assert!(fit.heights_px.iter().zip(TRUTH.heights_px).all(|(found, truth)| (found - truth).abs() < 1e-9));
    }

    #[test]
    fn too_few_or_separable_examples_are_survived() {
        assert_eq!(ScoreCalibration::fit(&[]), None);
        let one_sided = [ScoreExample { peak: 0.5, height_px: 20.0, is_right: true }; 200];
        assert_eq!(ScoreCalibration::fit(&one_sided), None);
        let example =
            |is_right: bool| ScoreExample { peak: if is_right { 0.9 } else { 0.1 }, height_px: 20.0, is_right };
        let separable: Vec<_> = (0..200).map(|i| example(i % 2 == 0)).collect();
        let fit = ScoreCalibration::fit(&separable).expect("a fit");
        assert!(fit.probability(0.9, 20.0) > 0.99 && fit.probability(0.1, 20.0) < 0.01, "{fit:?}");
    }

    #[test]
    fn no_lower_peak_reaches_the_probability_and_a_higher_one_does() {
        let falling = ScoreCalibration { height: -0.7, height_squared: -0.2, heights_px: [8.0, 300.0], ..TRUTH };
        let flat = ScoreCalibration { height_squared: 0.0, ..TRUTH };
        for calibration in [TRUTH, falling, flat] {
            for probability in [1e-3, 0.04, 0.1, 0.5, 0.9] {
                let least = calibration.least_peak(probability);
                let best = |peak: f64| {
                    (0..=1000).map(|i| calibration.probability(peak, 0.3 * f64::from(i))).fold(0.0, f64::max)
                };
                assert!(best(least) < probability, "{calibration:?} at {probability}");
                assert!(best(logistic(logit(least) + 0.01)) > probability, "{calibration:?} at {probability}");
            }
            assert!(calibration.least_peak(0.0).abs() < 1e-12 && calibration.least_peak(1.0) > 1.0 - 1e-12);
        }
        // Where low peaks are the likely ones, all are looked at.
        assert!(ScoreCalibration { peak: -1.0, ..TRUTH }.least_peak(0.5).abs() < 1e-12);
        assert!((least_peak(Some(&TRUTH), 0.0) - MIN_PEAK).abs() < 1e-12);
        assert!((least_peak(Some(&TRUTH), 1e-5) - MIN_PEAK).abs() < 1e-12);
        assert!((least_peak(None, 0.3) - 0.3).abs() < 1e-12);
    }

    #[test]
    fn numbers_that_no_fit_gives_are_told_apart() {
        assert!(TRUTH.is_usable());
        for heights_px in [[0.0, 10.0], [20.0, 10.0], [f64::NAN, 10.0], [5.0, f64::INFINITY]] {
            assert!(!ScoreCalibration { heights_px, ..TRUTH }.is_usable(), "{heights_px:?}");
        }
        assert!(!ScoreCalibration { bias: f64::NAN, ..TRUTH }.is_usable());
    }

    #[test]
    fn heights_beyond_the_examples_count_as_the_last_one() {
        for (beyond, last) in [(1.0, 5.0), (1e9, 160.0)] {
            assert!((TRUTH.probability(0.2, beyond) - TRUTH.probability(0.2, last)).abs() < 1e-12);
        }
    }
}

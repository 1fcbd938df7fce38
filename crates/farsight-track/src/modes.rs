//! Two ways to move, evenly and with a foot on a pedal, and how likely each is: an interacting multiple model (Blom and
//! Bar-Shalom, 1988).

use crate::options::Motion;
use crate::state::{Matrix, N, State, Vector};

/// Ways to move.
pub(crate) const MODES: usize = 2;

/// A state for each way to move.
#[derive(Debug, Clone)]
pub(crate) struct Modes {
    states: [State; MODES],
    probabilities: [f64; MODES],
}

/// No way to move becomes less likely than this, so that each can come back.
const MIN_PROBABILITY: f64 = 1e-4;

impl Modes {
    /// The same state for all, as likely as they are in the long run.
    pub(crate) fn new(state: &State, motion: &[Motion; MODES]) -> Self {
        let total: f64 = motion.iter().map(|mode| mode.lasts_s).sum();
        let probabilities = std::array::from_fn(|mode| motion[mode].lasts_s / total);
        Self { states: std::array::from_fn(|_| state.clone()), probabilities }
    }

    /// Moves on by `dt_s` seconds: a way to move may have become the other one, then each state is moved by `step`.
    pub(crate) fn predict(&mut self, dt_s: f64, motion: &[Motion; MODES], step: impl Fn(&State, &Motion) -> State) {
        // How likely each is still the same: a chain in continuous time.
        let [a, b] = [1.0 / motion[0].lasts_s, 1.0 / motion[1].lasts_s];
        let left = (-(a + b) * dt_s).exp();
        let to = [
            [1.0 - a * (1.0 - left) / (a + b), a * (1.0 - left) / (a + b)],
            [b * (1.0 - left) / (a + b), 1.0 - b * (1.0 - left) / (a + b)],
        ];
        let joint = |from: usize, mode: usize| self.probabilities[from] * to[from][mode];
        let probabilities: [f64; MODES] = std::array::from_fn(|mode| (0..MODES).map(|from| joint(from, mode)).sum());
        let states = std::array::from_fn(|mode| {
            let weights = std::array::from_fn(|from| joint(from, mode) / probabilities[mode]);
            step(&mixed(self.states.each_ref(), weights), &motion[mode])
        });
        (self.states, self.probabilities) = (states, probabilities);
    }

    /// As [`State::update`], of each; those that expected the number become more likely. Returns the mean of what they
    /// return.
    pub(crate) fn update(&mut self, row: &Vector, measured: f64, variance: f64, tolerance: f64) -> f64 {
        let mut likelihoods = [0.0; MODES];
        let mut squares = [0.0; MODES];
        for (mode, state) in self.states.iter_mut().enumerate() {
            let spread = state.variance(row) + variance;
            let squared = state.update(row, measured, variance, tolerance);
            // An outlier tells nothing of how it moves.
            likelihoods[mode] =
                (-0.5 * squared.min(tolerance * tolerance)).exp() / spread.max(f64::MIN_POSITIVE).sqrt();
            squares[mode] = squared;
        }
        let weighted: [f64; MODES] = std::array::from_fn(|mode| self.probabilities[mode] * likelihoods[mode]);
        let total: f64 = weighted.iter().sum();
        if total.is_finite() && total > 0.0 {
            let limited = weighted.map(|weight| (weight / total).max(MIN_PROBABILITY));
            let total: f64 = limited.iter().sum();
            self.probabilities = limited.map(|weight| weight / total);
        }
        squares.iter().zip(self.probabilities).map(|(squared, probability)| squared * probability).sum()
    }

    /// Mean and covariance of all together.
    pub(crate) fn state(&self) -> State {
        mixed(self.states.each_ref(), self.probabilities)
    }
}

/// Mean and covariance of a mixture of states.
pub(crate) fn mixed<const COUNT: usize>(states: [&State; COUNT], weights: [f64; COUNT]) -> State {
    let mut mean: Vector = [0.0; N];
    for (state, weight) in states.iter().zip(weights) {
        for (sum, value) in mean.iter_mut().zip(state.mean) {
            *sum += weight * value;
        }
    }
    let mut covariance: Matrix = [[0.0; N]; N];
    for (state, weight) in states.iter().zip(weights) {
        let off: Vector = std::array::from_fn(|i| state.mean[i] - mean[i]);
        for i in 0..N {
            for j in 0..N {
                covariance[i][j] += weight * (state.covariance[i][j] + off[i] * off[j]);
            }
        }
    }
    State { mean, covariance }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state::{LOG_DEPTH, LOG_RATE, row};

    const MOTION: [Motion; MODES] =
        [Motion { acceleration_psd: 0.1, lasts_s: 4.0 }, Motion { acceleration_psd: 4.0, lasts_s: 1.0 }];

    fn start() -> State {
        let mut covariance = [[0.0; N]; N];
        for (place, row) in covariance.iter_mut().enumerate() {
            row[place] = 0.01;
        }
        State { mean: [0.1, 0.0, 3.0, -0.1, 0.0, 0.4, 0.0], covariance }
    }

    #[test]
    fn alike_states_mix_to_themselves() {
        let modes = Modes::new(&start(), &MOTION);
        assert!((modes.probabilities[0] - 0.8).abs() < 1e-12, "{:?}", modes.probabilities);
        let state = modes.state();
        for i in 0..N {
            assert!((state.mean[i] - start().mean[i]).abs() < 1e-12);
            for j in 0..N {
                assert!((state.covariance[i][j] - start().covariance[i][j]).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn in_the_long_run_each_is_as_likely_as_it_lasts_and_steps_add_up() {
        let keep = |state: &State, _: &Motion| state.clone();
        let mut long = Modes { states: [start(), start()], probabilities: [0.0, 1.0] };
        let mut short = long.clone();
        long.predict(1.0, &MOTION, keep);
        for _ in 0..10 {
            short.predict(0.1, &MOTION, keep);
        }
        assert!((long.probabilities[0] - short.probabilities[0]).abs() < 1e-12, "{long:?} {short:?}");
        long.predict(1000.0, &MOTION, keep);
        assert!((long.probabilities[0] - 0.8).abs() < 1e-12, "{:?}", long.probabilities);
    }

    #[test]
    fn the_mixture_has_the_moments_of_its_parts() {
        let mut other = start();
        other.mean[LOG_RATE] = 0.3;
        other.covariance[LOG_RATE][LOG_RATE] = 0.05;
        let state = mixed([&start(), &other], [0.25, 0.75]);
        assert!((state.mean[LOG_RATE] - (0.25 * -0.1 + 0.75 * 0.3)).abs() < 1e-12);
        // Mean of the squares less the square of the mean.
        let squares = 0.25 * (0.01 + 0.01) + 0.75 * (0.05 + 0.09);
        let expected = squares - state.mean[LOG_RATE].powi(2);
        assert!((state.covariance[LOG_RATE][LOG_RATE] - expected).abs() < 1e-12);
    }

    #[test]
    fn what_was_expected_becomes_more_likely() {
        let mut sure = start();
        sure.covariance[LOG_DEPTH][LOG_DEPTH] = 1e-4;
        let modes = Modes { states: [sure, start()], probabilities: [0.5, 0.5] };
        for (measured, likelier) in [(3.0, 0), (3.15, 1)] {
            let mut after = modes.clone();
            after.update(&row([(LOG_DEPTH, 1.0)]), measured, 1e-4, 9.0);
            assert!(after.probabilities[likelier] > 0.6, "{measured}: {:?}", after.probabilities);
        }
    }
}

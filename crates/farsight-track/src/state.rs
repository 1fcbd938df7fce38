//! What is kept of one object's motion, and how it moves on.

use farsight_core::scalar::{Dual, Scalar};

/// Numbers of a state.
pub(crate) const N: usize = 7;
/// Bearing `x / z` of the centre.
pub(crate) const BEARING: usize = 0;
/// Its change in a second.
pub(crate) const BEARING_RATE: usize = 1;
/// Logarithm of the depth of the nearest face, metres.
pub(crate) const LOG_DEPTH: usize = 2;
/// Change of that in a second.
pub(crate) const LOG_RATE: usize = 3;
/// Logarithm of the factor by which told distances are wrong.
pub(crate) const FACTOR: usize = 4;
/// Logarithm of the height, metres, that goes with the box in the image.
pub(crate) const LOG_HEIGHT: usize = 5;
/// Lasting error of the logarithm of the box's height.
pub(crate) const HEIGHT_ERROR: usize = 6;

/// A vector of the state's numbers.
pub(crate) type Vector = [f64; N];
/// A matrix over them.
pub(crate) type Matrix = [[f64; N]; N];

/// Mean and covariance.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct State {
    pub(crate) mean: Vector,
    pub(crate) covariance: Matrix,
}

/// What passes the camera's own plane does not come nearer than by this factor in one step.
const NEAREST_STEP: f64 = 0.05;

impl State {
    /// The state after `dt_s` at constant velocity; `half_depth_m` lies between the nearest face and the centre.
    /// Noise is not added here.
    pub(crate) fn moved(&self, dt_s: f64, half_depth_m: f64) -> Self {
        let [bearing, bearing_rate, log_depth, log_rate, ..] = self.mean;
        let growth = (1.0 + log_rate * dt_s).max(NEAREST_STEP);
        let mut mean = self.mean;
        let mut step = identity();

        let [u, du, rho, k] = Dual::<4>::variables([bearing, bearing_rate, log_depth, log_rate]);
        let near = rho.exp();
        let speed = k * near;
        let centre = near + half_depth_m;
        let aside_speed = du * centre + u * speed;
        let later = near * (k * dt_s + 1.0) + half_depth_m;
        if later.value > half_depth_m {
            let moved = (u * centre + aside_speed * dt_s) / later;
            let rate = (aside_speed - moved * speed) / later;
            (mean[BEARING], mean[BEARING_RATE]) = (moved.value, rate.value);
            step[BEARING][..4].copy_from_slice(&moved.gradient);
            step[BEARING_RATE][..4].copy_from_slice(&rate.gradient);
        }
        mean[LOG_DEPTH] = log_depth + growth.ln();
        mean[LOG_RATE] = log_rate / growth;
        step[LOG_DEPTH][LOG_RATE] = dt_s / growth;
        step[LOG_RATE][LOG_RATE] = 1.0 / (growth * growth);

        Self { mean, covariance: symmetric(&product(&product(&step, &self.covariance), &transposed(&step))) }
    }

    /// Takes in a number that should be `row * mean`, with this variance. An innovation of more than `tolerance`
    /// standard deviations counts less and less. Returns its square in its expected variance.
    pub(crate) fn update(&mut self, row: &Vector, measured: f64, variance: f64, tolerance: f64) -> f64 {
        let seen: Vector = std::array::from_fn(|i| dot(&self.covariance[i], row));
        let spread = dot(&seen, row);
        let innovation = measured - dot(&self.mean, row);
        if spread + variance <= 0.0 {
            // Known already.
            return 0.0;
        }
        let squared = innovation * innovation / (spread + variance);
        let excess = squared / (tolerance * tolerance);
        let variance = if excess > 1.0 { (spread + variance) * excess - spread } else { variance };
        let total = spread + variance;
        for i in 0..N {
            self.mean[i] += seen[i] / total * innovation;
            for j in 0..N {
                self.covariance[i][j] -= seen[i] * seen[j] / total;
            }
        }
        squared
    }

    /// Variance of `row * state`.
    pub(crate) fn variance(&self, row: &Vector) -> f64 {
        let seen: Vector = std::array::from_fn(|i| dot(&self.covariance[i], row));
        dot(&seen, row).max(0.0)
    }
}

/// A row that reads these numbers of the state, each times its factor.
pub(crate) fn row<const M: usize>(entries: [(usize, f64); M]) -> Vector {
    let mut row = [0.0; N];
    for (place, factor) in entries {
        row[place] = factor;
    }
    row
}

fn dot(a: &Vector, b: &Vector) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn identity() -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j))))
}

fn transposed(a: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]))
}

fn product(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..N).map(|k| a[i][k] * b[k][j]).sum()))
}

fn symmetric(a: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| f64::midpoint(a[i][j], a[j][i])))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::needless_range_loop, reason = "indices of matrices")]

    use super::*;

    fn state(mean: Vector) -> State {
        let mut covariance = [[0.0; N]; N];
        for (i, row) in covariance.iter_mut().enumerate() {
            row[i] = 0.01 * (i + 1) as f64;
        }
        State { mean, covariance }
    }

    /// Place and velocity over the ground, metres.
    fn ground(state: &State, half_depth_m: f64) -> [f64; 4] {
        let [u, du, rho, k, ..] = state.mean;
        let near = rho.exp();
        let centre = near + half_depth_m;
        [u * centre, centre, du * centre + u * k * near, k * near]
    }

    #[test]
    fn what_moves_evenly_does_so_in_logarithms_too() {
        let before = state([0.2, 0.05, 2.5, -0.12, 0.0, 0.4, 0.0]);
        for dt in [0.01, 0.1, 1.0, 3.0] {
            let [x, z, vx, vz] = ground(&before, 1.9);
            let after = ground(&before.moved(dt, 1.9), 1.9);
            for (found, expected) in after.into_iter().zip([x + vx * dt, z + vz * dt, vx, vz]) {
                assert!((found - expected).abs() < 1e-9, "{found} is not {expected} after {dt} s");
            }
        }
    }

    #[test]
    fn the_covariance_goes_with_the_derivatives() {
        let before = state([0.2, 0.05, 2.5, -0.12, 0.0, 0.4, 0.0]);
        let (dt, half, tiny) = (0.3, 1.9, 1e-6);
        let after = before.moved(dt, half);
        let mut expected = [[0.0; N]; N];
        for place in 0..N {
            let shifted = |by: f64| {
                let mut other = before.clone();
                other.mean[place] += by;
                other.moved(dt, half).mean
            };
            let (up, down) = (shifted(tiny), shifted(-tiny));
            let slope: Vector = std::array::from_fn(|i| (up[i] - down[i]) / (2.0 * tiny));
            for i in 0..N {
                for j in 0..N {
                    expected[i][j] += slope[i] * slope[j] * before.covariance[place][place];
                }
            }
        }
        for i in 0..N {
            for j in 0..N {
                assert!((after.covariance[i][j] - expected[i][j]).abs() < 1e-8, "{i} {j}");
            }
        }
    }

    #[test]
    fn an_update_is_bayes_rule() {
        let mut found = state([0.0; N]);
        let prior = found.covariance[LOG_DEPTH][LOG_DEPTH];
        found.update(&row([(LOG_DEPTH, 1.0)]), 0.2, 0.05, 9.0);
        let posterior = 1.0 / (1.0 / prior + 1.0 / 0.05);
        assert!((found.covariance[LOG_DEPTH][LOG_DEPTH] - posterior).abs() < 1e-12);
        assert!((found.mean[LOG_DEPTH] - 0.2 * posterior / 0.05).abs() < 1e-12);
    }

    #[test]
    fn what_passes_the_camera_stays_a_number() {
        let past = state([0.2, 0.05, 0.5, -3.0, 0.0, 0.4, 0.0]).moved(2.0, 1.9);
        assert!(past.mean.iter().chain(past.covariance.iter().flatten()).all(|number| number.is_finite()), "{past:?}");
    }
}

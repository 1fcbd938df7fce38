//! Intervals by drawing frames again and again (Efron 1979, percentile method).
//!
//! Frames are drawn, not objects: the errors within one image hang together, and an interval that ignores that is too
//! narrow.

use farsight_core::statistics::quantile;
use rand::RngExt;
use rand_pcg::Pcg64;
use rayon::prelude::*;
use serde::Serialize;

/// Shares of the resamples below and above an interval: 95% lie in it.
const TAILS: [f64; 2] = [0.025, 0.975];

/// How intervals are found. The same seed gives the same intervals on every machine and for any number of threads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Bootstrap {
    /// How often the frames are drawn anew.
    pub resamples: usize,
    /// Where the random numbers start.
    pub seed: u64,
}

impl Default for Bootstrap {
    /// 1,000 resamples: the ends of an interval are good to about a tenth of its width.
    fn default() -> Self {
        Self { resamples: 1000, seed: 0 }
    }
}

/// Where 95% of the resamples lie; in JSON `[low, high]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(into = "[f64; 2]")]
pub struct Interval {
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

impl From<Interval> for [f64; 2] {
    fn from(interval: Interval) -> Self {
        [interval.low, interval.high]
    }
}

impl Interval {
    /// Whether zero lies outside: the sign of the figure is not an accident of the frames.
    pub fn excludes_zero(&self) -> bool {
        self.low > 0.0 || self.high < 0.0
    }

    /// The interval of these values; `None` when fewer than half of them are numbers.
    pub(crate) fn of(values: &mut Vec<f64>) -> Option<Self> {
        let drawn = values.len();
        values.retain(|v| v.is_finite());
        if values.is_empty() || 2 * values.len() < drawn {
            return None;
        }
        values.sort_unstable_by(f64::total_cmp);
        let [low, high] = TAILS.map(|share| quantile(values, share));
        Some(Self { low, high })
    }
}

impl Bootstrap {
    /// The interval of each value that `statistics` computes; it is given how often each of the `frames` was drawn.
    ///
    /// `statistics` must always give the same number of values; NaN where a resample has none. Without resamples there
    /// are no intervals.
    pub(crate) fn intervals(
        &self,
        frames: usize,
        statistics: impl Fn(&[u32]) -> Vec<f64> + Sync,
    ) -> Vec<Option<Interval>> {
        let resamples: Vec<Vec<f64>> =
            (0..self.resamples).into_par_iter().map(|index| statistics(&self.draw(frames, index))).collect();
        let count = resamples.first().map_or_else(|| statistics(&vec![1; frames]).len(), Vec::len);
        let interval = |i: usize| Interval::of(&mut resamples.iter().map(|values| values[i]).collect());
        (0..count).into_par_iter().map(interval).collect()
    }

    /// How often each frame is drawn in the resample with this number; each has a stream of random numbers of its own.
    pub fn draw(&self, frames: usize, resample: usize) -> Vec<u32> {
        drawn(frames, Pcg64::new(u128::from(self.seed), resample as u128))
    }

    /// How often each run of an experiment is drawn in the resample with this number, independent of its frames.
    pub fn draw_runs(&self, runs: usize, resample: usize) -> Vec<u32> {
        drawn(runs, Pcg64::new(u128::from(self.seed), (1 << 64) + resample as u128))
    }
}

/// How often each of `count` things comes up in as many draws.
fn drawn(count: usize, mut random: Pcg64) -> Vec<u32> {
    let mut drawn = vec![0; count];
    for _ in 0..count {
        drawn[random.random_range(0..count)] += 1;
    }
    drawn
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_interval_of_a_mean_is_that_of_the_central_limit() {
        // 0 and 1 in turn: the mean of n frames has the standard deviation 0.5 / sqrt(n).
        let frames = 400;
        let mean = |drawn: &[u32]| vec![f64::from(drawn.iter().skip(1).step_by(2).sum::<u32>()) / frames as f64];
        let interval = Bootstrap { resamples: 2000, seed: 3 }.intervals(frames, mean)[0].unwrap();
        let half_width = 1.96 * 0.5 / (frames as f64).sqrt();
        assert!((interval.low - (0.5 - half_width)).abs() < 0.006, "{interval:?}");
        assert!((interval.high - (0.5 + half_width)).abs() < 0.006, "{interval:?}");
    }

    #[test]
    fn the_same_seed_gives_the_same_interval() {
        let sum = |drawn: &[u32]| vec![drawn.iter().zip(0..).map(|(w, i)| f64::from(w * i)).sum(), f64::NAN];
        let intervals = |seed| Bootstrap { resamples: 100, seed }.intervals(50, sum);
        assert_eq!(intervals(1), intervals(1));
        assert_ne!(intervals(1), intervals(2));
        assert_eq!(intervals(1)[1], None);
        let without = Bootstrap { resamples: 0, seed: 1 }.intervals(50, sum);
        assert_eq!(without, [None, None]);
    }
}

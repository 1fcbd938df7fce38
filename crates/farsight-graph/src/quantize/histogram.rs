//! What values a map takes, and which range to give it.

use super::Range;

/// Bins on each side of zero. At least half of them are in use.
const BINS: usize = 4096;

/// The first width of a bin; it doubles whenever a value lies beyond the last bin.
const FIRST_WIDTH: f32 = 1.0 / (1 << 20) as f32;

/// Clipped ranges that [`Observer::MeanSquare`] tries, the whole range included.
const TRIES: usize = 64;

/// The narrowest of them, as a share of the whole range.
const NARROWEST: f32 = 0.2;

/// How a range is chosen from the values that were seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Observer {
    /// From the smallest value to the largest.
    MinMax,
    /// So that this share of the values (percent) lies inside, the rest in equal parts beyond both ends.
    Percentile(f64),
    /// So that the mean square error of rounding and clipping is least, of a number of clipped ranges.
    MeanSquare,
}

/// Counts of the values of a map in bins of equal width on both sides of zero, as many values as may come.
///
/// Takes the same memory for any number of values. The width of the bins is a power of two and grows with the values,
/// so what was counted does not depend on their order.
#[derive(Debug, Clone, PartialEq)]
pub struct Histogram {
    width: f32,
    /// Counts of `[i width, (i + 1) width)`.
    positive: Vec<u64>,
    /// Counts of `(-(i + 1) width, -i width]`, without zero itself.
    negative: Vec<u64>,
    ends: [f32; 2],
}

impl Default for Histogram {
    fn default() -> Self {
        Self { width: FIRST_WIDTH, positive: vec![0; BINS], negative: vec![0; BINS], ends: [0.0; 2] }
    }
}

impl Histogram {
    /// Counts `values`; what is not finite is left out.
    pub fn add(&mut self, values: &[f32]) {
        let finite = || values.iter().copied().filter(|value| value.is_finite());
        let [low, high] = finite().fold(self.ends, |[low, high], value| [low.min(value), high.max(value)]);
        self.ends = [low, high];
        while low.abs().max(high) >= self.width * BINS as f32 {
            self.widen();
        }
        let scale = 1.0 / self.width;
        for value in finite() {
            let side = if value < 0.0 { &mut self.negative } else { &mut self.positive };
            // The check above keeps the index inside; the limit keeps it there whatever rounding does.
            side[((value.abs() * scale) as usize).min(BINS - 1)] += 1;
        }
    }

    /// Bins twice as wide.
    fn widen(&mut self) {
        self.width *= 2.0;
        for side in [&mut self.positive, &mut self.negative] {
            for i in 0..BINS {
                side[i] = if i < BINS / 2 { side[2 * i] + side[2 * i + 1] } else { 0 };
            }
        }
    }

    /// The range that `observer` chooses.
    pub fn range(&self, observer: Observer) -> Range {
        let [low, high] = self.ends;
        match observer {
            Observer::MinMax => Range::new(low, high),
            Observer::Percentile(percent) => self.percentile(percent),
            Observer::MeanSquare => self.least_square(),
        }
    }

    fn total(&self) -> u64 {
        self.positive.iter().chain(&self.negative).sum()
    }

    fn percentile(&self, percent: f64) -> Range {
        let outside = ((100.0 - percent) / 100.0 * self.total() as f64 / 2.0).floor() as u64;
        let [low, high] = self.ends;
        let high = self.end(&self.positive, outside).min(high);
        let low = (-self.end(&self.negative, outside)).max(low);
        Range::new(low, high)
    }

    /// The distance from zero beyond which at most `outside` of the values of a side lie.
    fn end(&self, side: &[u64], outside: u64) -> f32 {
        let mut beyond = 0;
        let bins = side.iter().rposition(|count| {
            beyond += count;
            beyond > outside
        });
        bins.map_or(0.0, |bin| (bin + 1) as f32 * self.width)
    }

    fn least_square(&self) -> Range {
        let [low, high] = self.ends;
        let clipped = |i: usize| {
            let share = 1.0 - (1.0 - NARROWEST) * i as f32 / (TRIES - 1) as f32;
            [Range::new(low * share, high * share), Range::new(low, high * share)]
        };
        let tries = (0..TRIES).flat_map(clipped);
        let best = tries.map(|range| (self.square_error(range), range)).min_by(|(a, _), (b, _)| a.total_cmp(b));
        best.map_or(Range::new(low, high), |(_, range)| range)
    }

    /// The mean square error of `range` for what was counted, each value taken for the middle of its bin.
    pub fn square_error(&self, range: Range) -> f64 {
        let side = |counts: &[u64], sign: f32| {
            let bins = counts.iter().enumerate().filter(|(_, count)| **count > 0);
            let errors = bins.map(|(bin, count)| {
                let value = sign * (bin as f32 + 0.5) * self.width;
                f64::from(range.rounded(value) - value).powi(2) * *count as f64
            });
            errors.sum::<f64>()
        };
        (side(&self.positive, 1.0) + side(&self.negative, -1.0)) / self.total().max(1) as f64
    }
}

#[cfg(test)]
#[allow(clippy::float_cmp, reason = "these values are exact")]
mod tests {
    use proptest::prelude::*;

    use super::{Histogram, Observer};

    fn counted(values: &[f32]) -> Histogram {
        let mut histogram = Histogram::default();
        histogram.add(values);
        histogram
    }

    proptest! {
        #[test]
        fn every_range_contains_zero_and_no_more_than_was_seen(
            values in prop::collection::vec(-100.0_f32..300.0, 1..200), percent in 90.0..100.0
        ) {
            let histogram = counted(&values);
            let [least, most] = histogram.range(Observer::MinMax).ends();
            prop_assert!(values.iter().all(|value| (least..=most).contains(value)));
            for observer in [Observer::Percentile(percent), Observer::MeanSquare] {
                let [low, high] = histogram.range(observer).ends();
                prop_assert!(low <= 0.0 && high >= 0.0);
                prop_assert!(low >= least && high <= most, "{observer:?}");
            }
        }

        #[test]
        fn the_mean_square_is_never_worse_than_by_the_other_observers_ends(values in prop::collection::vec(-1.0_f32..5.0, 1..300)) {
            let histogram = counted(&values);
            let error = |observer| histogram.square_error(histogram.range(observer));
            prop_assert!(error(Observer::MeanSquare) <= error(Observer::MinMax));
        }

        #[test]
        fn the_order_of_values_does_not_matter(mut values in prop::collection::vec(-1e3_f32..1e3, 1..100), cut in 0_usize..100) {
            let whole = counted(&values);
            values.reverse();
            let (first, second) = values.split_at(cut.min(values.len()));
            let mut parts = counted(first);
            parts.add(second);
            prop_assert_eq!(whole, parts);
        }
    }

    #[test]
    fn percentiles_leave_out_what_is_rare() {
        let mut values: Vec<f32> = (0..10_000).map(|i| i as f32 / 1e4).collect();
        values.push(100.0);
        let [low, high] = counted(&values).range(Observer::Percentile(99.9)).ends();
        assert!(low.abs() < 1e-9 && (0.9..1.1).contains(&high), "{high}");
        let [_, high] = counted(&values).range(Observer::Percentile(100.0)).ends();
        assert!((high - 100.0).abs() < 1e-9, "{high}");
        // Half of the share on each side.
        let both: Vec<f32> = (-500..500).map(|i| i as f32).collect();
        let [low, high] = counted(&both).range(Observer::Percentile(90.0)).ends();
        assert!((low + 450.0).abs() < 2.0 && (high - 450.0).abs() < 2.0, "{low} {high}");
    }

    #[test]
    fn a_lone_outlier_is_clipped_where_that_is_better() {
        let mut values = vec![0.5; 100_000];
        values.extend((0..100_000).map(|i| i as f32 / 1e5));
        values.push(4.0);
        let histogram = counted(&values);
        let [least, whole] = [Observer::MeanSquare, Observer::MinMax].map(|observer| histogram.range(observer));
        assert!((1.0..3.9).contains(&least.ends()[1]), "{least:?}");
        assert!(histogram.square_error(least) < 0.9 * histogram.square_error(whole));
    }

    #[test]
    fn what_is_no_number_is_left_out() {
        let histogram = counted(&[f32::NAN, f32::INFINITY, -2.0, 1.0]);
        assert_eq!(histogram.range(Observer::MinMax).ends(), [-2.0, 1.0]);
        assert_eq!(Histogram::default().range(Observer::MeanSquare).ends(), [0.0, 1.0]);
    }
}

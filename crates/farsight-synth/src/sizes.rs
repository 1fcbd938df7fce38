//! How large things in traffic are, and how many and how far away they are seen.
//!
//! Every number is a statistic of the 7,481 label files of KITTI's training set, printed by
//! `cargo run --release -p farsight-synth --example label_statistics -- LABEL_DIR`. Lengths are metres.

use farsight_core::{Dimensions, ObjectClass};

use crate::rng::SceneRng;

/// The percents at which [`Distribution::percentiles`] lie.
pub const PERCENTILES: [f64; 7] = [1.0, 5.0, 25.0, 50.0, 75.0, 95.0, 99.0];

/// Where [`PERCENTILES`] of the standard normal distribution lie.
const NORMAL_SCORES: [f64; 7] = [-2.326, -1.645, -0.674, 0.0, 0.674, 1.645, 2.326];

/// How one measure is distributed. Heights of cars are skewed: half are below 1.50 m and their mean is 1.53 m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Distribution {
    /// Mean, metres.
    pub mean: f64,
    /// Values at [`PERCENTILES`], metres; nothing beyond the first and the last is drawn.
    pub percentiles: [f64; 7],
}

impl Distribution {
    /// The value, metres, that is as far from the median as `score`, in standard deviations, is from that of a normal
    /// distribution.
    pub fn at_z_score(&self, score: f64) -> f64 {
        let end = NORMAL_SCORES.iter().position(|&above| score < above);
        match end {
            Some(0) => self.percentiles[0],
            None => self.percentiles[6],
            Some(end) => {
                let [low, high] = [end - 1, end].map(|k| NORMAL_SCORES[k]);
                let share = (score - low) / (high - low);
                self.percentiles[end - 1] + share * (self.percentiles[end] - self.percentiles[end - 1])
            }
        }
    }

    /// Smallest and largest value that is drawn, metres.
    pub fn limits(&self) -> [f64; 2] {
        [self.percentiles[0], self.percentiles[6]]
    }
}

/// Sizes of one class.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SizeStatistics {
    /// Vertical extent.
    pub height: Distribution,
    /// Extent across the heading.
    pub width: Distribution,
    /// Extent along the heading.
    pub length: Distribution,
    /// Share of the deviations that height, width and length have in common (long ones are wide): square root of the
    /// mean correlation.
    pub shared: f64,
}

const fn distribution(mean: f64, percentiles: [f64; 7]) -> Distribution {
    Distribution { mean, percentiles }
}

const CAR: SizeStatistics = SizeStatistics {
    height: distribution(1.526, [1.27, 1.36, 1.43, 1.50, 1.59, 1.78, 1.97]),
    width: distribution(1.629, [1.36, 1.47, 1.57, 1.63, 1.68, 1.80, 1.88]),
    length: distribution(3.884, [2.94, 3.20, 3.59, 3.88, 4.19, 4.52, 4.89]),
    shared: 0.53,
};
const VAN: SizeStatistics = SizeStatistics {
    height: distribution(2.207, [1.71, 1.78, 1.94, 2.13, 2.48, 2.75, 2.87]),
    width: distribution(1.902, [1.56, 1.64, 1.79, 1.88, 2.02, 2.20, 2.46]),
    length: distribution(5.078, [3.72, 3.92, 4.43, 4.98, 5.75, 6.64, 6.86]),
    shared: 0.84,
};
const TRUCK: SizeStatistics = SizeStatistics {
    height: distribution(3.252, [2.32, 2.60, 2.85, 3.34, 3.52, 4.05, 4.19]),
    width: distribution(2.585, [2.06, 2.21, 2.47, 2.63, 2.63, 2.89, 2.97]),
    length: distribution(10.109, [5.42, 6.19, 7.87, 10.81, 12.34, 16.44, 16.79]),
    shared: 0.57,
};
// The shortest trams are cut off by the edge of what the annotators saw; their 3.14 m are rounded up.
const TRAM: SizeStatistics = SizeStatistics {
    height: distribution(3.529, [3.17, 3.19, 3.33, 3.61, 3.65, 3.71, 3.84]),
    width: distribution(2.544, [2.17, 2.17, 2.34, 2.60, 2.74, 2.80, 2.81]),
    length: distribution(16.094, [3.15, 3.22, 12.71, 14.66, 18.10, 35.24, 35.24]),
    shared: 0.0,
};
const PEDESTRIAN: SizeStatistics = SizeStatistics {
    height: distribution(1.761, [1.50, 1.57, 1.69, 1.77, 1.84, 1.93, 1.97]),
    width: distribution(0.660, [0.38, 0.43, 0.55, 0.65, 0.75, 0.91, 0.96]),
    length: distribution(0.842, [0.30, 0.42, 0.68, 0.88, 1.01, 1.17, 1.32]),
    shared: 0.45,
};
const SITTING: SizeStatistics = SizeStatistics {
    height: distribution(1.275, [1.06, 1.14, 1.23, 1.26, 1.32, 1.39, 1.64]),
    width: distribution(0.595, [0.48, 0.50, 0.51, 0.59, 0.65, 0.75, 0.75]),
    length: distribution(0.802, [0.50, 0.57, 0.65, 0.75, 0.84, 1.33, 1.33]),
    shared: 0.24,
};
const CYCLIST: SizeStatistics = SizeStatistics {
    height: distribution(1.737, [1.44, 1.59, 1.68, 1.75, 1.81, 1.86, 1.98]),
    width: distribution(0.597, [0.34, 0.34, 0.53, 0.60, 0.66, 0.83, 0.88]),
    length: distribution(1.764, [1.19, 1.50, 1.69, 1.76, 1.89, 2.02, 2.12]),
    shared: 0.52,
};
const MISC: SizeStatistics = SizeStatistics {
    height: distribution(1.907, [0.76, 0.93, 1.24, 1.65, 2.43, 3.48, 3.91]),
    width: distribution(1.514, [0.40, 0.51, 0.85, 1.51, 2.13, 2.57, 2.68]),
    length: distribution(3.576, [0.77, 1.47, 1.95, 2.52, 3.84, 11.68, 12.60]),
    shared: 0.84,
};

impl SizeStatistics {
    /// The sizes of a class; those of `Misc` for a class that KITTI does not have.
    pub fn of(class: &ObjectClass) -> Self {
        match class {
            ObjectClass::Car => CAR,
            ObjectClass::Van => VAN,
            ObjectClass::Truck => TRUCK,
            ObjectClass::Tram => TRAM,
            ObjectClass::Pedestrian => PEDESTRIAN,
            ObjectClass::PersonSitting => SITTING,
            ObjectClass::Cyclist => CYCLIST,
            _ => MISC,
        }
    }

    /// Draws a size.
    pub(crate) fn sample(&self, rng: &mut SceneRng) -> Dimensions {
        let common = rng.normal(0.0, 1.0);
        let own = (1.0 - self.shared * self.shared).sqrt();
        let mut one = |spread: &Distribution| spread.at_z_score(self.shared * common + own * rng.normal(0.0, 1.0));
        Dimensions { height: one(&self.height), width: one(&self.width), length: one(&self.length) }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use farsight_core::{Dimensions, ObjectClass};

    use super::{PERCENTILES, SizeStatistics};
    use crate::rng::SceneRng;

    #[test]
    fn draws_have_the_percentiles_that_they_come_from() {
        let sizes = SizeStatistics::of(&ObjectClass::Car);
        let mut rng = SceneRng::new(1, 2, 3);
        let drawn: Vec<Dimensions> = (0..40_000).map(|_| sizes.sample(&mut rng)).collect();
        let column = |measure: fn(&Dimensions) -> f64| drawn.iter().map(measure).collect::<Vec<f64>>();
        let heights = (sizes.height, column(|d| d.height));
        let widths = (sizes.width, column(|d| d.width));
        let lengths = (sizes.length, column(|d| d.length));
        for (spread, mut values) in [heights, widths, lengths] {
            values.sort_by(f64::total_cmp);
            let [low, high] = spread.limits();
            assert!(values[0] >= low && *values.last().unwrap() <= high);
            for (percent, expected) in PERCENTILES.iter().zip(spread.percentiles) {
                let found = values[(percent / 100.0 * values.len() as f64) as usize];
                assert!((found - expected).abs() < 0.012 * (high - low), "{percent} %: {found}, expected {expected}");
            }
        }
    }

    #[test]
    fn a_higher_score_is_never_smaller() {
        for class in ObjectClass::KITTI {
            let height = SizeStatistics::of(&class).height;
            let heights: Vec<f64> = (-40..=40).map(|tenth| height.at_z_score(f64::from(tenth) / 10.0)).collect();
            assert!(heights.is_sorted(), "{class}: {heights:?}");
            assert!((height.at_z_score(0.0) - height.percentiles[3]).abs() < 1e-12);
        }
    }
}

//! How large things in traffic are, and how many and how far away they are seen.
//!
//! Every number is a statistic of the 7,481 label files of KITTI's training set, printed by
//! `cargo run --release -p farsight-synth --example label_statistics -- LABEL_DIR`. Lengths are metres.

use farsight_core::{Dimensions, ObjectClass};

use crate::dice::Dice;

/// Mean, standard deviation, and the 1st and 99th percentile of one measure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread {
    /// Mean, metres.
    pub mean: f64,
    /// Standard deviation, metres.
    pub deviation: f64,
    /// Nothing smaller is drawn, metres.
    pub low: f64,
    /// Nothing larger is drawn, metres.
    pub high: f64,
}

/// Sizes of one class.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SizeStatistics {
    /// Vertical extent.
    pub height: Spread,
    /// Extent across the heading.
    pub width: Spread,
    /// Extent along the heading.
    pub length: Spread,
    /// Share of the deviations that height, width and length have in common (long ones are wide): square root of the mean correlation.
    pub shared: f64,
}

const fn spread(mean: f64, deviation: f64, low: f64, high: f64) -> Spread {
    Spread { mean, deviation, low, high }
}

const CAR: SizeStatistics = SizeStatistics {
    height: spread(1.526, 0.137, 1.27, 1.97),
    width: spread(1.629, 0.102, 1.36, 1.88),
    length: spread(3.884, 0.426, 2.94, 4.89),
    shared: 0.53,
};
const VAN: SizeStatistics = SizeStatistics {
    height: spread(2.207, 0.325, 1.71, 2.87),
    width: spread(1.902, 0.173, 1.56, 2.46),
    length: spread(5.078, 0.831, 3.72, 6.86),
    shared: 0.84,
};
const TRUCK: SizeStatistics = SizeStatistics {
    height: spread(3.252, 0.449, 2.32, 4.19),
    width: spread(2.585, 0.216, 2.06, 2.97),
    length: spread(10.109, 2.858, 5.42, 16.79),
    shared: 0.57,
};
// The shortest trams are cut off by the edge of what the annotators saw; their 3.14 m are rounded up.
const TRAM: SizeStatistics = SizeStatistics {
    height: spread(3.529, 0.176, 3.17, 3.84),
    width: spread(2.544, 0.215, 2.17, 2.81),
    length: spread(16.094, 7.852, 3.15, 35.24),
    shared: 0.0,
};
const PEDESTRIAN: SizeStatistics = SizeStatistics {
    height: spread(1.761, 0.113, 1.50, 1.97),
    width: spread(0.660, 0.143, 0.38, 0.96),
    length: spread(0.842, 0.235, 0.30, 1.32),
    shared: 0.45,
};
const SITTING: SizeStatistics = SizeStatistics {
    height: spread(1.275, 0.110, 1.06, 1.64),
    width: spread(0.595, 0.079, 0.48, 0.75),
    length: spread(0.802, 0.222, 0.50, 1.33),
    shared: 0.24,
};
const CYCLIST: SizeStatistics = SizeStatistics {
    height: spread(1.737, 0.095, 1.44, 1.98),
    width: spread(0.597, 0.124, 0.34, 0.88),
    length: spread(1.764, 0.177, 1.19, 2.12),
    shared: 0.52,
};
const MISC: SizeStatistics = SizeStatistics {
    height: spread(1.907, 0.814, 0.76, 3.91),
    width: spread(1.514, 0.674, 0.40, 2.68),
    length: spread(3.576, 2.858, 0.77, 12.60),
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
    pub(crate) fn draw(&self, dice: &mut Dice) -> Dimensions {
        let common = dice.normal(0.0, 1.0);
        let own = (1.0 - self.shared * self.shared).sqrt();
        let mut one = |spread: &Spread| {
            let deviation = self.shared * common + own * dice.normal(0.0, 1.0);
            (spread.mean + spread.deviation * deviation).clamp(spread.low, spread.high)
        };
        Dimensions { height: one(&self.height), width: one(&self.width), length: one(&self.length) }
    }
}

//! The figures that a set of distance errors is summed up in.

use serde::ser::{Serialize, SerializeMap, Serializer};

/// One metric. `Z` figures are of the location's z, `Ground` figures of the distance over the ground.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RangingMetric {
    /// Share of the objects that were found.
    Share,
    /// Mean absolute error, metres.
    MaeZ,
    /// Root of the mean squared error, metres.
    RmseZ,
    /// Mean error, metres; positive when objects seem farther than they are.
    BiasZ,
    /// Mean of absolute error over true distance.
    AbsRelZ,
    /// Mean of error over true distance; positive when objects seem farther than they are.
    BiasRelZ,
    /// Share of the found objects whose distance is right within a factor of 1.05.
    Delta105Z,
    /// The same for a factor of 1.10.
    Delta110Z,
    /// The same for a factor of 1.25.
    Delta125Z,
    /// Mean absolute error, metres.
    MaeGround,
    /// Root of the mean squared error, metres.
    RmseGround,
    /// Mean error, metres.
    BiasGround,
    /// Mean of absolute error over true distance.
    AbsRelGround,
    /// Share of the found objects whose distance is right within a factor of 1.05.
    Delta105Ground,
    /// The same for a factor of 1.10.
    Delta110Ground,
    /// The same for a factor of 1.25.
    Delta125Ground,
}

/// The factors of the delta figures.
pub(super) const DELTA_FACTORS: [f64; 3] = [1.05, 1.10, 1.25];

impl RangingMetric {
    /// How many there are.
    pub const COUNT: usize = 16;

    /// All of them, in the order of reports.
    pub const ALL: [Self; Self::COUNT] = [
        Self::Share,
        Self::MaeZ,
        Self::RmseZ,
        Self::BiasZ,
        Self::AbsRelZ,
        Self::BiasRelZ,
        Self::Delta105Z,
        Self::Delta110Z,
        Self::Delta125Z,
        Self::MaeGround,
        Self::RmseGround,
        Self::BiasGround,
        Self::AbsRelGround,
        Self::Delta105Ground,
        Self::Delta110Ground,
        Self::Delta125Ground,
    ];

    /// The name in JSON.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Share => "share",
            Self::MaeZ => "mae_z",
            Self::RmseZ => "rmse_z",
            Self::BiasZ => "bias_z",
            Self::AbsRelZ => "abs_rel_z",
            Self::BiasRelZ => "bias_rel_z",
            Self::Delta105Z => "delta_1.05_z",
            Self::Delta110Z => "delta_1.10_z",
            Self::Delta125Z => "delta_1.25_z",
            Self::MaeGround => "mae_ground",
            Self::RmseGround => "rmse_ground",
            Self::BiasGround => "bias_ground",
            Self::AbsRelGround => "abs_rel_ground",
            Self::Delta105Ground => "delta_1.05_ground",
            Self::Delta110Ground => "delta_1.10_ground",
            Self::Delta125Ground => "delta_1.25_ground",
        }
    }
}

/// A value for every [`RangingMetric`]; in JSON a map by name.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RangingMetrics<T>([T; RangingMetric::COUNT]);

impl<T> RangingMetrics<T> {
    /// The values that `of` gives each metric.
    pub fn from_fn(of: impl FnMut(RangingMetric) -> T) -> Self {
        Self(RangingMetric::ALL.map(of))
    }

    /// All values, in the order of [`RangingMetric::ALL`].
    pub fn iter(&self) -> impl Iterator<Item = (RangingMetric, &T)> {
        RangingMetric::ALL.into_iter().zip(&self.0)
    }
}

impl<T: Copy> RangingMetrics<T> {
    /// The value of one metric.
    pub fn get(&self, metric: RangingMetric) -> T {
        self.0[metric as usize]
    }
}

impl<T: Serialize> Serialize for RangingMetrics<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(RangingMetric::COUNT))?;
        for (metric, value) in self.iter() {
            map.serialize_entry(metric.name(), value)?;
        }
        map.end()
    }
}

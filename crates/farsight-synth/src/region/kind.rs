//! One row of a region's table: a kind of vehicle.

use farsight_core::{Dimensions, ObjectClass};
use serde::Deserialize;

use crate::objects::Shape;
use crate::rng::SceneRng;
use crate::scene::Color;

/// Where the 2nd and 98th percentile of the standard normal distribution lie, to either side.
const END_SCORE: f64 = 2.054;

/// Share of the deviations that height, width and length have in common.
const SHARED: f64 = 0.6;

/// A likelihood below this is no smaller: what fits no row still gets one.
const MIN_LIKELIHOOD: f64 = 1e-9;

/// Where a kind of vehicle is seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Traffic {
    /// Everywhere, and parked.
    #[default]
    Private,
    /// Everywhere, more seldom parked: vans, small lorries.
    Work,
    /// On motorways more, in side streets hardly.
    Heavy,
    /// In towns only: buses, three-wheelers.
    Town,
    /// On rails, in cities.
    Rail,
    /// Two wheels and whoever rides them.
    Rider,
    /// Stands at the kerb.
    Parked,
}

/// A kind of vehicle.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct VehicleKind {
    pub(crate) name: String,
    pub(crate) shape: Shape,
    /// KITTI's class of its labels.
    class: String,
    /// Relative frequency in moving traffic of a town.
    pub(crate) share: f64,
    #[serde(default)]
    pub(crate) traffic: Traffic,
    /// 2nd, 50th and 98th percentile, metres, without mirrors; nothing beyond is drawn.
    pub(crate) length_m: [f64; 3],
    pub(crate) width_m: [f64; 3],
    pub(crate) height_m: [f64; 3],
    /// The colours that it comes in; otherwise those of the region's cars, or of fleets.
    #[serde(default)]
    pub(crate) colors: Vec<Color>,
}

impl VehicleKind {
    pub(crate) fn class(&self) -> ObjectClass {
        ObjectClass::from_name(&self.class)
    }

    pub(crate) fn problem(&self) -> Option<String> {
        let wrong = |name: &str, [least, median, most]: [f64; 3]| {
            (!(0.2 < least && least <= median && median <= most && most < 60.0))
                .then(|| format!("{}: {name} is [{least}, {median}, {most}]", self.name))
        };
        wrong("length_m", self.length_m)
            .or_else(|| wrong("width_m", self.width_m))
            .or_else(|| wrong("height_m", self.height_m))
            .or_else(|| matches!(self.class(), ObjectClass::Other(_)).then(|| format!("{}: its class", self.name)))
    }

    /// Draws a size.
    pub(crate) fn sample(&self, rng: &mut SceneRng) -> Dimensions {
        let common = rng.normal(0.0, 1.0);
        let own = (1.0 - SHARED * SHARED).sqrt();
        let mut one = |[least, median, most]: [f64; 3]| {
            let score = SHARED * common + own * rng.normal(0.0, 1.0);
            let share = (score / END_SCORE).clamp(-1.0, 1.0);
            median + share * if share < 0.0 { median - least } else { most - median }
        };
        Dimensions { height: one(self.height_m), width: one(self.width_m), length: one(self.length_m) }
    }

    /// How usual a size is: the density of a normal distribution in each measure, up to a factor.
    pub(crate) fn likelihood(&self, size: Dimensions) -> f64 {
        let score = |value: f64, [least, median, most]: [f64; 3]| {
            let reach = if value < median { median - least } else { most - median };
            END_SCORE * (value - median) / reach.max(0.05)
        };
        let scores =
            [score(size.length, self.length_m), score(size.width, self.width_m), score(size.height, self.height_m)];
        libm::exp(-0.5 * scores.iter().map(|s| s * s).sum::<f64>()).max(MIN_LIKELIHOOD)
    }
}

//! What is known of a motion before a picture is looked at.

use farsight_core::road::RoadPlane;

use crate::motion::{AHEAD, ASIDE, COUNT, DOWN, Motion, PITCH, ROLL, SLOPE, TILT, YAW};

/// How fast cameras go that nobody has seen before: mean and standard deviation, m/s; how they turn, rad/s.
const ANY_SPEED_MPS: [f64; 2] = [8.0, 20.0];
const ANY_YAW_RATE: f64 = 0.5;

/// How speed and yaw rate change: standard deviations of the acceleration, m/s², and of its like, rad/s².
const ACCELERATION_MPS2: f64 = 4.0;
const YAW_ACCELERATION: f64 = 1.0;

/// How fast cars nod and roll, rad/s.
const NOD_RATE: f64 = 0.15;

/// How far a camera leaves the arc of its car: metres, as a share of the way, and metres for each radian that the car
/// turns, as cameras are not above the rear axle. How far it goes up and down, in the same way.
const ASIDE_M: f64 = 0.003;
const ASIDE_SHARE: f64 = 0.02;
const ASIDE_TURNED_M: f64 = 1.5;
const DOWN_M: f64 = 0.004;
const DOWN_SHARE: f64 = 0.005;

/// How slope and tilt of the road against the camera change beside what the camera turns, in a root second.
const SLOPE_CHANGE: f64 = 0.005;

/// What is believed after a frame, each with its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Belief {
    pub(crate) speed_mps: [f64; 2],
    pub(crate) yaw_rate: [f64; 2],
    pub(crate) slope: [f64; 2],
    pub(crate) tilt: [f64; 2],
}

/// Likeliest values and standard deviations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Prior {
    pub(crate) mean: Motion,
    pub(crate) sigma: Motion,
}

impl Prior {
    /// Of the next `dt_s` seconds.
    pub(crate) fn new(road: &RoadPlane, belief: Option<&Belief>, dt_s: f64) -> Self {
        let (mut mean, mut sigma) = ([0.0; COUNT], [0.0; COUNT]);
        let ([speed, speed_sigma], [yaw_rate, yaw_sigma], [slope, slope_sigma], [tilt, tilt_sigma]) = match belief {
            Some(belief) => (
                [belief.speed_mps[0], belief.speed_mps[1].hypot(ACCELERATION_MPS2 * dt_s)],
                [belief.yaw_rate[0], belief.yaw_rate[1].hypot(YAW_ACCELERATION * dt_s)],
                [belief.slope[0], belief.slope[1].hypot(SLOPE_CHANGE * dt_s.sqrt()).min(road.sigmas[0])],
                [belief.tilt[0], belief.tilt[1].hypot(SLOPE_CHANGE * dt_s.sqrt()).min(road.sigmas[1])],
            ),
            None => (ANY_SPEED_MPS, [0.0, ANY_YAW_RATE], [road.slope, road.sigmas[0]], [road.tilt, road.sigmas[1]]),
        };
        for (place, [middle, spread]) in [
            (PITCH, [0.0, NOD_RATE * dt_s]),
            (YAW, [yaw_rate * dt_s, yaw_sigma * dt_s]),
            (ROLL, [0.0, NOD_RATE * dt_s]),
            (AHEAD, [speed * dt_s, speed_sigma * dt_s]),
            (SLOPE, [slope, slope_sigma]),
            (TILT, [tilt, tilt_sigma]),
        ] {
            mean[place] = middle;
            sigma[place] = spread.max(1e-6);
        }
        let usual_m = (speed.abs() + speed_sigma) * dt_s;
        Self { mean, sigma }.on_way(usual_m, (yaw_rate.abs() + yaw_sigma) * dt_s)
    }

    /// The same for a way of so many metres and a turn of so many radians: by them go the metres aside and down.
    pub(crate) fn on_way(mut self, way_m: f64, turned: f64) -> Self {
        self.sigma[ASIDE] = ASIDE_M + ASIDE_SHARE * way_m.abs() + ASIDE_TURNED_M * turned.abs();
        self.sigma[DOWN] = DOWN_M + DOWN_SHARE * way_m.abs();
        self
    }

    pub(crate) fn precision(&self, place: usize) -> f64 {
        1.0 / (self.sigma[place] * self.sigma[place])
    }

    /// The logarithm of how likely a motion is, but for a constant.
    pub(crate) fn log_likelihood(&self, motion: &Motion) -> f64 {
        let part = |k: usize| -0.5 * self.precision(k) * (motion[k] - self.mean[k]).powi(2);
        (0..COUNT).map(part).sum()
    }
}

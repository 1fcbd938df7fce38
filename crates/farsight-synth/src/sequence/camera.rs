//! The camera's car: its way along the road, and how its body nods and sways.

use super::heading;
use crate::generator::ground::Ground;
use crate::generator::path::Path;
use crate::rng::SceneRng;

/// A car's body as a damped pendulum: natural frequency, rad/s, and damping ratio.
const FREQUENCY: f64 = 8.0;
const DAMPING: f64 = 0.3;

/// By so much a car dives when it brakes, radians for each m/s².
const DIVE: f64 = 0.005;

/// What an uneven road does to pitch and roll, radians a second squared in a root second, at 10 m/s.
const ROUGH_PITCH: f64 = 0.09;
const ROUGH_ROLL: f64 = 0.06;

/// The heading is that of the road over so many metres before and behind: cars are long.
const CAR_M: f64 = 3.0;

/// The camera in one frame, in the street's coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct EgoStep {
    pub(super) point: [f64; 2],
    /// To the right of z, radians.
    pub(super) heading: f64,
    pub(super) speed_mps: f64,
    /// Over the ground, x and z, m/s.
    pub(super) velocity: [f64; 2],
    /// To the left, rad/s.
    pub(super) yaw_rate: f64,
    pub(super) acceleration_mps2: f64,
    /// Downwards, radians: body and slope of the road against that of the first frame.
    pub(super) pitch: f64,
    pub(super) roll: f64,
    /// Of pitch and roll, rad/s.
    pub(super) nod_rates: [f64; 2],
}

/// Pitch and roll of the body.
#[derive(Debug, Clone, Copy)]
pub(super) struct Body {
    /// Angle and rate, radians.
    pitch: [f64; 2],
    roll: [f64; 2],
    roughness: f64,
}

impl Body {
    pub(super) fn new(rng: &mut SceneRng) -> Self {
        Self { pitch: [0.0; 2], roll: [0.0; 2], roughness: rng.log_range(0.3, 1.6) }
    }

    /// After a short time `dt_s`.
    pub(super) fn step(&mut self, dt_s: f64, speed: f64, acceleration: f64, rng: &mut SceneRng) {
        let strength = self.roughness * (speed / 10.0).sqrt() * dt_s.sqrt();
        let rest = [-DIVE * acceleration, 0.0];
        let noise = [ROUGH_PITCH, ROUGH_ROLL].map(|rough| rough * strength * rng.normal(0.0, 1.0));
        for (k, [angle, rate]) in [&mut self.pitch, &mut self.roll].into_iter().enumerate() {
            let pull = FREQUENCY * FREQUENCY * (rest[k] - *angle) - 2.0 * DAMPING * FREQUENCY * *rate;
            *rate += dt_s * pull + noise[k];
            *angle += dt_s * *rate;
        }
    }
}

/// Heading of the road at `s`.
fn heading_at(path: &Path, s: f64) -> f64 {
    let sum = [-1.0, -0.5, 0.0, 0.5, 1.0].map(|share| path.at(s + share * CAR_M).direction);
    heading([0, 1].map(|axis| sum.iter().map(|direction| direction[axis]).sum()))
}

/// The camera at `s` of its road.
pub(super) fn ego_step(path: &Path, s: f64, speed: f64, acceleration: f64, body: &Body, ground: &Ground) -> EgoStep {
    /// Over so many metres differences are taken.
    const SHORT_M: f64 = 0.05;
    let node = path.at(s);
    let [before, after] = [-SHORT_M, SHORT_M].map(|off| heading_at(path, s + off));
    let turned = farsight_core::wrapped_angle(after - before) / (2.0 * SHORT_M);
    let slope = |s: f64| {
        let [back, front] = [-CAR_M / 2.0, CAR_M / 2.0].map(|off| ground.y(path.at(s + off).point));
        (front - back) / CAR_M
    };
    let steeper = (slope(s + SHORT_M) - slope(s - SHORT_M)) / (2.0 * SHORT_M);
    EgoStep {
        point: node.point,
        heading: heading_at(path, s),
        speed_mps: speed,
        velocity: node.direction.map(|part| part * speed),
        yaw_rate: -turned * speed,
        acceleration_mps2: acceleration,
        pitch: body.pitch[0] + libm::atan(slope(s) - slope(0.0)),
        roll: body.roll[0],
        nod_rates: [body.pitch[1] + steeper * speed, body.roll[1]],
    }
}

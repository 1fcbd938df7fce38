//! What is told of a track.

use farsight_core::depth_fusion::NORMAL_INTERVAL_SIGMAS;
use farsight_core::{Box2d, Box3d, Detection, ObjectClass};

/// One vehicle or person at one time.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Track {
    /// Its identity, from 1; never used again.
    pub id: u64,
    /// What it is: what most of its detections said, by their scores.
    pub class: ObjectClass,
    /// Score of its latest detection, 0 to 1.
    pub score: f64,
    /// Frames since its first detection, this one included.
    pub age: u64,
    /// Its box in the image, pixels, clipped to it: as detected, or as expected while it coasts.
    pub box2d: Box2d,
    /// Where it is, rectified camera coordinates, metres; its size is learnt over its life.
    pub box3d: Box3d,
    /// Standard deviation of its depth, metres.
    pub range_sigma_m: f64,
    /// How it moves relative to the camera; none where that is not known yet.
    pub velocity: Option<Velocity>,
    /// How fast it comes nearer; none where that is not known yet.
    pub closing: Option<Closing>,
    /// Whether nothing was seen of it in this frame.
    pub coasting: bool,
}

/// Velocity relative to the camera, in its coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Velocity {
    /// Right, down, ahead, m/s. That down is 0: it moves over the ground.
    pub mps: [f64; 3],
    /// Their standard deviations, m/s.
    pub sigma_mps: [f64; 3],
    /// Covariance of the velocities to the right and ahead, m^2/s^2.
    pub covariance_xz: f64,
}

/// How fast the depth of an object shrinks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Closing {
    /// By so much a second, m/s.
    pub mps: f64,
    /// Its standard deviation, m/s.
    pub sigma_mps: f64,
    /// Time until the nearest face reaches the camera's plane at this speed, seconds; none unless it closes with a
    /// probability of 80%.
    pub ttc_s: Option<f64>,
    /// That time is between these with a probability of 90%, seconds; no upper end where it may never be; none where it
    /// surely (95%) does not close.
    pub ttc_interval_s: Option<(f64, Option<f64>)>,
    /// Probability that it is in our way then, if neither changes its velocity; none where there is no `ttc_s`.
    pub in_path: Option<f64>,
    /// How that speed grows; none where it is not known yet.
    pub acceleration: Option<Acceleration>,
}

/// How a closing speed grows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Acceleration {
    /// By so much a second, m/s^2: positive where it comes nearer faster and faster.
    pub closing_mps2: f64,
    /// Its standard deviation, m/s^2.
    pub sigma_mps2: f64,
}

/// How the camera moves over the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EgoMotion {
    /// Ahead, m/s.
    pub speed_mps: f64,
    /// Standard deviation of that, m/s.
    pub speed_sigma_mps: f64,
    /// To the left, rad/s.
    pub yaw_rate: f64,
    /// Standard deviation of that, rad/s.
    pub yaw_rate_sigma: f64,
}

impl EgoMotion {
    /// How what stands still at x and z, metres, moves before a camera that turns to the left and drives ahead: right
    /// and ahead, m/s.
    pub fn velocity_of_still(&self, [x, z]: [f64; 2]) -> [f64; 2] {
        [self.yaw_rate * z, -self.speed_mps - self.yaw_rate * x]
    }
}

/// From so many standard deviations on it is said to close: one-sided 80%.
const CLOSES_SIGMAS: f64 = 0.842;

impl Closing {
    /// Of a speed and the change of the logarithm of the nearest face's depth in a second, each with its standard
    /// deviation.
    pub(crate) fn new(mps: f64, sigma_mps: f64, [rate, rate_sigma]: [f64; 2]) -> Self {
        let [_, most] = NORMAL_INTERVAL_SIGMAS;
        let (fastest, slowest) = (-rate + most * rate_sigma, -rate - most * rate_sigma);
        Self {
            mps,
            sigma_mps,
            ttc_s: (-rate > CLOSES_SIGMAS * rate_sigma).then(|| -1.0 / rate),
            ttc_interval_s: (fastest > 0.0).then(|| (1.0 / fastest, (slowest > 0.0).then(|| 1.0 / slowest))),
            in_path: None,
            acceleration: None,
        }
    }
}

impl Track {
    /// Depth, metres.
    pub fn range_m(&self) -> f64 {
        self.box3d.depth_m()
    }

    /// The depth is between these with a probability of 90%, metres.
    pub fn range_interval_m(&self) -> [f64; 2] {
        let [_, most] = NORMAL_INTERVAL_SIGMAS;
        let depth_m = self.range_m();
        [-most, most].map(|sigmas| depth_m * (sigmas * self.range_sigma_m / depth_m).exp())
    }

    /// Speed over the ground and its standard deviation, m/s, of a camera that moves so; none where its velocity is not
    /// known.
    pub fn speed_mps(&self, ego: &EgoMotion) -> Option<[f64; 2]> {
        let Velocity { mps: [vx, _, vz], sigma_mps: [sx, _, sz], covariance_xz } = self.velocity?;
        let [x, _, z] = self.box3d.location;
        let still = ego.velocity_of_still([x, z]);
        let moved = [vx - still[0], vz - still[1]];
        let [turned_x, turned_z] = [z * ego.yaw_rate_sigma, x * ego.yaw_rate_sigma];
        let xx = sx * sx + turned_x * turned_x;
        let zz = sz * sz + turned_z * turned_z + ego.speed_sigma_mps.powi(2);
        let xz = covariance_xz - turned_x * turned_z;
        let speed = moved[0].hypot(moved[1]);
        let along = if speed > 0.0 { moved.map(|v| v / speed) } else { [0.0, 1.0] };
        let variance = along[0] * along[0] * xx + 2.0 * along[0] * along[1] * xz + along[1] * along[1] * zz;
        Some([speed, variance.max(0.0).sqrt()])
    }

    /// It as a detection, which evaluation, drawing and result files take.
    pub fn detection(&self) -> Detection {
        let Self { class, score, box2d, box3d, range_sigma_m, .. } = self;
        Detection {
            class: class.clone(),
            score: *score,
            box2d: *box2d,
            box3d: *box3d,
            range_sigma_m: Some(*range_sigma_m),
        }
    }
}

//! Picture after picture.

use farsight_core::road::RoadPlane;
use farsight_core::{Box2d, Camera};

use crate::fit::{Fit, Problem};
use crate::grey::{Grey, factor, pyramid};
use crate::motion::{AHEAD, Motion, PITCH, Pinhole, SLOPE, TILT, Warp, YAW};
use crate::prior::{Belief, Prior};
use crate::tracking::Seen;

/// Fewer flows that fit than these, on the road and in all, tell nothing.
const LEAST_ON_ROAD: f64 = 5.0;
const LEAST: f64 = 16.0;

/// Nor do they where a smaller share of the flows fits, of those in the road's region to the road, and of the others: a
/// wrong speed finds a few patches on a road that has little texture, and none many that lie still in the picture.
const LEAST_ROAD_SHARE: f64 = 0.4;
const LEAST_STANDING_SHARE: f64 = 0.5;

/// A speed is told where two pictures alone make it surer than this, m/s and as a share.
const MAX_SIGMA_MPS: f64 = 0.7;
const MAX_SIGMA_SHARE: f64 = 0.15;

/// Speeds at which patches are looked for where nothing is known, m/s.
const FIRST_SPEEDS_MPS: [f64; 6] = [0.0, 6.0, 12.0, 19.0, 27.0, 36.0];

/// Pictures farther apart than this are not compared, seconds.
const MAX_GAP_S: f64 = 0.7;

/// How wrong a road's plane makes a speed, as a share: roads are not flat. Chosen on rendered sequences.
pub(crate) const ROAD_SHARE: f64 = 0.02;

/// How far the plane under a camera of which only the height is known tips: standard deviations of slope and tilt.
const ANY_SLOPE: f64 = 0.05;
const ANY_TILT: f64 = 0.03;

/// How fast a camera speeds up and turns faster within the time between two pictures, of which the mean is seen: m/s²
/// and rad/s².
const USUAL_ACCELERATION: [f64; 2] = [1.0, 0.03];

/// One picture.
#[derive(Debug, Clone, Copy)]
pub struct OdometryFrame<'a> {
    /// Its time, seconds.
    pub time_s: f64,
    /// Width and height, pixels.
    pub image_size: [usize; 2],
    /// 8-bit RGB, row by row.
    pub rgb: &'a [u8],
    /// Its camera, a pinhole.
    pub camera: &'a Camera,
    /// What may move: its boxes are left out.
    pub objects: &'a [Box2d],
    /// Whether it shows another scene than the picture before.
    pub looks_cut: bool,
}

/// How a camera moved from the last picture to this one.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct CameraMotion {
    /// Ahead, m/s.
    pub speed_mps: f64,
    /// Standard deviation of that, m/s.
    pub speed_sigma_mps: f64,
    /// To the left, rad/s.
    pub yaw_rate: f64,
    /// Standard deviation of that, rad/s.
    pub yaw_rate_sigma: f64,
    /// By so much it nodded downwards since the last picture, radians.
    pub pitch_rad: f64,
    /// Standard deviation of that, radians.
    pub pitch_sigma_rad: f64,
    /// By so much the road comes up towards the optical axis now, metres a metre.
    pub slope: f64,
    /// Standard deviation of that.
    pub slope_sigma: f64,
    /// How many patches of the picture are of the road, and of other things that stand still.
    pub patches: [f64; 2],
}

/// Tells how a camera moves from picture to picture. It keeps one picture.
pub struct Odometry {
    road: RoadPlane,
    before: Option<(f64, [usize; 2], Seen)>,
    belief: Option<Belief>,
}

impl Odometry {
    /// Of a camera over a road that is known.
    pub fn new(road: RoadPlane) -> Self {
        Self { road, before: None, belief: None }
    }

    /// Of a camera so many metres above the road (and its standard deviation), which looks ahead about level.
    pub fn above_road(height_m: f64, sigma_m: f64) -> Self {
        Self::new(RoadPlane { slope: 0.0, tilt: 0.0, height_m, sigmas: [ANY_SLOPE, ANY_TILT, sigma_m] })
    }

    /// The motion from the last picture to this one. None where they do not tell: the first picture, a cut, one of
    /// another size, too long after the last one or not after it, too little texture, no road.
    pub fn update(&mut self, frame: &OdometryFrame) -> Option<CameraMotion> {
        let [width, height] = frame.image_size;
        if width == 0 || frame.rgb.len() < width.saturating_mul(height).saturating_mul(3) {
            return None;
        }
        let factor = factor(width);
        let now = Pinhole::new(frame.camera, factor).map(|pinhole| {
            let pyramid = pyramid(Grey::from_rgb(frame.rgb, frame.image_size, factor).smoothed());
            (frame.time_s, frame.image_size, Seen::new(pyramid, pinhole, frame.objects, factor))
        });
        let before = std::mem::replace(&mut self.before, now);
        let belief = self.belief.take();
        let ((before_s, before_size, before), (_, _, now)) = before.as_ref().zip(self.before.as_ref())?;
        let dt_s = frame.time_s - before_s;
        let may = *before_size == frame.image_size
            && before.pinhole == now.pinhole
            && !frame.looks_cut
            && dt_s > 0.0
            && dt_s <= MAX_GAP_S;
        let (motion, belief) = may.then(|| self.between(before, now, belief.as_ref(), dt_s)).flatten()?;
        self.belief = Some(belief);
        Some(motion)
    }

    fn between(&self, before: &Seen, now: &Seen, belief: Option<&Belief>, dt_s: f64) -> Option<(CameraMotion, Belief)> {
        let prior = Prior::new(&self.road, belief, dt_s);
        // As seen along the plane's normal.
        let height_m = self.road.height_m / (1.0 + self.road.slope.powi(2) + self.road.tilt.powi(2)).sqrt();
        let warp = |motion: &Motion| Warp::new(motion, &before.pinhole, height_m);
        let look = |motion: &Motion, prior: &Prior, knows: bool, start: Option<&Motion>| {
            let warp = warp(motion);
            let flows = before.flows(now, &before.corners(&warp), &warp, knows);
            let problem =
                Problem { flows: &flows, pinhole: &before.pinhole, height_m, prior, is_first: belief.is_none() };
            (flows.len() as f64 >= LEAST).then(|| Some((problem.fit(start)?, flows.len()))).flatten()
        };
        let found = if belief.is_some() {
            look(&prior.mean, &prior, true, None)
        } else {
            // Patches of the road look otherwise nearer by: found are those of about the speed that is looked for.
            let first = FIRST_SPEEDS_MPS
                .iter()
                .filter_map(|speed| {
                    let mut motion = prior.mean;
                    motion[AHEAD] = speed * dt_s;
                    look(&motion, &prior, false, Some(&motion))
                })
                .max_by(|(a, _), (b, _)| a.evidence().total_cmp(&b.evidence()))?;
            let motion = first.0.motion;
            look(&motion, &prior.on_way(motion[AHEAD], motion[YAW]), true, Some(&motion))
        };
        let (fit, count) = found?;
        self.told(&fit, count, dt_s)
    }

    fn told(&self, fit: &Fit, count: usize, dt_s: f64) -> Option<(CameraMotion, Belief)> {
        let Fit { motion, sigma, own_ahead_sigma, on_road, standing, low, .. } = *fit;
        let speed = motion[AHEAD] / dt_s;
        let fits = on_road >= LEAST_ON_ROAD.max(LEAST_ROAD_SHARE * low as f64)
            && on_road + standing >= LEAST
            && standing >= LEAST_STANDING_SHARE * (count - low) as f64
            && own_ahead_sigma / dt_s < MAX_SIGMA_MPS.max(MAX_SIGMA_SHARE * speed.abs());
        if !fits {
            return None;
        }
        let yaw_rate = [motion[YAW] / dt_s, sigma[YAW] / dt_s];
        let slope = [motion[SLOPE] + motion[PITCH], sigma[SLOPE].hypot(sigma[PITCH])];
        let belief =
            Belief { speed_mps: [speed, sigma[AHEAD] / dt_s], yaw_rate, slope, tilt: [motion[TILT], sigma[TILT]] };
        // The mean of the time between is told for its end.
        let late = USUAL_ACCELERATION.map(|change| 0.5 * change * dt_s);
        let alike = (self.road.sigmas[2] / self.road.height_m).hypot(ROAD_SHARE) * speed;
        let told = CameraMotion {
            speed_mps: speed,
            speed_sigma_mps: (sigma[AHEAD] / dt_s).hypot(alike).hypot(late[0]),
            yaw_rate: yaw_rate[0],
            yaw_rate_sigma: yaw_rate[1].hypot(late[1]),
            pitch_rad: motion[PITCH],
            pitch_sigma_rad: sigma[PITCH],
            slope: slope[0],
            slope_sigma: slope[1],
            patches: [on_road, standing],
        };
        Some((told, belief))
    }
}

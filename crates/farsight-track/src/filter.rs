//! One object's filter: what a detection tells of it, and what is then known.

use farsight_core::{Box2d, Box3d, Camera, Detection, Dimensions};

use crate::modes::{Modes, mixed};
use crate::options::{Noise, TrackerOptions};
use crate::state::{
    BEARING, BEARING_RATE, FACTOR, HEIGHT_ERROR, LOG_DEPTH, LOG_HEIGHT, LOG_RATE, Matrix, N, State, Vector, row,
};
use crate::track::EgoMotion;

/// The nearest face is no nearer than this, metres, nor than this share of the depth: of what stands beside the camera
/// there is none ahead.
const NEAREST_M: f64 = 0.3;
const NEAREST_SHARE: f64 = 0.25;

/// An innovation of more standard deviations counts less and less.
const TOLERANCE: f64 = 3.0;

/// Weight of the latest innovation in what is usual for a track, and the most that it counts.
const SURPRISE_WEIGHT: f64 = 0.1;
const MAX_SURPRISE: f64 = 25.0;

/// The mean of a few squared innovations is as large by chance.
const USUAL_SURPRISE: f64 = 1.5;

/// Standard deviation of the logarithm of an object's height where the image's border cuts it.
const CUT_HEIGHT_SIGMA: f64 = 0.3;

/// Weight of the latest image for what may change: heading, and height over the ground.
const LATEST_WEIGHT: f64 = 0.2;

/// Roads are as steep as this beside one another: what is not known of a vertical speed, as a share of the speed.
const SLOPE: f64 = 0.05;

/// What stands still moves over the ground by no more than about this, m/s.
const STILL_MPS: f64 = 0.3;

/// How fast somebody is over the ground who moves: standard deviations, m/s, where he heads and across that, by what
/// headings err and lanes change.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Moving {
    along_mps: f64,
    across_mps: f64,
}

impl Moving {
    /// What has wheels.
    pub(crate) const DRIVING: Self = Self { along_mps: 8.0, across_mps: 2.0 };
    /// Who walks, anywhere.
    pub(crate) const WALKING: Self = Self { along_mps: 1.5, across_mps: 1.5 };
}

/// Headings whose mean is shorter than this disagree, and say nothing.
const LEAST_HEADING: f64 = 0.5;

/// What one detection tells.
#[derive(Debug, Clone)]
pub(crate) struct Measured {
    /// `x / z` and `y / z` of its location.
    bearing: f64,
    fall: f64,
    /// Of the nearest face, metres.
    log_depth: f64,
    /// Standard deviation of the logarithm of its distance.
    log_sigma: f64,
    /// Of its box in the image, over the focal length; none where the image's border cuts it.
    log_height: Option<f64>,
    /// Width and height of its box in the image, pixels.
    box_px: [f64; 2],
    /// Horizontal focal length, pixels.
    focal_px: f64,
    /// Logarithms of height, width and length.
    pub(crate) log_size: [f64; 3],
    yaw: f64,
    half_depth_m: f64,
}

/// A box that comes so near to the image's border, pixels, is cut by it.
const BORDER_PX: f64 = 1.0;

impl Measured {
    pub(crate) fn new(detection: &Detection, camera: &Camera, image_size: [usize; 2], noise: &Noise) -> Self {
        let Detection { box2d, box3d, range_sigma_m, .. } = detection;
        let [x, y, z] = box3d.location;
        let [width, height] = image_size.map(|side| side as f64);
        let near = (z - half_depth_m(box3d)).max(NEAREST_SHARE * z).max(NEAREST_M.min(z));
        let inner = Box2d::new(BORDER_PX, BORDER_PX, width - BORDER_PX, height - BORDER_PX);
        let is_cut = box2d.x1 <= inner.x1 || box2d.y1 <= inner.y1 || box2d.x2 >= inner.x2 || box2d.y2 >= inner.y2;
        let Dimensions { height, width, length } = box3d.dimensions;
        Self {
            bearing: x / z,
            fall: y / z,
            log_depth: near.ln(),
            log_sigma: range_sigma_m.map_or(noise.unknown_sigma, |sigma| sigma / box3d.depth_m()),
            log_height: (!is_cut).then(|| (box2d.height() / camera.focal_y()).ln()),
            box_px: [box2d.width(), box2d.height()],
            focal_px: camera.focal_x(),
            log_size: [height, width, length].map(f64::ln),
            yaw: box3d.yaw,
            half_depth_m: z - near,
        }
    }

    /// Variances of the distance's logarithm: of what lasts and of what is new.
    fn depth_variances(&self, noise: &Noise) -> [f64; 2] {
        let all = self.log_sigma * self.log_sigma;
        let white = (1.0 - noise.persistent_share) * all;
        [noise.persistent_share * all, white.max(noise.least_white.powi(2))]
    }

    /// Variances of the height's logarithm: of what lasts and of what is new.
    fn height_variances(&self, noise: &Noise) -> [f64; 2] {
        let [_, height] = self.box_px;
        let variance = |share: f64, px: f64| share * share + (px / height).powi(2);
        [variance(noise.height_share, noise.height_px), variance(noise.white_height_share, noise.white_height_px)]
    }

    fn bearing_variance(&self, noise: &Noise) -> f64 {
        let [width, _] = self.box_px;
        (noise.place_px.powi(2) + (noise.place_share * width).powi(2)) / (self.focal_px * self.focal_px)
    }
}

/// Half the extent of a box along the optical axis, metres.
fn half_depth_m(object: &Box3d) -> f64 {
    let (sin, cos) = object.yaw.sin_cos();
    f64::midpoint(sin.abs() * object.dimensions.length, cos.abs() * object.dimensions.width)
}

/// Adds what a white acceleration of this power spectral density, (m/s^2)^2 s, does in `dt_s` seconds; to the bearing,
/// and to the logarithm of the depth, of what is so many metres away.
fn add_acceleration(covariance: &mut Matrix, dt_s: f64, psd: f64, lengths_m: [f64; 2]) {
    let pushed = [psd * dt_s.powi(3) / 3.0, psd * dt_s * dt_s / 2.0, psd * dt_s];
    for ([place, rate], length) in [[BEARING, BEARING_RATE], [LOG_DEPTH, LOG_RATE]].into_iter().zip(lengths_m) {
        let [place_noise, mixed, rate_noise] = pushed.map(|value| value / (length * length));
        covariance[place][place] += place_noise;
        covariance[place][rate] += mixed;
        covariance[rate][place] += mixed;
        covariance[rate][rate] += rate_noise;
    }
}

/// What is known of an object.
#[derive(Debug, Clone)]
pub(crate) struct Filter {
    modes: Modes,
    /// Of all modes together.
    state: State,
    /// Of the latest measurements: what lasts of the errors of distance and height.
    lasting: [f64; 2],
    /// `y / z` of the location.
    fall: f64,
    half_depth_m: f64,
    /// Mean of the logarithms of height, width and length, and the sum of the weights in it.
    log_size: [f64; 3],
    weight: f64,
    /// Mean direction of the heading, not of unit length.
    heading: [f64; 2],
    updates: f64,
    /// Mean of the squared innovations, in their expected variances: about 1 where all is as expected.
    surprise: f64,
}

impl Filter {
    /// After the first measurement.
    pub(crate) fn new(measured: &Measured, options: &TrackerOptions) -> Self {
        let noise = &options.noise;
        let [lasting, white] = measured.depth_variances(noise);
        let [height_lasting, height_white] = measured.height_variances(noise);
        let near = measured.log_depth.exp();
        let centre = near + measured.half_depth_m;
        let [aside, along] = options.prior_speed_mps;
        let mut mean = [0.0; N];
        let mut covariance = [[0.0; N]; N];
        mean[BEARING] = measured.bearing;
        covariance[BEARING][BEARING] = measured.bearing_variance(noise);
        covariance[BEARING_RATE][BEARING_RATE] = (aside / centre).powi(2);
        covariance[LOG_RATE][LOG_RATE] = (along / near).powi(2);
        // Nothing was known of the distance; so what is known now is what was measured less its errors.
        mean[LOG_DEPTH] = measured.log_depth;
        covariance[LOG_DEPTH][LOG_DEPTH] = lasting + white;
        covariance[FACTOR][FACTOR] = lasting;
        covariance[HEIGHT_ERROR][HEIGHT_ERROR] = height_lasting;
        let mut set = |a: usize, b: usize, value: f64| (covariance[a][b], covariance[b][a]) = (value, value);
        set(LOG_DEPTH, FACTOR, -lasting);
        if let Some(log_height) = measured.log_height {
            mean[LOG_HEIGHT] = log_height + measured.log_depth;
            set(LOG_HEIGHT, LOG_HEIGHT, lasting + white + height_lasting + height_white);
            set(LOG_HEIGHT, LOG_DEPTH, lasting + white);
            set(LOG_HEIGHT, FACTOR, -lasting);
            set(LOG_HEIGHT, HEIGHT_ERROR, -height_lasting);
        } else {
            mean[LOG_HEIGHT] = measured.log_size[0];
            set(LOG_HEIGHT, LOG_HEIGHT, CUT_HEIGHT_SIGMA.powi(2));
        }
        let (sin, cos) = measured.yaw.sin_cos();
        let state = State { mean, covariance };
        Self {
            modes: Modes::new(&state, &options.motion),
            state,
            lasting: [lasting, height_lasting],
            fall: measured.fall,
            half_depth_m: measured.half_depth_m,
            log_size: measured.log_size,
            weight: 1.0 / (lasting + white),
            heading: [cos, sin],
            updates: 1.0,
            surprise: 1.0,
        }
    }

    /// Moves on by `dt_s` seconds.
    pub(crate) fn predict(&mut self, dt_s: f64, options: &TrackerOptions) {
        let (noise, half_depth_m, lasting) = (&options.noise, self.half_depth_m, self.lasting);
        self.modes.predict(dt_s, &options.motion, |before, motion| {
            let near = before.mean[LOG_DEPTH].exp();
            let mut state = before.moved(dt_s, half_depth_m);
            add_acceleration(&mut state.covariance, dt_s, motion.acceleration_psd, [near + half_depth_m, near]);
            state.covariance[LOG_HEIGHT][LOG_HEIGHT] += noise.size_drift.powi(2) * dt_s;
            for (place, time_s, variance) in
                [(FACTOR, noise.persistent_s, lasting[0]), (HEIGHT_ERROR, noise.height_s, lasting[1])]
            {
                // What is left of an error after so long, and what is new.
                let left = (-dt_s / time_s).exp();
                state.mean[place] *= left;
                for i in 0..N {
                    state.covariance[place][i] *= left;
                    state.covariance[i][place] *= left;
                }
                state.covariance[place][place] += variance * (1.0 - left * left);
            }
            state
        });
        self.state = self.modes.state();
    }

    /// Takes in a measurement.
    pub(crate) fn update(&mut self, measured: &Measured, noise: &Noise) {
        let [lasting, white] = measured.depth_variances(noise);
        let [height_lasting, height_white] = measured.height_variances(noise);
        self.lasting = [lasting, height_lasting];
        self.updates += 1.0;
        let latest = (1.0 / self.updates).max(LATEST_WEIGHT);
        let towards = |value: &mut f64, measured: f64| *value += latest * (measured - *value);
        towards(&mut self.half_depth_m, measured.half_depth_m);
        towards(&mut self.fall, measured.fall);
        let (sin, cos) = measured.yaw.sin_cos();
        towards(&mut self.heading[0], cos);
        towards(&mut self.heading[1], sin);
        let weight = 1.0 / (lasting + white);
        self.weight += weight;
        for (mean, latest) in self.log_size.iter_mut().zip(measured.log_size) {
            *mean += weight / self.weight * (latest - *mean);
        }

        let Self { modes, surprise, .. } = self;
        let mut surprised = |squared: f64| *surprise += SURPRISE_WEIGHT * (squared.min(MAX_SURPRISE) - *surprise);
        modes.update(&row([(BEARING, 1.0)]), measured.bearing, measured.bearing_variance(noise), TOLERANCE);
        surprised(modes.update(&row([(LOG_DEPTH, 1.0), (FACTOR, 1.0)]), measured.log_depth, white, TOLERANCE));
        if let Some(log_height) = measured.log_height {
            let seen = row([(LOG_DEPTH, -1.0), (LOG_HEIGHT, 1.0), (HEIGHT_ERROR, 1.0)]);
            surprised(modes.update(&seen, log_height, height_white, TOLERANCE));
        }
        self.state = self.modes.state();
    }

    /// How far off, in standard deviations, a detection's distance and its size are.
    pub(crate) fn misfit(&self, measured: &Measured, noise: &Noise) -> [f64; 2] {
        let told = row([(LOG_DEPTH, 1.0), (FACTOR, 1.0)]);
        let [_, white] = measured.depth_variances(noise);
        let off = measured.log_depth - self.state.mean[LOG_DEPTH] - self.state.mean[FACTOR];
        let sigma = (self.state.variance(&told) + white).sqrt();
        let size_off: f64 = measured.log_size.iter().zip(self.log_size).map(|(a, b)| a - b).sum::<f64>() / 3.0;
        // The longer it is known the better; but an error of distance is one of size.
        let size_variance = noise.dimension_share.powi(2) + self.lasting[0] + white;
        [off / sigma, size_off / size_variance.sqrt()]
    }

    /// What jumps more than expected moves less surely than the filter thinks: the factor on its variances.
    fn inflation(&self) -> f64 {
        (self.surprise / USUAL_SURPRISE).max(1.0)
    }

    /// Depth of the nearest face, metres.
    pub(crate) fn near_m(&self) -> f64 {
        self.state.mean[LOG_DEPTH].exp()
    }

    /// Depth of the centre, metres.
    pub(crate) fn depth_m(&self) -> f64 {
        self.near_m() + self.half_depth_m
    }

    /// Standard deviation of the logarithm of the distance.
    pub(crate) fn log_sigma(&self) -> f64 {
        self.state.variance(&row([(LOG_DEPTH, 1.0)])).sqrt()
    }

    /// Change of the logarithm of the nearest face's depth in a second, and its standard deviation.
    pub(crate) fn log_rate(&self) -> [f64; 2] {
        [self.state.mean[LOG_RATE], (self.inflation() * self.state.variance(&row([(LOG_RATE, 1.0)]))).sqrt()]
    }

    /// The box in the scene.
    pub(crate) fn box3d(&self) -> Box3d {
        let z = self.depth_m();
        let [height, width, length] = self.log_size.map(f64::exp);
        let [cos, sin] = self.heading;
        Box3d {
            dimensions: Dimensions { height, width, length },
            location: [self.state.mean[BEARING] * z, self.fall * z, z],
            yaw: sin.atan2(cos),
        }
    }

    /// Velocity across and along the optical axis, m/s, with its covariance.
    pub(crate) fn ground_velocity(&self) -> ([f64; 2], [[f64; 2]; 2]) {
        let ([aside, along], [of_aside, of_along]) = self.velocity_rows();
        let both = std::array::from_fn(|i| of_aside[i] + of_along[i]);
        let [xx, zz, sum] = [of_aside, of_along, both].map(|row| self.inflation() * self.state.variance(&row));
        let xz = (sum - xx - zz) / 2.0;
        ([aside, along], [[xx, xz], [xz, zz]])
    }

    /// That velocity, and the rows that read it from small changes of the state.
    fn velocity_rows(&self) -> ([f64; 2], [Vector; 2]) {
        let (near, centre) = (self.near_m(), self.depth_m());
        let mean = &self.state.mean;
        let (bearing, rate, log_rate) = (mean[BEARING], mean[BEARING_RATE], mean[LOG_RATE]);
        let along = log_rate * near;
        let aside = rate * centre + bearing * along;
        // A factor on all distances is one on both.
        let of_aside = row([(BEARING, along), (BEARING_RATE, centre), (LOG_DEPTH, aside), (LOG_RATE, bearing * near)]);
        ([aside, along], [of_aside, row([(LOG_DEPTH, along), (LOG_RATE, near)])])
    }

    /// Velocity over the ground, across and along the optical axis, m/s, of a camera that moves so, and the rows that
    /// read it from small changes of the state.
    fn absolute_velocity(&self, ego: &EgoMotion) -> ([f64; 2], [Vector; 2]) {
        let (near, centre, bearing) = (self.near_m(), self.depth_m(), self.state.mean[BEARING]);
        let ([aside, along], [of_aside, of_along]) = self.velocity_rows();
        let still = ego.velocity_of_still([bearing * centre, centre]);
        // A camera that turns moves what is far away by more.
        let turned = [
            row([(LOG_DEPTH, ego.yaw_rate * near)]),
            row([(BEARING, -ego.yaw_rate * centre), (LOG_DEPTH, -ego.yaw_rate * bearing * near)]),
        ];
        let less = |a: Vector, b: Vector| std::array::from_fn(|i| a[i] - b[i]);
        ([aside - still[0], along - still[1]], [less(of_aside, turned[0]), less(of_along, turned[1])])
    }

    /// Variances of the velocity of what stands still, over the ground, (m/s)^2: the camera's own motion is not quite
    /// known, and points of an object move a little as it turns before the camera.
    fn still_variances(&self, ego: &EgoMotion) -> [f64; 2] {
        let depth_m = self.depth_m();
        let aside_m = self.state.mean[BEARING] * depth_m;
        let slack = STILL_MPS * STILL_MPS;
        [
            slack + (depth_m * ego.yaw_rate_sigma).powi(2),
            slack + ego.speed_sigma_mps.powi(2) + (aside_m * ego.yaw_rate_sigma).powi(2),
        ]
    }

    /// Where it heads over the ground, across and along the optical axis, of unit length; none where its headings
    /// disagree.
    fn direction(&self) -> Option<[f64; 2]> {
        let [cos, sin] = self.heading;
        let length = cos.hypot(sin);
        (length >= LEAST_HEADING).then(|| [cos / length, -sin / length])
    }

    /// How probable it is that it stands still, when half of all do so and the others move so.
    fn stands_still(&self, ego: &EgoMotion, moving: Moving) -> f64 {
        let (velocity, rows) = self.absolute_velocity(ego);
        let both = std::array::from_fn(|i| rows[0][i] + rows[1][i]);
        let [xx, zz, sum] = [rows[0], rows[1], both].map(|row| self.inflation() * self.state.variance(&row));
        let xz = (sum - xx - zz) / 2.0;
        let [still_x, still_z] = self.still_variances(ego);
        // Of the velocity over the ground, less what is not known of it: variances and covariance of what it may be.
        let log_density = |[x_more, z_more, xz_more]: [f64; 3]| {
            let (a, b, c) = (xx + still_x + x_more, zz + still_z + z_more, xz + xz_more);
            let determinant = a * b - c * c;
            let [x, z] = velocity;
            let squared = (b * x * x - 2.0 * c * x * z + a * z * z) / determinant;
            -0.5 * (squared + determinant.ln())
        };
        let [along, across] = [moving.along_mps, moving.across_mps].map(|mps| mps * mps);
        // What does not go across its heading need not stand for that.
        let moves = self.direction().map_or([along, along, 0.0], |[x, z]| {
            [along * x * x + across * z * z, along * z * z + across * x * x, (along - across) * x * z]
        });
        1.0 / (1.0 + (log_density(moves) - log_density([0.0; 3])).exp())
    }

    /// Counts that it may stand still, by how probable that is, until the next measurement: what is then known of its
    /// motion does not depend on what it was taken for before.
    pub(crate) fn may_stand_still(&mut self, ego: &EgoMotion, moving: Moving) {
        let probability = self.stands_still(ego, moving);
        let variances = self.still_variances(ego);
        let moves = self.state.clone();
        for axis in 0..2 {
            // The second with the state after the first.
            let (velocity, rows) = self.absolute_velocity(ego);
            let now: f64 = self.state.mean.iter().zip(rows[axis]).map(|(value, factor)| value * factor).sum();
            self.state.update(&rows[axis], now - velocity[axis], variances[axis], TOLERANCE);
        }
        self.state = mixed([&self.state, &moves], [probability, 1.0 - probability]);
    }

    /// Where its centre is aside of the camera after `ahead_s` seconds at this velocity, and the standard deviation of
    /// that, metres.
    pub(crate) fn aside_after(&self, ahead_s: f64) -> [f64; 2] {
        let (near, centre, bearing) = (self.near_m(), self.depth_m(), self.state.mean[BEARING]);
        let ([aside, _], [of_aside, _]) = self.velocity_rows();
        let now = row([(BEARING, centre), (LOG_DEPTH, bearing * near)]);
        let then = std::array::from_fn(|i| now[i] + ahead_s * of_aside[i]);
        [bearing * centre + ahead_s * aside, (self.inflation() * self.state.variance(&then)).sqrt()]
    }

    /// Standard deviation of the vertical speed, m/s: the road may rise or fall.
    pub(crate) fn vertical_sigma_mps(&self) -> f64 {
        let ([x, z], [[xx, _], [_, zz]]) = self.ground_velocity();
        SLOPE * (x * x + z * z + xx + zz).sqrt()
    }
}

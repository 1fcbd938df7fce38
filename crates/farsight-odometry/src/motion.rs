//! Where a motion of the camera sends what it saw.

use farsight_core::Camera;
use farsight_core::linear::{cross, norm, solved};

/// How many numbers a motion has.
pub(crate) const COUNT: usize = 8;

/// A motion from one frame to the next: pitch downwards, yaw to the left and roll to the right side, radians; metres
/// ahead, to the right of an arc, and down; slope and tilt of the road in the first frame ([`RoadPlane`]'s).
///
/// [`RoadPlane`]: farsight_core::road::RoadPlane
pub(crate) type Motion = [f64; COUNT];

pub(crate) const PITCH: usize = 0;
pub(crate) const YAW: usize = 1;
pub(crate) const ROLL: usize = 2;
pub(crate) const AHEAD: usize = 3;
pub(crate) const ASIDE: usize = 4;
pub(crate) const DOWN: usize = 5;
pub(crate) const SLOPE: usize = 6;
pub(crate) const TILT: usize = 7;

type Matrix = [[f64; 3]; 3];

/// The camera of the small picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Pinhole {
    /// Homogeneous pixels from directions, and back.
    pixel_from_direction: Matrix,
    direction_from_pixel: Matrix,
}

impl Pinhole {
    /// Of a picture that was made smaller by `factor`; none where the camera has no inverse.
    pub(crate) fn new(camera: &Camera, factor: usize) -> Option<Self> {
        let factor = factor as f64;
        let shift = 0.5 / factor - 0.5;
        let [first, second, third] = camera.projection;
        let row = |row: [f64; 4]| [0, 1, 2].map(|j| row[j] / factor + shift * third[j]);
        let matrix = [row(first), row(second), [0, 1, 2].map(|j| third[j])];
        let column = |j: usize| solved(matrix, [0, 1, 2].map(|i| if i == j { 1.0 } else { 0.0 }));
        let columns = [column(0)?, column(1)?, column(2)?];
        let inverse = [0, 1, 2].map(|i| [0, 1, 2].map(|j| columns[j][i]));
        Some(Self { pixel_from_direction: matrix, direction_from_pixel: inverse })
    }

    /// The direction of a pixel, with z = 1; none where it does not look ahead.
    pub(crate) fn ray(&self, [u, v]: [f64; 2]) -> Option<[f64; 3]> {
        let [x, y, z] = self.direction_from_pixel.map(|row| row[0] * u + row[1] * v + row[2]);
        (z > 1e-3).then(|| [x / z, y / z, 1.0])
    }
}

/// A motion made ready: it sends a point at the ray `p` with the inverse depth `rho` to the pixel of
/// `turn p - rho shift`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Warp {
    turn: Matrix,
    shift: [f64; 3],
    /// The road in the first frame: its inverse depth at the ray `p` is the product of both.
    road: [f64; 3],
}

impl Warp {
    /// Of a camera `height_m` above the road, straight down onto it.
    pub(crate) fn new(motion: &Motion, pinhole: &Pinhole, height_m: f64) -> Self {
        let [pitch, yaw, roll, ahead, aside, down, slope, tilt] = *motion;
        let normal = [tilt, 1.0, slope];
        let length = norm(&normal);
        let normal = normal.map(|v| v / length);
        // The axis as far as it lies in the road.
        let axis = [0, 1, 2].map(|k| if k == 2 { 1.0 } else { 0.0 } - normal[2] * normal[k]);
        let axis_length = norm(&axis);
        let axis = axis.map(|v| v / axis_length);
        let right = cross(&normal, &axis);
        // The chord of an arc to the left.
        let aside = aside - 0.5 * ahead * yaw;
        let moved = [0, 1, 2].map(|k| ahead * axis[k] + aside * right[k] + down * normal[k]);
        let turn = product(&pinhole.pixel_from_direction, &turned(pitch, yaw, roll));
        let shift = turn.map(|row| row[0] * moved[0] + row[1] * moved[1] + row[2] * moved[2]);
        Self { turn, shift, road: normal.map(|v| v / height_m) }
    }

    /// Inverse depth of the road at a ray, 1/m; not above 0 from the horizon on.
    #[inline]
    pub(crate) fn road(&self, ray: &[f64; 3]) -> f64 {
        self.road[0] * ray[0] + self.road[1] * ray[1] + self.road[2] * ray[2]
    }

    /// The pixel, and its derivative by the inverse depth; none behind the camera.
    #[inline]
    pub(crate) fn pixel(&self, ray: &[f64; 3], rho: f64) -> Option<([f64; 2], [f64; 2])> {
        let row = |r: &[f64; 3], shift: f64| r[0] * ray[0] + r[1] * ray[1] + r[2] * ray[2] - rho * shift;
        let [a, b, c] = self.shift;
        let [x, y, z] = [row(&self.turn[0], a), row(&self.turn[1], b), row(&self.turn[2], c)];
        let pixel = [x / z, y / z];
        (z > 0.05).then(|| (pixel, [(c * pixel[0] - a) / z, (c * pixel[1] - b) / z]))
    }
}

/// Rotation from the first frame into the second: yaw, then pitch, then roll.
fn turned(pitch: f64, yaw: f64, roll: f64) -> Matrix {
    let ((sp, cp), (sy, cy), (sr, cr)) = (pitch.sin_cos(), yaw.sin_cos(), roll.sin_cos());
    let yawed = [[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]];
    let pitched = [[1.0, 0.0, 0.0], [0.0, cp, -sp], [0.0, sp, cp]];
    let rolled = [[cr, -sr, 0.0], [sr, cr, 0.0], [0.0, 0.0, 1.0]];
    product(&rolled, &product(&pitched, &yawed))
}

fn product(a: &Matrix, b: &Matrix) -> Matrix {
    a.map(|row| [0, 1, 2].map(|j| row[0] * b[0][j] + row[1] * b[1][j] + row[2] * b[2][j]))
}

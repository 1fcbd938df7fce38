//! The pinhole camera with its full 3x4 projection.

use thiserror::Error;

use crate::linear::{dot, norm, solved};
use crate::scalar::Scalar;
use crate::{Affine2, Pose};

/// A camera: the 3x4 matrix from camera coordinates (metres) to homogeneous pixels.
///
/// KITTI's left colour camera stands 6 cm beside the origin of its coordinates, so the fourth column is not zero. It is
/// kept everywhere: dropping it, as official SMOKE does, moves a centre at 5 m by 9 pixels (spec 5.6).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Row-major projection; row 2 gives the divisor, in metres of depth.
    pub projection: [[f64; 4]; 3],
}

/// The least share of a row of the projection that lies along its own axis; in a photograph it is a tenth and more.
const MIN_ACROSS: f64 = 1e-6;

/// A description of a camera that no camera can have.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum CameraError {
    /// A focal length that is not a positive number.
    #[error("focal length {name} is {value}; expected a positive number of pixels")]
    Focal {
        /// `fx` or `fy`.
        name: &'static str,
        /// What was given.
        value: f64,
    },
    /// A principal point that is not finite.
    #[error("principal point {name} is {value}; expected a finite number of pixels")]
    PrincipalPoint {
        /// `cx` or `cy`.
        name: &'static str,
        /// What was given.
        value: f64,
    },
    /// A field of view that a pinhole cannot have.
    #[error("horizontal field of view is {0} degrees; expected more than 0 and less than 180")]
    FieldOfView(f64),
    /// An image with sides that no image has.
    #[error("the image's width or height is no 32-bit number of pixels")]
    Sides,
    /// A projection that sends no point anywhere.
    #[error("the projection is not a camera: {0}")]
    Degenerate(&'static str),
}

impl Camera {
    /// A camera from a 3x4 projection, row by row.
    ///
    /// # Errors
    /// When a value is not finite or a focal length is not positive.
    pub fn from_projection(projection: [[f64; 4]; 3]) -> Result<Self, CameraError> {
        if projection.iter().flatten().any(|v| !v.is_finite()) {
            return Err(CameraError::Degenerate("a value is not finite"));
        }
        let camera = Self { projection };
        if projection[2][2] <= 0.0 {
            return Err(CameraError::Degenerate("points ahead have no positive depth (third row, third value)"));
        }
        check_focal("fx", camera.focal_x())?;
        check_focal("fy", camera.focal_y())?;
        // Else rounding decides whether the camera is mirrored.
        if (0..2).any(|axis| camera.across(axis)[axis] < MIN_ACROSS * norm(&camera.row(axis))) {
            return Err(CameraError::Degenerate("an axis of the image points along the view"));
        }
        Ok(camera)
    }

    /// An ideal camera from focal lengths and principal point, pixels.
    ///
    /// # Errors
    /// When a focal length is not positive or the principal point is not finite.
    pub fn from_intrinsics(fx: f64, fy: f64, cx: f64, cy: f64) -> Result<Self, CameraError> {
        check_focal("fx", fx)?;
        check_focal("fy", fy)?;
        for (name, value) in [("cx", cx), ("cy", cy)] {
            if !value.is_finite() {
                return Err(CameraError::PrincipalPoint { name, value });
            }
        }
        Ok(Self { projection: [[fx, 0.0, cx, 0.0], [0.0, fy, cy, 0.0], [0.0, 0.0, 1.0, 0.0]] })
    }

    /// An ideal camera that sees `hfov_deg` degrees across an image of `width` x `height` pixels (any integers),
    /// principal point in the middle.
    ///
    /// # Errors
    /// When the angle is not between 0 and 180 degrees, or a side is no 32-bit number.
    pub fn from_hfov(hfov_deg: f64, width: impl TryInto<u32>, height: impl TryInto<u32>) -> Result<Self, CameraError> {
        if !(hfov_deg > 0.0 && hfov_deg < 180.0) {
            return Err(CameraError::FieldOfView(hfov_deg));
        }
        let (Ok(width), Ok(height)) = (width.try_into(), height.try_into()) else { return Err(CameraError::Sides) };
        let (width, height) = (f64::from(width), f64::from(height));
        let focal = width / 2.0 / (hfov_deg.to_radians() / 2.0).tan();
        Self::from_intrinsics(focal, focal, (width - 1.0) / 2.0, (height - 1.0) / 2.0)
    }

    /// Where the camera stands in its coordinates, metres: the point that it sends nowhere, if there is one.
    pub fn origin(&self) -> Option<[f64; 3]> {
        let matrix = self.projection.map(|row| [row[0], row[1], row[2]]);
        solved(matrix, self.projection.map(|row| -row[3]))
    }

    /// Horizontal focal length, pixels; of a turned camera too, whose projection is `K [R | t]`.
    pub fn focal_x(&self) -> f64 {
        self.focal(0)
    }

    /// Vertical focal length, pixels; of a turned camera too, whose projection is `K [R | t]`.
    pub fn focal_y(&self) -> f64 {
        self.focal(1)
    }

    /// It has the sign of the axis it mostly lies along, so that a mirrored camera shows as a negative one.
    fn focal(&self, axis: usize) -> f64 {
        let across = self.across(axis);
        let last = self.row(2);
        (dot(&across, &across) / dot(&last, &last)).sqrt() * across[axis].signum()
    }

    /// Row `axis` of `K R` is `focal * R[axis] + center * R[2]`, and `R[2]` is the last row: what is left without that
    /// lies along `R[axis]`.
    fn across(&self, axis: usize) -> [f64; 3] {
        let (own, last) = (self.row(axis), self.row(2));
        let center = self.center(axis);
        [0, 1, 2].map(|j| own[j] - center * last[j])
    }

    /// The principal point (column and row), pixels; of a turned camera too.
    pub fn principal_point(&self) -> [f64; 2] {
        [0, 1].map(|axis| self.center(axis))
    }

    fn center(&self, axis: usize) -> f64 {
        let last = self.row(2);
        dot(&self.row(axis), &last) / dot(&last, &last)
    }

    /// Which way the second axis of the coordinates points, as the camera sees it: right, down and ahead by its own
    /// axes; of length 1. It is straight down in level coordinates, as those of turned cameras are.
    pub fn down(&self) -> [f64; 3] {
        [self.across(0), self.across(1), self.row(2)].map(|axis| axis[1] / norm(&axis))
    }

    /// How far a camera looks down and how far it is rolled (to the left is positive), radians, in level coordinates.
    pub fn attitude(&self) -> [f64; 2] {
        let [right, down, ahead] = self.down();
        [ahead.atan2(right.hypot(down)), (-right).atan2(down)]
    }

    /// A row without its last number.
    fn row(&self, i: usize) -> [f64; 3] {
        [0, 1, 2].map(|j| self.projection[i][j])
    }

    /// The pixel that sees `point` (metres); `None` for a point not in front of the camera.
    pub fn pixel_from_point(&self, point: [f64; 3]) -> Option<[f64; 2]> {
        let [u, v, w] = self.projection.map(|r| r[0] * point[0] + r[1] * point[1] + r[2] * point[2] + r[3]);
        (w > 0.0).then(|| [u / w, v / w])
    }

    /// The point at depth `z` (metres) that `pixel` sees. The inverse of [`Camera::pixel_from_point`].
    ///
    /// Generic over the scalar: the loss takes its gradient through this very function.
    pub fn point_from_pixel<D: Scalar>(&self, pixel: [D; 2], z: D) -> [D; 3] {
        let [first, second, third] = self.projection;
        // u * (third . X) = first . X and v * (third . X) = second . X: two equations linear in x and y.
        let equation = |coordinate: D, row: [f64; 4]| {
            let by = |j: usize| coordinate * third[j] - row[j];
            (by(0), by(1), -(by(2) * z + by(3)))
        };
        let (a, b, c) = equation(pixel[0], first);
        let (d, e, f) = equation(pixel[1], second);
        let determinant = a * e - b * d;
        [(c * e - b * f) / determinant, (a * f - c * d) / determinant, z]
    }

    /// Whether a pixel's column alone says how far it looks to the side, and its row how far it looks down: the axes of
    /// the image are those of the camera.
    pub fn is_upright(&self) -> bool {
        let [first, second, third] = self.projection;
        [first[1], second[0], third[0], third[1]].iter().all(|across| *across == 0.0)
    }

    /// The direction in camera coordinates, of any length, whose points far away have these homogeneous pixels.
    pub fn direction(&self, homogeneous: [f64; 3]) -> Option<[f64; 3]> {
        solved([0, 1, 2].map(|i| self.row(i)), homogeneous)
    }

    /// The camera of the image after `map` (crop, scale, pad).
    pub fn transformed(&self, map: &Affine2) -> Self {
        let [first, second, third] = self.projection;
        let row = |m: [f64; 3]| [0, 1, 2, 3].map(|j| m[0] * first[j] + m[1] * second[j] + m[2] * third[j]);
        Self { projection: [row(map.matrix[0]), row(map.matrix[1]), third] }
    }

    /// The same camera in other coordinates, into which `other_from_camera` takes points.
    #[must_use]
    pub fn moved(&self, other_from_camera: &Pose) -> Self {
        let Pose { rotation, translation_m } = other_from_camera.inverse();
        let projection = self.projection.map(|row| {
            let by = |axis: usize| (0..3).map(|k| row[k] * rotation[k][axis]).sum::<f64>();
            let last = (0..3).map(|k| row[k] * translation_m[k]).sum::<f64>() + row[3];
            [by(0), by(1), by(2), last]
        });
        Self { projection }
    }

    /// The camera that sees the left-right mirrored image of a mirrored world.
    ///
    /// Column `u` becomes `width - 1 - u` and the scene's `x` becomes `-x`; every projection stays exact, the fourth
    /// column included.
    pub fn mirrored(&self, width: usize) -> Self {
        let mut mirrored = self.transformed(&Affine2::mirror(width));
        for row in &mut mirrored.projection {
            row[0] = -row[0];
        }
        mirrored
    }

    /// The same camera with the fourth column dropped: official SMOKE's 3x3 `K` (spec 5.6), for its checkpoints only.
    pub fn without_fourth_column(&self) -> Self {
        let mut projection = self.projection;
        for row in &mut projection {
            row[3] = 0.0;
        }
        Self { projection }
    }
}

fn check_focal(name: &'static str, value: f64) -> Result<(), CameraError> {
    if value.is_finite() && value > 0.0 { Ok(()) } else { Err(CameraError::Focal { name, value }) }
}

//! The camera from a rectangle on a flat road whose sides were measured.
//!
//! A plane seen by a camera with square pixels and its principal point in the middle of the image tells the focal
//! length and where the camera stands: the columns of its homography are images of two directions that are
//! perpendicular and of known lengths (Zhang, *A flexible new technique for camera calibration*, 2000, with one view
//! and one unknown).

use thiserror::Error;

use crate::Camera;
use crate::linear::{cross, dot, norm, solved};

/// A rectangle on the road.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RoadRectangle {
    /// Its corners in the image (column and row, pixels), one after the other around it.
    pub corners_px: [[f64; 2]; 4],
    /// Distance from the first corner to the second, and from the second to the third, metres.
    pub sides_m: [f64; 2],
}

/// What a rectangle tells of its camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RoadCamera {
    /// The camera. Its coordinates are turned so that y points straight down to the road and z ahead over it, so its
    /// projection is `K [R | 0]`.
    pub camera: Camera,
    /// Horizontal field of view, degrees.
    pub hfov_deg: f64,
    /// Above the road, metres.
    pub height_m: f64,
    /// How far the camera looks down, degrees.
    pub pitch_deg: f64,
    /// How far the camera is turned about its view, degrees; positive when its right side hangs down.
    pub roll_deg: f64,
    /// How far its corners lie from where this camera sees a true rectangle, pixels (root of the mean square).
    pub residual_px: f64,
}

/// A rectangle that tells of no camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum RoadRectangleError {
    /// Sides that no rectangle has.
    #[error("the sides of the rectangle are no lengths; expected two positive numbers of metres")]
    Sides,
    /// Pixels that are none.
    #[error("a corner is no pixel; expected finite numbers")]
    Pixel,
    /// Corners that are not those of a rectangle.
    #[error("the corners are no rectangle on a road; expected them one after the other around it")]
    Corners,
    /// The focal length cannot be told.
    #[error(
        "this rectangle does not tell the focal length; expected a larger one, with the sides as they were measured"
    )]
    Focal,
    /// The camera looks straight down.
    #[error("the camera looks straight down; expected one that looks ahead")]
    Down,
}

impl RoadRectangle {
    /// The camera that took the image of `image_size` (width and height, pixels) with this rectangle in it.
    ///
    /// # Errors
    /// When no camera, or more than one, sees it so.
    pub fn camera(&self, image_size: [u32; 2]) -> Result<RoadCamera, RoadRectangleError> {
        if !self.sides_m.iter().all(|side| side.is_finite() && *side > 0.0) {
            return Err(RoadRectangleError::Sides);
        }
        if !self.corners_px.iter().flatten().all(|value| value.is_finite()) {
            return Err(RoadRectangleError::Pixel);
        }
        let [width, height] = image_size.map(f64::from);
        let middle = [(width - 1.0) / 2.0, (height - 1.0) / 2.0];
        let columns = self.homography(middle).ok_or(RoadRectangleError::Corners)?;
        let focal = focal(&columns, width).ok_or(RoadRectangleError::Focal)?;
        let [across, along, start] = columns.map(|[x, y, z]| [x / focal, y / focal, z]);
        let scale = 1.0 / (norm(&across) * norm(&along)).sqrt();
        let [across, along, start] = [across, along, start].map(|column| column.map(|value| value * scale));
        let [across, along] = square(&across, &along);
        let up_or_down = cross(&across, &along);
        // The road lies below: its first corner is on the side to which down points.
        let height_m = dot(&up_or_down, &start).abs();
        let down = up_or_down.map(|value| value * dot(&up_or_down, &start).signum());
        let ahead = unit([-down[0] * down[2], -down[1] * down[2], 1.0 - down[2] * down[2]]);
        let ahead = ahead.ok_or(RoadRectangleError::Down)?;
        let right = cross(&down, &ahead);
        // Camera coordinates from those over the road; the camera looks along its own z.
        let turned = |axis: usize| [right[axis], down[axis], ahead[axis]];
        let last = turned(2);
        let row = |axis: usize| {
            let (own, center) = (turned(axis), middle[axis]);
            [0, 1, 2, 3].map(|j| own.get(j).map_or(0.0, |own| focal * own + center * last[j]))
        };
        let projection = [row(0), row(1), [last[0], last[1], last[2], 0.0]];
        let camera = Camera::from_projection(projection).map_err(|_| RoadRectangleError::Down)?;
        let seen = self.seen(&across, &along, &start, focal, middle).ok_or(RoadRectangleError::Corners)?;
        let squares = seen.iter().zip(&self.corners_px).map(|(a, b)| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2));
        Ok(RoadCamera {
            camera,
            hfov_deg: 2.0 * (width / 2.0 / focal).atan().to_degrees(),
            height_m,
            pitch_deg: down[2].clamp(-1.0, 1.0).asin().to_degrees(),
            roll_deg: down[0].atan2(down[1]).to_degrees(),
            residual_px: (squares.sum::<f64>() / 4.0).sqrt(),
        })
    }

    /// Columns of the homography from metres along the sides to pixels about `middle`; none when the corners are no
    /// image of a rectangle.
    fn homography(&self, middle: [f64; 2]) -> Option<[[f64; 3]; 3]> {
        let [p0, p1, p2, p3] = self.corners_px.map(|[u, v]| [u - middle[0], v - middle[1]]);
        // All four turn the same way, and none lies on a side.
        let turn =
            |a: [f64; 2], b: [f64; 2], c: [f64; 2]| (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0]);
        let turns = [turn(p0, p1, p2), turn(p1, p2, p3), turn(p2, p3, p0), turn(p3, p0, p1)];
        if !(turns.iter().all(|turn| *turn > 1.0) || turns.iter().all(|turn| *turn < -1.0)) {
            return None;
        }
        // From the unit square to four points (Heckbert, Fundamentals of texture mapping, 1989).
        let sum = [0, 1].map(|axis| p0[axis] - p1[axis] + p2[axis] - p3[axis]);
        let matrix = [[p1[0] - p2[0], p3[0] - p2[0]], [p1[1] - p2[1], p3[1] - p2[1]]];
        let [g, h] = solved(matrix, sum)?;
        let column = |corner: [f64; 2], divisor: f64, side_m: f64| {
            let [x, y] = [0, 1].map(|axis| corner[axis] - p0[axis] + divisor * corner[axis]);
            [x / side_m, y / side_m, divisor / side_m]
        };
        Some([column(p1, g, self.sides_m[0]), column(p3, h, self.sides_m[1]), [p0[0], p0[1], 1.0]])
    }

    /// Where a camera of this place and focal length sees the corners.
    fn seen(
        &self,
        across: &[f64; 3],
        along: &[f64; 3],
        start: &[f64; 3],
        focal: f64,
        middle: [f64; 2],
    ) -> Option<[[f64; 2]; 4]> {
        let [width, length] = self.sides_m;
        let mut seen = [[0.0; 2]; 4];
        for (pixel, [a, b]) in seen.iter_mut().zip([[0.0, 0.0], [width, 0.0], [width, length], [0.0, length]]) {
            let [x, y, z] = [0, 1, 2].map(|axis| start[axis] + a * across[axis] + b * along[axis]);
            if z <= 0.0 {
                return None;
            }
            *pixel = [middle[0] + focal * x / z, middle[1] + focal * y / z];
        }
        Some(seen)
    }
}

/// Focal lengths, in widths of the image, that cameras have: 160 to 2 degrees.
const FOCALS: [f64; 2] = [0.088, 29.0];

/// The focal length with which the first two columns are perpendicular and equally long, by least squares of the
/// inverse square.
fn focal([a, b, _]: &[[f64; 3]; 3], width: f64) -> Option<f64> {
    let perpendicular = [2.0 * (a[0] * b[0] + a[1] * b[1]), 2.0 * a[2] * b[2]];
    let equal = [a[0] * a[0] + a[1] * a[1] - b[0] * b[0] - b[1] * b[1], a[2] * a[2] - b[2] * b[2]];
    let square = perpendicular[0] * perpendicular[0] + equal[0] * equal[0];
    let inverse = -(perpendicular[0] * perpendicular[1] + equal[0] * equal[1]) / square;
    let focal = (inverse > 0.0).then(|| 1.0 / inverse.sqrt())?;
    (FOCALS[0] * width..=FOCALS[1] * width).contains(&focal).then_some(focal)
}

/// The perpendicular unit vectors nearest to both.
fn square(a: &[f64; 3], b: &[f64; 3]) -> [[f64; 3]; 2] {
    let [a, b] = [a, b].map(|v| v.map(|value| value / norm(v)));
    let plus = [0, 1, 2].map(|axis| a[axis] + b[axis]);
    let minus = [0, 1, 2].map(|axis| a[axis] - b[axis]);
    let [plus, minus] = [plus, minus].map(|v| v.map(|value| value / norm(&v) * std::f64::consts::FRAC_1_SQRT_2));
    [[0, 1, 2].map(|axis| plus[axis] + minus[axis]), [0, 1, 2].map(|axis| plus[axis] - minus[axis])]
}

/// The unit vector that points so; none of one that is too short to point anywhere.
fn unit(v: [f64; 3]) -> Option<[f64; 3]> {
    let length = norm(&v);
    (length > 1e-3).then(|| v.map(|value| value / length))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::{RoadRectangle, RoadRectangleError};
    use crate::Camera;

    const SIZE: [u32; 2] = [1280, 720];

    /// A camera over the road that looks down and hangs, and where it sees a rectangle on the road.
    fn scene(hfov_deg: f64, pitch: f64, roll: f64, height_m: f64, place: [f64; 3], sides_m: [f64; 2]) -> RoadRectangle {
        let focal = f64::from(SIZE[0]) / 2.0 / (hfov_deg.to_radians() / 2.0).tan();
        let [x, z, yaw] = place;
        let (along, across) = ([yaw.sin(), yaw.cos()], [yaw.cos(), -yaw.sin()]);
        let corner = |a: f64, b: f64| {
            let (x, y, z) = (x + a * across[0] + b * along[0], height_m, z + a * across[1] + b * along[1]);
            // Looks down by the pitch, then is turned by the roll about its view.
            let (y, z) = (y * pitch.cos() - z * pitch.sin(), y * pitch.sin() + z * pitch.cos());
            let (x, y) = (x * roll.cos() + y * roll.sin(), y * roll.cos() - x * roll.sin());
            [f64::from(SIZE[0] - 1) / 2.0 + focal * x / z, f64::from(SIZE[1] - 1) / 2.0 + focal * y / z]
        };
        let [w, l] = sides_m;
        RoadRectangle { corners_px: [corner(0.0, 0.0), corner(w, 0.0), corner(w, l), corner(0.0, l)], sides_m }
    }

    proptest! {
        #[test]
        fn the_camera_that_saw_the_rectangle_is_found_whichever_way_round_it_is_told(
            hfov_deg in 30.0..110.0_f64, pitch in 0.05..0.6_f64, roll in -0.15..0.15_f64, height_m in 1.2..9.0_f64,
            x in -4.0..1.0_f64, z in 9.0..16.0_f64, yaw in -0.6..0.6_f64, w in 2.0..5.0_f64, l in 4.0..12.0_f64,
            first in 0..4_usize, mirrored: bool,
        ) {
            let mut seen = scene(hfov_deg, pitch, roll, height_m, [x, z, yaw], [w, l]);
            seen.corners_px.rotate_left(first);
            if first % 2 == 1 {
                seen.sides_m.reverse();
            }
            if mirrored {
                // The first side is then the one that was opposite.
                seen.corners_px.reverse();
            }
            let found = seen.camera(SIZE).unwrap();
            prop_assert!((found.hfov_deg - hfov_deg).abs() < 1e-4, "{found:?}");
            prop_assert!((found.height_m - height_m).abs() < 1e-4, "{found:?}");
            prop_assert!((found.pitch_deg - pitch.to_degrees()).abs() < 1e-4, "{found:?}");
            prop_assert!((found.roll_deg - roll.to_degrees()).abs() < 1e-4, "{found:?}");
            prop_assert!(found.residual_px < 1e-4, "{found:?}");
            // The road plane of this camera holds the rectangle: sides and right angles come out as they were measured.
            let on_road = seen.corners_px.map(|pixel| on_road(&found.camera, found.height_m, pixel));
            for (place, side_m) in [(0, seen.sides_m[0]), (1, seen.sides_m[1]), (2, seen.sides_m[0]), (3, seen.sides_m[1])] {
                let [a, b] = [on_road[place], on_road[(place + 1) % 4]];
                let found_m = (a[0] - b[0]).hypot(a[1] - b[1]);
                prop_assert!((found_m - side_m).abs() < 1e-4, "side {place}: {found_m} instead of {side_m}");
            }
        }
    }

    /// Right and ahead, metres, of the point of the road that a pixel sees.
    fn on_road(camera: &Camera, height_m: f64, pixel: [f64; 2]) -> [f64; 2] {
        // The row of the pixel falls with depth, so its height over the road does, too.
        let (mut near, mut far) = (1e-3, 1e4);
        for _ in 0..200 {
            let z = 0.5 * (near + far);
            if camera.point_from_pixel(pixel, z)[1] < height_m { near = z } else { far = z }
        }
        let [x, _, z] = camera.point_from_pixel(pixel, near);
        [x, z]
    }

    #[test]
    fn clicks_beside_the_corners_show_in_the_residual() {
        let mut seen = scene(65.0, 0.3, 0.0, 5.0, [-2.0, 11.0, 0.3], [3.5, 8.0]);
        seen.corners_px[2][0] += 12.0;
        assert!(seen.camera(SIZE).unwrap().residual_px > 1.0);
    }

    #[test]
    fn what_is_no_rectangle_is_told() {
        let seen = scene(65.0, 0.3, 0.0, 5.0, [-2.0, 11.0, 0.3], [3.5, 8.0]);
        let with = |change: fn(&mut RoadRectangle)| {
            let mut seen = seen;
            change(&mut seen);
            seen.camera(SIZE).unwrap_err()
        };
        assert_eq!(with(|seen| seen.sides_m[0] = 0.0), RoadRectangleError::Sides);
        assert_eq!(with(|seen| seen.sides_m[1] = f64::NAN), RoadRectangleError::Sides);
        assert_eq!(with(|seen| seen.corners_px[1][1] = f64::INFINITY), RoadRectangleError::Pixel);
        assert_eq!(with(|seen| seen.corners_px.swap(1, 2)), RoadRectangleError::Corners);
        assert_eq!(with(|seen| seen.corners_px[3] = seen.corners_px[0]), RoadRectangleError::Corners);
        // A square in the image is a square seen straight from above, from any height.
        assert_eq!(
            with(|seen| *seen = RoadRectangle {
                corners_px: [[10.0, 60.0], [60.0, 60.0], [60.0, 10.0], [10.0, 10.0]],
                sides_m: [2.0, 2.0]
            }),
            RoadRectangleError::Focal
        );
    }
}

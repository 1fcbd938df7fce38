//! The camera as the renderer uses it: points to pixels and pixels to rays.

use farsight_core::Camera;

use super::lanes::{Lanes, Vec3s, all};
use crate::scene::Vec3;

/// Nothing nearer than this is seen, metres along the optical axis.
pub(crate) const NEAR_M: f64 = 0.2;

/// A camera and its inverse.
#[derive(Debug, Clone, Copy)]
pub(crate) struct View {
    projection: [[f64; 4]; 3],
    /// Inverse of the left 3x3 of the projection: directions from pixels.
    direction_from_pixel: [[f64; 3]; 3],
    /// Where the camera is.
    pub(crate) eye: Vec3,
}

impl View {
    /// The view of `camera`.
    pub(crate) fn new(camera: &Camera) -> Self {
        let projection = camera.projection;
        let inverse = inverted(projection.map(|[a, b, c, _]| [a, b, c]));
        let fourth = projection.map(|row| row[3]);
        let eye = inverse.map(|row| -(row[0] * fourth[0] + row[1] * fourth[1] + row[2] * fourth[2]) as f32);
        Self { projection, direction_from_pixel: inverse, eye }
    }

    /// Homogeneous pixel of a point: `[u * w, v * w, w]`, w in metres.
    #[inline]
    pub(crate) fn homogeneous(&self, point: Vec3) -> [f64; 3] {
        let (x, y, z) = (f64::from(point[0]), f64::from(point[1]), f64::from(point[2]));
        let row = |r: &[f64; 4]| r[0] * x + r[1] * y + r[2] * z + r[3];
        let [first, second, third] = &self.projection;
        [row(first), row(second), row(third)]
    }

    /// Direction of the ray through a pixel; its w is 1, so it is not of unit length.
    #[inline]
    pub(crate) fn direction(&self, u: f32, v: f32) -> Vec3 {
        let (u, v) = (f64::from(u), f64::from(v));
        let row = |r: &[f64; 3]| (r[0] * u + r[1] * v + r[2]) as f32;
        let [first, second, third] = &self.direction_from_pixel;
        [row(first), row(second), row(third)]
    }
}

impl View {
    /// Directions of the rays through four pixels of a row.
    #[inline]
    pub(crate) fn directions(&self, columns: Lanes, row: f32) -> Vec3s {
        let axis = |r: &[f64; 3]| columns * all(r[0] as f32) + all((r[1] * f64::from(row) + r[2]) as f32);
        let [first, second, third] = &self.direction_from_pixel;
        [axis(first), axis(second), axis(third)]
    }
}

/// The inverse of a 3x3 matrix; values that are not finite when it has none.
#[inline]
pub(crate) fn inverted([a, b, c]: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let cross =
        |p: [f64; 3], q: [f64; 3]| [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
    // The columns of the inverse are the rows' vector products over the determinant.
    let (x, y, z) = (cross(b, c), cross(c, a), cross(a, b));
    let scale = 1.0 / (a[0] * x[0] + a[1] * x[1] + a[2] * x[2]);
    [
        [x[0] * scale, y[0] * scale, z[0] * scale],
        [x[1] * scale, y[1] * scale, z[1] * scale],
        [x[2] * scale, y[2] * scale, z[2] * scale],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_pass_through_the_points_that_the_pixels_show() {
        let projection = [[721.0, 3.0, 609.0, 44.9], [-2.0, 720.0, 172.0, 0.2], [0.01, -0.02, 0.999, 0.003]];
        let camera = Camera::from_projection(projection).expect("a camera");
        let view = View::new(&camera);
        let point = [2.0, 1.0, 17.0];
        let [uw, vw, w] = view.homogeneous(point);
        let direction = view.direction((uw / w) as f32, (vw / w) as f32);
        for axis in 0..3 {
            let along = view.eye[axis] + direction[axis] * w as f32;
            assert!((along - point[axis]).abs() < 1e-4, "{along} is not {}", point[axis]);
        }
    }
}

//! The camera as the renderer uses it: points to pixels and pixels to rays.

use farsight_core::Camera;

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
        let [x, y, z] = point.map(f64::from);
        self.projection.map(|row| row[0] * x + row[1] * y + row[2] * z + row[3])
    }

    /// Direction of the ray through a pixel; its w is 1, so it is not of unit length.
    #[inline]
    pub(crate) fn direction(&self, u: f32, v: f32) -> Vec3 {
        let (u, v) = (f64::from(u), f64::from(v));
        self.direction_from_pixel.map(|row| (row[0] * u + row[1] * v + row[2]) as f32)
    }
}

/// The inverse of a 3x3 matrix; values that are not finite when it has none.
pub(crate) fn inverted(m: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let cofactor = |r: usize, c: usize| {
        let (r1, r2, c1, c2) = ((r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3);
        m[r1][c1] * m[r2][c2] - m[r1][c2] * m[r2][c1]
    };
    let scale = 1.0 / (m[0][0] * cofactor(0, 0) + m[0][1] * cofactor(0, 1) + m[0][2] * cofactor(0, 2));
    [0, 1, 2].map(|r| [0, 1, 2].map(|c| cofactor(c, r) * scale))
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

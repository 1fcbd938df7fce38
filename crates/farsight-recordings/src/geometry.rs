//! A projection taken apart, and quaternions `[x, y, z, w]`.

use farsight_core::Camera;

/// A rotation.
pub(crate) type Quaternion = [f64; 4];

/// `camera` seen from `camera_link`: x right, y down, z forward from x forward, y left, z up.
pub(crate) const OPTICAL_FROM_LINK: Quaternion = [-0.5, 0.5, -0.5, 0.5];

/// A projection as `K [R | t]`.
pub(crate) struct Parts {
    /// Intrinsic matrix, row by row.
    pub(crate) k: [f64; 9],
    /// Where `camera_optical` stands in `camera`, metres.
    pub(crate) origin_m: [f64; 3],
    /// Turns directions of `camera_optical` into those of `camera`.
    pub(crate) rotation: Quaternion,
}

impl Parts {
    /// Takes a projection apart. What it has of skew is left out, as the formats have no place for it.
    pub(crate) fn of(camera: &Camera) -> Self {
        let ([cx, cy], fx, fy) = (camera.principal_point(), camera.focal_x(), camera.focal_y());
        let row = |i: usize| [0, 1, 2].map(|j: usize| camera.projection[i][j]);
        let last = row(2);
        let forward = unit(last);
        let right = unit([0, 1, 2].map(|j| row(0)[j] - cx * last[j]));
        // At a right angle to both others, also where there is skew.
        let down = cross(forward, right);
        // The columns of the rotation are the optical axes in camera coordinates.
        let rotation = quaternion([0, 1, 2].map(|j| [right[j], down[j], forward[j]]));
        let origin_m = camera.origin().unwrap_or_default();
        Self { k: [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0], origin_m, rotation }
    }
}

fn unit(v: [f64; 3]) -> [f64; 3] {
    let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
    v.map(|x| x / length)
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The rotation with this matrix, row by row (Shepperd's method: the largest of the four parts is found first).
fn quaternion(m: [[f64; 3]; 3]) -> Quaternion {
    let trace = m[0][0] + m[1][1] + m[2][2];
    if trace > 0.0 {
        let w = (1.0 + trace).sqrt() / 2.0;
        return [(m[2][1] - m[1][2]) / (4.0 * w), (m[0][2] - m[2][0]) / (4.0 * w), (m[1][0] - m[0][1]) / (4.0 * w), w];
    }
    let [i, j, k] = if m[0][0] >= m[1][1] && m[0][0] >= m[2][2] {
        [0, 1, 2]
    } else if m[1][1] >= m[2][2] {
        [1, 2, 0]
    } else {
        [2, 0, 1]
    };
    let part = (1.0 + m[i][i] - m[j][j] - m[k][k]).sqrt() / 2.0;
    let mut q = [0.0; 4];
    q[i] = part;
    q[j] = (m[i][j] + m[j][i]) / (4.0 * part);
    q[k] = (m[i][k] + m[k][i]) / (4.0 * part);
    q[3] = (m[k][j] - m[j][k]) / (4.0 * part);
    q
}

/// First `b`, then `a`.
pub(crate) fn product(a: Quaternion, b: Quaternion) -> Quaternion {
    let ([ax, ay, az, aw], [bx, by, bz, bw]) = (a, b);
    [
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    ]
}

#[cfg(test)]
mod tests {
    use farsight_core::Camera;

    use super::{OPTICAL_FROM_LINK, Parts, Quaternion, product};

    fn turned(q: Quaternion, v: [f64; 3]) -> [f64; 3] {
        let [x, y, z, w] = q;
        let [a, b, c, _] = product(product(q, [v[0], v[1], v[2], 0.0]), [-x, -y, -z, w]);
        [a, b, c]
    }

    fn close(a: &[f64], b: &[f64]) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9)
    }

    #[test]
    fn optical_axes_in_the_link_are_those_of_rep_103() {
        // Right is -y, down is -z, forward is x.
        for (axis, expected) in
            [([1., 0., 0.], [0., -1., 0.]), ([0., 1., 0.], [0., 0., -1.]), ([0., 0., 1.], [1., 0., 0.])]
        {
            assert!(close(&turned(OPTICAL_FROM_LINK, axis), &expected), "{axis:?}");
        }
    }

    /// `K [R | t]` with these parts sends points to the pixels to which the camera sends them.
    #[test]
    fn parts_project_as_the_whole() {
        let kitti = [
            [721.5377, 0.0, 609.5593, 44.85728],
            [0.0, 721.5377, 172.854, 0.216_379_1],
            [0.0, 0.0, 1.0, 0.002_745_884],
        ];
        // Looks 10 degrees down, rolled by 3.
        let (pitch, roll) = (10_f64.to_radians(), 3_f64.to_radians());
        let down = [[1.0, 0.0, 0.0], [0.0, pitch.cos(), -pitch.sin()], [0.0, pitch.sin(), pitch.cos()]];
        let rolled = [[roll.cos(), -roll.sin(), 0.0], [roll.sin(), roll.cos(), 0.0], [0.0, 0.0, 1.0]];
        let k = [[700.0, 0.0, 600.0], [0.0, 650.0, 180.0], [0.0, 0.0, 1.0]];
        let times = |a: [[f64; 3]; 3], b: [[f64; 3]; 3]| {
            [0, 1, 2].map(|i| [0, 1, 2].map(|j| (0..3).map(|n| a[i][n] * b[n][j]).sum::<f64>()))
        };
        let tilted = times(k, times(rolled, down)).map(|[a, b, c]| [a, b, c, 0.0]);
        for projection in [kitti, tilted] {
            let camera = Camera::from_projection(projection).unwrap();
            let parts = Parts::of(&camera);
            for point in [[1.0, 1.5, 20.0], [-5.0, 0.3, 9.0]] {
                let [x, y, z, w] = parts.rotation;
                let moved = [0, 1, 2].map(|i| point[i] - parts.origin_m[i]);
                let seen = turned([-x, -y, -z, w], moved);
                let pixel = [0, 1].map(|i| parts.k[3 * i + i] * seen[i] / seen[2] + parts.k[3 * i + 2]);
                let expected = camera.pixel_from_point(point).unwrap();
                assert!((0..2).all(|i| (pixel[i] - expected[i]).abs() < 1e-3), "{pixel:?} {expected:?}");
            }
        }
    }
}

//! Rigid motions: where a camera stands and how it is turned.

/// A rotation followed by a translation, from one frame of reference to another.
///
/// Names of values say both frames: `world_from_camera` takes a point in camera coordinates to world coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Rotation matrix, row by row; orthonormal with determinant 1.
    pub rotation: [[f64; 3]; 3],
    /// Translation after the rotation, metres.
    pub translation_m: [f64; 3],
}

impl Pose {
    /// Changes nothing.
    pub const IDENTITY: Self =
        Self { rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], translation_m: [0.0; 3] };

    /// The point `p`, metres, in the other frame of reference.
    pub fn apply(&self, p: [f64; 3]) -> [f64; 3] {
        let rotated = product(&self.rotation, p);
        std::array::from_fn(|axis| rotated[axis] + self.translation_m[axis])
    }

    /// The motion back.
    pub fn inverse(&self) -> Self {
        let rotation = std::array::from_fn(|row| std::array::from_fn(|column| self.rotation[column][row]));
        let translation_m = product(&rotation, self.translation_m).map(|value| -value);
        Self { rotation, translation_m }
    }

    /// This motion, then `next`: `b_from_a.then(&c_from_b)` is `c_from_a`.
    pub fn then(&self, next: &Self) -> Self {
        let column = |column: usize| product(&next.rotation, self.rotation.map(|row| row[column]));
        let columns: [[f64; 3]; 3] = std::array::from_fn(column);
        let rotation = std::array::from_fn(|row| std::array::from_fn(|column| columns[column][row]));
        Self { rotation, translation_m: next.apply(self.translation_m) }
    }
}

fn product(matrix: &[[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    matrix.map(|row| crate::linear::dot(&row, &v))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::Pose;

    const TOLERANCE: f64 = 1e-9;

    /// A turn by `yaw` about y, then one by `pitch` about x.
    fn pose(yaw: f64, pitch: f64, translation_m: [f64; 3]) -> Pose {
        let ((sy, cy), (sp, cp)) = (yaw.sin_cos(), pitch.sin_cos());
        let about_y = Pose { rotation: [[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]], ..Pose::IDENTITY };
        let about_x = Pose { rotation: [[1.0, 0.0, 0.0], [0.0, cp, -sp], [0.0, sp, cp]], translation_m };
        about_y.then(&about_x)
    }

    fn is_close(a: [f64; 3], b: [f64; 3]) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < TOLERANCE)
    }

    proptest! {
        #[test]
        fn the_inverse_leads_back_and_motions_chain(
            angles in prop::array::uniform4(-3.0..3.0_f64), points in prop::array::uniform9(-50.0..50.0_f64),
        ) {
            let [a, b, c, d, e, f, x, y, z] = points;
            let (first, second) = (pose(angles[0], angles[1], [a, b, c]), pose(angles[2], angles[3], [d, e, f]));
            let p = [x, y, z];
            prop_assert!(is_close(first.inverse().apply(first.apply(p)), p));
            prop_assert!(is_close(first.then(&second).apply(p), second.apply(first.apply(p))));
            let lengths = [p, [0.0; 3]].map(|p| first.apply(p));
            let length = (0..3).map(|axis| (lengths[0][axis] - lengths[1][axis]).powi(2)).sum::<f64>().sqrt();
            prop_assert!((length - crate::linear::norm(&p)).abs() < TOLERANCE);
        }
    }

    #[test]
    fn a_camera_that_looks_along_the_x_axis_of_the_world() {
        // The world's x is ahead, y left, z up (nuScenes); the camera's z is ahead, x right, y down, and it stands 1.5
        // m high.
        let world_from_camera =
            Pose { rotation: [[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]], translation_m: [0.0, 0.0, 1.5] };
        assert!(is_close(world_from_camera.apply([2.0, 1.5, 10.0]), [10.0, -2.0, 0.0]));
        assert_eq!(Pose::IDENTITY.then(&world_from_camera), world_from_camera);
    }
}

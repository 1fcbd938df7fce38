//! Boxes as other programs have them: centre, rotation, size along the box's own axes.

use farsight_core::{Box3d, Detection};

use crate::geometry::{Quaternion, product};

/// Turns a box's own axes (x forward, y left, z up) into those of a box with yaw 0 in camera coordinates, which faces
/// x.
const UPRIGHT: Quaternion = [std::f64::consts::FRAC_1_SQRT_2, 0.0, 0.0, std::f64::consts::FRAC_1_SQRT_2];

/// A box in the frame `camera`.
pub(crate) struct Placed {
    /// The middle of the box, not of its bottom, metres.
    pub(crate) center_m: [f64; 3],
    /// Turns the box's own axes, x forward, y left, z up, into those of the frame.
    pub(crate) rotation: Quaternion,
    /// Along the box's own axes: length, width, height, metres.
    pub(crate) size_m: [f64; 3],
}

impl Placed {
    pub(crate) fn of(found: &Box3d) -> Self {
        let ([x, y, z], size) = (found.location, found.dimensions);
        let half = found.yaw / 2.0;
        Self {
            center_m: [x, y - size.height / 2.0, z],
            rotation: product([0.0, half.sin(), 0.0, half.cos()], UPRIGHT),
            size_m: [size.length, size.width, size.height],
        }
    }
}

/// Covariance of the centre, square metres.
///
/// The error bar is that of the depth, and the direction is known much better: the error lies along the ray through the
/// centre. What lies across it is not estimated and is 0. All is 0 without an error bar.
pub(crate) fn covariance_m2(detection: &Detection) -> [[f64; 3]; 3] {
    let [x, y, z] = Placed::of(&detection.box3d).center_m;
    let sigma_m = detection.range_sigma_m.filter(|sigma_m| sigma_m.is_finite() && z > 0.0).unwrap_or(0.0);
    let along = [x / z, y / z, 1.0].map(|part| part * sigma_m);
    if sigma_m > 0.0 { [0, 1, 2].map(|i: usize| [0, 1, 2].map(|j: usize| along[i] * along[j])) } else { [[0.0; 3]; 3] }
}

#[cfg(test)]
mod tests {
    use farsight_core::{Box2d, Box3d, Detection, Dimensions, ObjectClass};

    use super::{Placed, covariance_m2};
    use crate::geometry::product;

    fn car(yaw: f64) -> Box3d {
        Box3d { dimensions: Dimensions { height: 1.5, width: 1.6, length: 4.0 }, location: [6.0, 1.7, 20.0], yaw }
    }

    /// The corners by centre, rotation and size are the corners of the box.
    #[test]
    fn the_box_is_the_same_box() {
        for yaw in [0.0, 0.4, -2.5, 3.1] {
            let (found, placed) = (car(yaw), Placed::of(&car(yaw)));
            let [x, y, z, w] = placed.rotation;
            let at = |own: [f64; 3]| {
                let [a, b, c] = [0, 1, 2].map(|i| own[i] * placed.size_m[i]);
                let [a, b, c, _] = product(product(placed.rotation, [a, b, c, 0.0]), [-x, -y, -z, w]);
                [placed.center_m[0] + a, placed.center_m[1] + b, placed.center_m[2] + c]
            };
            // The middle of the front is half a length ahead, towards (cos yaw, 0, -sin yaw).
            let [front, top] = [at([0.5, 0.0, 0.0]), at([0.0, 0.0, 0.5])];
            let expected = [6.0 + 2.0 * yaw.cos(), 1.7 - 0.75, 20.0 - 2.0 * yaw.sin()];
            assert!((0..3).all(|i| (front[i] - expected[i]).abs() < 1e-12), "{yaw}: {front:?}");
            let expected = [6.0, 1.7 - 1.5, 20.0];
            assert!((0..3).all(|i| (top[i] - expected[i]).abs() < 1e-12), "{yaw}: {top:?}");
            let corners = found.corners();
            for signs in 0..8 {
                let own = [0, 1, 2].map(|axis| if signs >> axis & 1 == 1 { 0.5 } else { -0.5 });
                let corner = at(own);
                let is_there = |known: &[f64; 3]| (0..3).all(|i| (known[i] - corner[i]).abs() < 1e-9);
                assert!(corners.iter().any(is_there), "{yaw}: {corner:?} of {corners:?}");
            }
        }
    }

    #[test]
    fn the_error_lies_along_the_ray() {
        let box2d = Box2d::new(0.0, 0.0, 50.0, 40.0);
        let mut detection =
            Detection { class: ObjectClass::Car, score: 0.7, box2d, box3d: car(0.0), range_sigma_m: Some(2.0) };
        let found = covariance_m2(&detection);
        assert!((found[2][2] - 4.0).abs() < 1e-12 && (found[0][0] - 4.0 * 0.09).abs() < 1e-12, "{found:?}");
        assert!((found[0][2] - 4.0 * 0.3).abs() < 1e-12 && (found[0][2] - found[2][0]).abs() < 1e-12, "{found:?}");
        detection.range_sigma_m = None;
        assert_eq!(covariance_m2(&detection), [[0.0; 3]; 3]);
    }
}

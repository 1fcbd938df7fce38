//! Ranging without a network: what a 2D box and a known camera give by themselves. The measure that a learnt distance
//! has to beat.

use crate::{Box2d, Camera};

/// Smallest height of a box, and smallest distance of its bottom edge from the horizon, that say anything, pixels.
const MIN_PX: f64 = 1.0;

/// Depth, metres, by similar triangles: an object `height_m` high fills the height of `box2d`.
///
/// The box shows the side that faces the camera, about half the object's length nearer than its centre: `half_length_m`
/// is added. `None` for a box lower than a pixel.
pub fn depth_from_height(box2d: &Box2d, camera: &Camera, height_m: f64, half_length_m: f64) -> Option<f64> {
    (box2d.height() >= MIN_PX).then(|| camera.focal_y() * height_m / box2d.height() + half_length_m)
}

/// Depth, metres, by inverse perspective mapping: the bottom edge of `box2d` stands on flat ground `camera_height_m`
/// below the camera.
///
/// The edge is where the object is nearest: `half_length_m` is added. `None` for an edge at or above the horizon.
pub fn depth_from_ground(box2d: &Box2d, camera: &Camera, camera_height_m: f64, half_length_m: f64) -> Option<f64> {
    let horizon = camera.pixel_from_point([0.0, 0.0, HORIZON_M])?;
    let below = box2d.y2 - horizon[1];
    (below >= MIN_PX).then(|| camera.focal_y() * camera_height_m / below + half_length_m)
}

/// Far enough to stand for the horizon, metres.
const HORIZON_M: f64 = 1e6;

#[cfg(test)]
mod tests {
    use super::{depth_from_ground, depth_from_height};
    use crate::{Box2d, Camera};

    const EXACT: f64 = 1e-3;

    #[test]
    fn both_find_a_flat_plate_where_it_stands() {
        let camera = Camera::from_intrinsics(700.0, 700.0, 610.0, 170.0).unwrap();
        for z in [5.0, 20.0, 60.0] {
            let [_, bottom] = camera.pixel_from_point([0.0, 1.65, z]).unwrap();
            let [_, top] = camera.pixel_from_point([0.0, 0.15, z]).unwrap();
            let plate = Box2d::new(600.0, top, 620.0, bottom);
            assert!((depth_from_height(&plate, &camera, 1.5, 0.0).unwrap() - z).abs() < EXACT);
            assert!((depth_from_ground(&plate, &camera, 1.65, 0.0).unwrap() - z).abs() < EXACT);
            assert!((depth_from_height(&plate, &camera, 1.5, 2.0).unwrap() - z - 2.0).abs() < EXACT);
        }
    }

    #[test]
    fn what_says_nothing_gives_nothing() {
        let camera = Camera::from_intrinsics(700.0, 700.0, 610.0, 170.0).unwrap();
        let above_the_horizon = Box2d::new(600.0, 100.0, 620.0, 160.0);
        assert_eq!(depth_from_ground(&above_the_horizon, &camera, 1.65, 0.0), None);
        let flat = Box2d::new(600.0, 200.0, 620.0, 200.0);
        assert_eq!(depth_from_height(&flat, &camera, 1.5, 0.0), None);
    }
}

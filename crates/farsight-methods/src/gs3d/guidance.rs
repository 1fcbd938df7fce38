//! The guidance: where an object of its class's mean size would have to stand to fill its 2D box.

use farsight_core::box3d::ray_angle;
use farsight_core::{Box2d, Box3d, Camera, Dimensions, wrapped_angle};

/// The middle of an object's bottom is seen so far above the lower edge of its 2D box, as a share of the box's height
/// (paper, section 3.2). The middle of its top is seen at the upper edge.
const BOTTOM_SHARE: f64 = 0.07;

/// A lower box says nothing, pixels.
const MIN_HEIGHT_PX: f64 = 1.0;

/// The cuboid of an object that `camera` sees in `box2d` (pixels) under the observation angle `alpha` (radians), if its
/// size (height, width, length, metres) is that of its class; none of a box lower than a pixel.
pub fn guidance(box2d: &Box2d, alpha: f64, [height, width, length]: [f64; 3], camera: &Camera) -> Option<Box3d> {
    let height_px = box2d.height();
    if height_px.is_nan() || height_px < MIN_HEIGHT_PX {
        return None;
    }
    let depth_m = camera.focal_y() * height / ((1.0 - BOTTOM_SHARE) * height_px);
    let bottom = [f64::midpoint(box2d.x1, box2d.x2), box2d.y2 - BOTTOM_SHARE * height_px];
    let location = camera.point_from_pixel(bottom, depth_m);
    let yaw = wrapped_angle(alpha + ray_angle(location));
    Some(Box3d { dimensions: Dimensions { height, width, length }, location, yaw })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_plate_of_the_mean_height_is_put_where_it_stands(
            x in -9.0..9.0, y in 0.5..2.5, z in 4.0..80.0, alpha in -3.1..3.1, height in 0.5..4.0, offset in -0.1..0.1,
        ) {
            let mut camera = Camera::from_hfov(80.0, 1280, 384).unwrap();
            camera.projection[0][3] = 40.0 * offset;
            let pixel = |y: f64| camera.pixel_from_point([x, y, z]).unwrap();
            let ([u, top], [_, bottom]) = (pixel(y - height), pixel(y));
            // The lower edge lies below the middle of the bottom by its share.
            let lower = bottom + (bottom - top) * BOTTOM_SHARE / (1.0 - BOTTOM_SHARE);
            let box2d = Box2d::new(u - 9.0, top, u + 9.0, lower);
            let found = guidance(&box2d, alpha, [height, 1.6, 3.9], &camera);
            prop_assume!(lower - top >= MIN_HEIGHT_PX);
            let found = found.unwrap();
            prop_assert!(found.location.iter().zip([x, y, z]).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?}");
            prop_assert!(wrapped_angle(found.alpha() - alpha).abs() < 1e-9);
        }
    }

    /// The constants are what `scripts/make_rival_goldens.py` prints, which has the formulas in numpy.
    #[test]
    fn a_guidance_is_that_of_an_independent_computation() {
        let projection = [[721.5, 0.0, 609.6, 44.9], [0.0, 721.5, 172.9, 0.2], [0.0, 0.0, 1.0, 0.003]];
        let camera = Camera::from_projection(projection).unwrap();
        let found = guidance(&Box2d::new(500.0, 160.0, 620.0, 250.0), -1.3, [1.53, 1.63, 3.88], &camera).unwrap();
        let numbers = [found.location[0], found.location[1], found.location[2], found.yaw];
        for (found, expected) in numbers.iter().zip([-0.966_569_647, 1.294_929_654, 13.188_709_677, -1.373_156_868]) {
            assert!((found - expected).abs() < 1e-6, "{found}, not {expected}");
        }
    }

    #[test]
    fn boxes_without_height_say_nothing() {
        let camera = Camera::from_hfov(80.0, 1280, 384).unwrap();
        for box2d in
            [Box2d::new(0.0, 9.0, 9.0, 9.5), Box2d::new(0.0, 9.0, 9.0, 3.0), Box2d::new(0.0, f64::NAN, 9.0, 9.0)]
        {
            assert_eq!(guidance(&box2d, 0.0, [1.5, 1.6, 3.9], &camera), None, "{box2d:?}");
        }
    }
}

//! Where an earlier stage could have placed an object.

use farsight_core::{Box3d, Camera, Dimensions, wrapped_angle};
use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

/// Errors of an earlier stage, standard deviations.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BoxErrors {
    /// Of the logarithm of the depth.
    pub(crate) depth: f64,
    /// Of the logarithms of the sizes.
    pub(crate) size: f64,
    /// Of the centre, as a share of the object's length and height.
    pub(crate) center: f64,
    /// Of the heading.
    pub(crate) heading_rad: f64,
}

/// `object` as an earlier stage could have placed it; `None` when its centre is not in front of the camera.
pub(crate) fn jittered(object: &Box3d, camera: &Camera, errors: &BoxErrors, rng: &mut impl Rng) -> Option<Box3d> {
    let mut normal = |deviation: f64| deviation * rng.sample::<f64, _>(StandardNormal);
    let Dimensions { height, width, length } = object.dimensions;
    let dimensions = Dimensions {
        height: height * normal(errors.size).exp(),
        width: width * normal(errors.size).exp(),
        length: length * normal(errors.size).exp(),
    };
    let depth_m = object.depth_m() * normal(errors.depth).exp();
    let [u, v] = camera.pixel_from_point(object.center())?;
    let metre_px = camera.focal_y() / object.depth_m();
    let center = [u + metre_px * length * normal(errors.center), v + metre_px * height * normal(errors.center)];
    let [x, y, z] = camera.point_from_pixel(center, depth_m);
    let yaw = wrapped_angle(object.yaw + normal(errors.heading_rad));
    Some(Box3d { dimensions, location: [x, y + dimensions.height / 2.0, z], yaw })
}

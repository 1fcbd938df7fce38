//! What detectors share whose answers stand at the cells of a map of stride 4: one backbone, a convolution stack for
//! each answer, peaks of a heatmap.

mod decode;
mod detector;
mod features;
mod heading;
#[cfg(feature = "train")]
pub mod train;

use farsight_core::detection::View;
use farsight_core::score::{logistic, logit};
use farsight_core::{Affine2, Box2d, Camera};

pub(crate) use decode::{at_peaks, at_peaks_with, peak_score, value_at};
pub use detector::CenterMethod;
pub use features::Features;
pub(crate) use features::{PRIOR_LOGIT, head};
pub use heading::{HEADING_BINS, Heading};

/// Input pixels per cell of the maps.
pub const STRIDE: usize = 4;

/// Added to the depth's sigmoid: no depth is infinite (code of CenterNet and `MonoDLE`).
const DEPTH_EPSILON: f64 = 1e-6;

/// Depth before its activation, for a depth in metres.
pub fn raw_depth(depth_m: f64) -> f64 {
    logit((1.0 / (depth_m + 1.0) - DEPTH_EPSILON).clamp(f64::EPSILON, 1.0 - f64::EPSILON))
}

/// Depth, metres, of the raw channel.
pub fn depth_from_raw(raw: f64) -> f64 {
    1.0 / (logistic(raw) + DEPTH_EPSILON) - 1.0
}

/// The camera of the feature map that belongs to the camera of the network's input.
pub fn feature_camera(input_camera: &Camera) -> Camera {
    input_camera.transformed(&Affine2::scaling(1.0 / STRIDE as f64))
}

/// A box in cells of the feature map as pixels of the original image: the input is a scaled and shifted image.
pub(crate) fn image_box(cells: &Box2d, view: &View) -> Box2d {
    image_box_of(cells, STRIDE, view)
}

/// As [`image_box`], in cells of a map of this stride.
pub(crate) fn image_box_of(cells: &Box2d, stride: usize, view: &View) -> Box2d {
    let (from, to) = (view.input_camera.principal_point(), view.camera.principal_point());
    let scale =
        [view.camera.focal_x() / view.input_camera.focal_x(), view.camera.focal_y() / view.input_camera.focal_y()];
    let at = |cell: f64, axis: usize| (cell * stride as f64 - from[axis]) * scale[axis] + to[axis];
    Box2d::new(at(cells.x1, 0), at(cells.y1, 1), at(cells.x2, 0), at(cells.y2, 1))
}

/// True depth over virtual depth under `camera` (of the feature map), where `focal_px` is the focal length, pixels of
/// the network's input, under which both are the same; 1 where depth is taken as it is.
pub(crate) fn depth_scale(focal_px: Option<f64>, camera: &Camera) -> f64 {
    focal_px.map_or(1.0, |focal_px| camera.focal_y() * STRIDE as f64 / focal_px)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_and_its_raw_channel_are_inverse() {
        for depth_m in [0.5, 4.0, 30.0, 120.0] {
            let back = depth_from_raw(raw_depth(depth_m));
            assert!((back / depth_m - 1.0).abs() < 1e-9, "{depth_m}: {back}");
        }
    }
}

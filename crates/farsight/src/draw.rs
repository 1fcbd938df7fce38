//! Drawing what was found.

use farsight_core::Camera;
use farsight_viz::{DrawOptions, Scene, picture};
use image::RgbImage;

use crate::object::{DetectedObject, RangeKind, detections};

/// The image with boxes and distances, and the view from above beside or below it.
///
/// A large image is drawn at a fraction of its size. `farsight_viz` has more to choose from.
pub fn draw(image: &RgbImage, camera: &Camera, objects: &[DetectedObject], range: RangeKind) -> RgbImage {
    let options = DrawOptions { distance_m: range.measure(), ..DrawOptions::default() };
    picture(image, &Scene { camera, detections: &detections(objects), truth: &[] }, &options)
}

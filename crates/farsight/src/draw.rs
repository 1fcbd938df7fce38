//! Drawing what was found.

use farsight_core::{Camera, Lens};
use farsight_viz::{DrawOptions, Scene, picture};
use image::RgbImage;

use crate::object::{DetectedObject, RangeKind, detections};

/// The image with boxes and distances, and the view from above beside or below it.
///
/// A large image is drawn at a fraction of its size. `farsight_viz` has more to choose from.
pub fn draw(image: &RgbImage, camera: &Camera, objects: &[DetectedObject], range: RangeKind) -> RgbImage {
    drawn(image, camera, None, objects, range)
}

/// [`draw()`] for an image that `lens` has distorted; `camera` is the pinhole behind it. Boxes are bent as the image is.
pub fn draw_through_lens(
    image: &RgbImage,
    camera: &Camera,
    lens: Lens,
    objects: &[DetectedObject],
    range: RangeKind,
) -> RgbImage {
    drawn(image, camera, Some(lens), objects, range)
}

fn drawn(
    image: &RgbImage,
    camera: &Camera,
    lens: Option<Lens>,
    objects: &[DetectedObject],
    range: RangeKind,
) -> RgbImage {
    let options = DrawOptions { distance_m: range.measure(), lens, ..DrawOptions::default() };
    picture(image, &Scene { camera, detections: &detections(objects), truth: &[] }, &options)
}

//! Drawing what was found.

use std::fmt::Write;

use farsight_core::{Camera, Detection, Lens};
pub use farsight_viz::picture_divisor;
use farsight_viz::{DrawOptions, Scene, picture, picture_with_words};
use image::RgbImage;

use crate::json::TrackRecord;
use crate::object::{DetectedObject, RangeKind, detections};

/// The image with boxes and distances, and the view from above beside or below it.
///
/// A large image is drawn at a fraction of its size, which [`picture_divisor`] tells. `farsight_viz` has more to choose
/// from.
pub fn draw(image: &RgbImage, camera: &Camera, objects: &[DetectedObject], range: RangeKind) -> RgbImage {
    draw_through_lens(image, camera, None, objects, range)
}

/// [`draw()`] for an image that `lens` has distorted, where there is one; `camera` is the pinhole behind it. Boxes are
/// bent as the image is.
pub fn draw_through_lens(
    image: &RgbImage,
    camera: &Camera,
    lens: Option<Lens>,
    objects: &[DetectedObject],
    range: RangeKind,
) -> RgbImage {
    let pitch_rad = objects.first().map_or(0.0, |object| object.pitch_rad);
    let options = DrawOptions { distance_m: range.measure(), lens, pitch_rad, ..DrawOptions::default() };
    picture(image, &Scene { camera, detections: &detections(objects), truth: &[] }, &options)
}

/// The frame of a video with its tracks, as [`draw_through_lens`] has it: identities, distances, speeds, times to
/// collision.
///
/// `tracks` and `detections` are the same, in the same order.
pub fn draw_tracks(
    image: &RgbImage,
    camera: &Camera,
    lens: Option<Lens>,
    detections: &[Detection],
    tracks: &[TrackRecord],
) -> RgbImage {
    let words: Vec<String> = tracks.iter().map(track_words).collect();
    let options = DrawOptions { lens, ..DrawOptions::default() };
    picture_with_words(image, &Scene { camera, detections, truth: &[] }, &options, &words)
}

/// `#7 Car 23.4 ±1.2 m  +3.1 ±0.4 m/s  6.9 s`.
pub fn track_words(track: &TrackRecord) -> String {
    let TrackRecord { id, class, range_m, range_sigma_m, .. } = track;
    let mut words = format!("#{id} {class} {range_m:.1} ±{range_sigma_m:.1} m");
    // Writing to a string cannot fail.
    if let (Some(mps), Some(sigma)) = (track.closing_mps, track.closing_sigma_mps) {
        let _ = write!(words, "  {mps:+.1} ±{sigma:.1} m/s");
    }
    if let Some(ttc_s) = track.ttc_s {
        let _ = write!(words, "  {ttc_s:.1} s");
    }
    if track.coasting {
        words.push_str("  hidden");
    }
    words
}

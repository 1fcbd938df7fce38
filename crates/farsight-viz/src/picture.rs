//! The image and the bird's-eye view in one picture.

use image::RgbImage;

use crate::annotate::annotated;
use crate::birds_eye::panel;
use crate::canvas::Canvas;
use crate::options::{DrawOptions, Scene};
use crate::palette::SHADOW;
use crate::scale::drawing_scale;

/// Images wider than this many heights get the panel below, others beside.
const WIDE: f64 = 2.0;

/// Height of a panel below, in widths of the image; width of a panel beside, in heights of the image.
const PANEL_SHARE: (f64, f64) = (0.46, 0.8);

/// Smallest side of a panel, pixels: small images still get a view that can be read.
const MIN_PANEL_PX: f64 = 320.0;

/// The annotated image with the bird's-eye view: below a wide image such as KITTI's, to the right of others.
///
/// An image that cannot be drawn on (no pixels, or too many for memory) comes back as it is.
pub fn picture(image: &RgbImage, scene: &Scene, options: &DrawOptions) -> RgbImage {
    composed(image, scene, options).unwrap_or_else(|| image.clone())
}

fn composed(image: &RgbImage, scene: &Scene, options: &DrawOptions) -> Option<RgbImage> {
    let image_size = [image.width(), image.height()];
    let [width, height] = image_size.map(f64::from);
    let below = width > WIDE * height;
    let panel_size = if below { [width, width * PANEL_SHARE.0] } else { [height * PANEL_SHARE.1, height] };
    let panel_size = panel_size.map(|side| side.max(MIN_PANEL_PX).round() as u32);
    let view = panel(scene, image_size, panel_size, drawing_scale(image_size), options)?;
    let annotated = annotated(image, scene, options, None, false)?;

    let gap = (3.0 * drawing_scale(image_size)).round() as u32;
    let at = if below { [0, image_size[1] + gap] } else { [image_size[0] + gap, 0] };
    let size = [0, 1].map(|axis| (at[axis] + panel_size[axis]).max(image_size[axis]));
    let mut canvas = Canvas::filled(size, SHADOW)?;
    canvas.paste(&annotated, [0, 0]);
    canvas.paste(&view, at);
    Some(canvas.into_image())
}

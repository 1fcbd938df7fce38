//! The image and the bird's-eye view in one picture.

use farsight_core::Affine2;
use image::imageops::thumbnail;
use image::{Rgb, RgbImage};

use crate::annotate::{Tags, annotated};
use crate::birds_eye::panel;
use crate::options::{DrawOptions, Scene};
use crate::palette::SHADOW;
use crate::scale::drawing_scale;

/// Images wider than this many heights get the panel below, others beside.
const WIDE: f64 = 2.0;

/// Height of a panel below, in widths of the image; width of a panel beside, in heights of the image.
const PANEL_SHARE: (f64, f64) = (0.46, 0.8);

/// Smallest side of a panel, pixels: small images still get a view that can be read.
const MIN_PANEL_PX: f64 = 320.0;

/// Largest side of a panel, pixels. It grows with the longer side of the image, and would be hundreds of times a very
/// long image.
const MAX_PANEL_PX: f64 = 2160.0;

/// Images of this many pixels and more are drawn smaller: no screen shows them whole.
const MAX_DRAWN_PX: u64 = 12_000_000;

/// A picture may have this many pixels beside twice those of its image.
const SPARE_PX: u64 = 8_000_000;

/// The annotated image with the bird's-eye view: below a wide image such as KITTI's, to the right of others.
///
/// A large image is drawn smaller, by the whole number that [`picture_divisor`] tells, and so is a very long one. An
/// image that cannot be drawn on (no pixels) comes back as it is.
pub fn picture(image: &RgbImage, scene: &Scene, options: &DrawOptions) -> RgbImage {
    drawn(image, scene, options, &Tags::Classes)
}

/// [`picture`] with these words on the detections, in their order: identities and speeds for instance.
pub fn picture_with_words(image: &RgbImage, scene: &Scene, options: &DrawOptions, words: &[String]) -> RgbImage {
    drawn(image, scene, options, &Tags::Words(words))
}

fn drawn(image: &RgbImage, scene: &Scene, options: &DrawOptions, says: &Tags) -> RgbImage {
    let divisor = picture_divisor([image.width(), image.height()]);
    if divisor == 1 {
        return composed(image, scene, options, says).unwrap_or_else(|| image.clone());
    }
    let [width, height] = divided([image.width(), image.height()], divisor);
    let smaller = thumbnail(image, width, height);
    let [x, y] = [f64::from(width) / f64::from(image.width()), f64::from(height) / f64::from(image.height())];
    // A pixel's middle is a whole number.
    let map = Affine2 { matrix: [[x, 0.0, 0.5 * x - 0.5], [0.0, y, 0.5 * y - 0.5]] };
    let scene = Scene { camera: &scene.camera.transformed(&map), ..*scene };
    composed(&smaller, &scene, options, says).unwrap_or(smaller)
}

/// By which whole number the sides of an image of this size are divided in its [`picture`]: 1 below 12 megapixels,
/// unless it is very long.
pub fn picture_divisor(image_size: [u32; 2]) -> u32 {
    let pixels = |[width, height]: [u32; 2]| u64::from(width) * u64::from(height);
    let most = 2 * pixels(image_size) + SPARE_PX;
    let fits = |divisor: &u32| {
        let size = divided(image_size, *divisor);
        pixels(size) < MAX_DRAWN_PX && pixels(Layout::new(size).size) <= most
    };
    let longest = image_size[0].max(image_size[1]).max(1);
    (1..longest).find(fits).unwrap_or(longest)
}

fn divided(size: [u32; 2], divisor: u32) -> [u32; 2] {
    size.map(|side| if side == 0 { 0 } else { (side / divisor).max(1) })
}

/// Where the panel stands, and how large everything is, pixels.
struct Layout {
    panel_size: [u32; 2],
    panel_at: [u32; 2],
    size: [u32; 2],
}

impl Layout {
    fn new(image_size: [u32; 2]) -> Self {
        let [width, height] = image_size.map(f64::from);
        let below = width > WIDE * height;
        let panel_size = if below { [width, width * PANEL_SHARE.0] } else { [height * PANEL_SHARE.1, height] };
        let panel_size = panel_size.map(|side| side.clamp(MIN_PANEL_PX, MAX_PANEL_PX).round() as u32);
        let gap = (3.0 * drawing_scale(image_size)).round() as u32;
        let panel_at = if below { [0, image_size[1] + gap] } else { [image_size[0] + gap, 0] };
        let size = [0, 1].map(|axis| (panel_at[axis] + panel_size[axis]).max(image_size[axis]));
        Self { panel_size, panel_at, size }
    }
}

fn composed(image: &RgbImage, scene: &Scene, options: &DrawOptions, says: &Tags) -> Option<RgbImage> {
    let image_size = [image.width(), image.height()];
    let Layout { panel_size, panel_at, size } = Layout::new(image_size);
    // Text as large as on the image, unless the panel is much smaller.
    let scale = drawing_scale(image_size).min(2.0 * drawing_scale(panel_size));
    let annotated = annotated(image, scene, options, says, false)?;
    let view = panel(scene, image_size, panel_size, scale, options)?;
    let mut whole = RgbImage::from_pixel(size[0], size[1], Rgb(SHADOW.rgb));
    place(&mut whole, &annotated, [0, 0]);
    place(&mut whole, &view, panel_at);
    Some(whole)
}

/// Puts `part` into `whole`, row by row; it must fit there.
fn place(whole: &mut RgbImage, part: &RgbImage, [left, top]: [u32; 2]) {
    let [whole_row, part_row] = [whole.width(), part.width()].map(|width| 3 * width as usize);
    let rows = whole.chunks_exact_mut(whole_row).skip(top as usize);
    let first = 3 * left as usize;
    for (row, part) in rows.zip(part.chunks_exact(part_row)) {
        row[first..first + part_row].copy_from_slice(part);
    }
}

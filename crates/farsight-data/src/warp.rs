//! From pixels to the network's input: an affine warp, colour jitter and normalisation in one pass.

mod antialias;
mod paint;
mod resample;
mod row_planes;
mod taps;

use farsight_core::Affine2;
use farsight_core::input::{InputRules, Sampling};
use image::RgbImage;

use crate::ColorJitter;
use paint::Paint;

/// The network's input, planar `[3, height, width]` of `rules.size`, normalised (spec section 8, items 4 and 5).
///
/// `affine` takes pixels of `image` to pixels of the input; mirror, crop, scale and rotation are all allowed. What lies
/// outside the image is black, before and after the jitter. A singular `affine` gives a black input.
///
/// With [`Sampling::HalfPixel`] values are cut to whole numbers as Pillow does; with the others they stay as they
/// are.
pub fn network_input(image: &RgbImage, affine: &Affine2, rules: &InputRules, jitter: Option<&ColorJitter>) -> Vec<f32> {
    let mut input = Vec::new();
    network_input_into(&mut input, image, affine, rules, jitter);
    input
}

/// As [`network_input`], into a vector that is there already: for one image after the other, because fresh memory costs
/// time.
pub fn network_input_into(
    input: &mut Vec<f32>,
    image: &RgbImage,
    affine: &Affine2,
    rules: &InputRules,
    jitter: Option<&ColorJitter>,
) {
    input.resize(3 * rules.size[0] * rules.size[1], 0.0);
    network_input_in(input, image, affine, rules, jitter);
}

/// As [`network_input`], in the `3 * height * width` values of `input`, whatever they are.
///
/// # Panics
/// When `input` has another length.
pub fn network_input_in(
    input: &mut [f32],
    image: &RgbImage,
    affine: &Affine2,
    rules: &InputRules,
    jitter: Option<&ColorJitter>,
) {
    let [width, height] = rules.size;
    let area = width * height;
    assert_eq!(input.len(), 3 * area, "three planes of the input");
    let paint = Paint::new(rules, jitter);
    // Rows from here on, of every plane, still hold what they held before.
    let mut row_to_fill = 0;
    if let Some(source_from_output) = source_from_output(affine, rules.sampling) {
        resample::rows(image, &source_from_output, rules.size, rules.sampling, |row, columns, rgb| {
            let line = row * width;
            paint.black(input, row_to_fill * width..line + columns.start);
            paint.black(input, line + columns.end..line + width);
            row_to_fill = row + 1;
            let [first, second, third] = planes(input, area);
            let covered = line + columns.start..line + columns.end;
            paint.row([first, second, third].map(|plane| &mut plane[covered.clone()]), rgb);
        });
    }
    paint.black(input, row_to_fill * width..area);
}

/// The image after `affine`, `size` (width, height) pixels large, bilinear, black outside.
///
/// Values are cut to whole numbers with [`Sampling::HalfPixel`] (Pillow) and rounded with the others (OpenCV).
///
/// # Panics
/// When a side of `size` does not fit `u32`.
pub fn warp(image: &RgbImage, affine: &Affine2, size: [usize; 2], sampling: Sampling) -> RgbImage {
    let [width, height] = size.map(|side| side as u32);
    let mut warped = RgbImage::new(width, height);
    let Some(source_from_output) = source_from_output(affine, sampling) else { return warped };
    let rounding = match sampling {
        Sampling::PixelExact | Sampling::Antialias => 0.5,
        Sampling::HalfPixel => 0.0,
    };
    resample::rows(image, &source_from_output, size, sampling, |row, columns, [red, green, blue]| {
        let start = row * size[0] + columns.start;
        let bytes = &mut warped.as_flat_samples_mut().samples[3 * start..][..3 * columns.len()];
        let (pixels, _) = bytes.as_chunks_mut::<3>();
        for ((pixel, &r), (&g, &b)) in pixels.iter_mut().zip(red).zip(green.iter().zip(blue)) {
            *pixel = [r, g, b].map(|value| (value + rounding) as u8);
        }
    });
    warped
}

/// Where each output pixel looks in the source; `None` when `affine` is singular.
///
/// The half-pixel rule takes pixels for squares and turns about their corners. An axis that is mirrored is mirrored
/// about pixel centres all the same, as official SMOKE flips pixels first and warps afterwards.
fn source_from_output(affine: &Affine2, sampling: Sampling) -> Option<Affine2> {
    let mut inverse = affine.inverse()?;
    if sampling == Sampling::HalfPixel {
        for (axis, row) in inverse.matrix.iter_mut().enumerate() {
            row[2] += 0.5 * (row[0] + row[1]) - 0.5_f64.copysign(row[axis]);
        }
    }
    Some(inverse)
}

fn planes(input: &mut [f32], area: usize) -> [&mut [f32]; 3] {
    let (first, rest) = input.split_at_mut(area);
    let (second, third) = rest.split_at_mut(area);
    [first, second, third]
}

//! Smoothing what is noisy, for networks that have seen no noise.
//!
//! Grain of a sensor in the dark looks to a detector like nothing it knows. A Gaussian blur as wide as the noise asks
//! for gives most of what was lost back, and an image without noise stays as it is, byte for byte.

use std::borrow::Cow;
use std::f64::consts::FRAC_PI_2;

use image::RgbImage;
use image::imageops::blur;

/// From this noise on images are smoothed. Photographs of the data sets that were at hand have at most 4, rendered
/// nights 10.7; from 12 on smoothing is known to help.
const NOISY: f64 = 11.0;

/// Pixels that are looked at, about; of larger images every so many-th row.
const LOOKED_AT: usize = 1 << 19;

/// Standard deviation of the noise of `image`, of 255, by its brightness (Immerkær, *Fast Noise Variance Estimation*,
/// 1996). Fine texture counts as noise. 0 for an image with fewer than three pixels a side.
pub fn noise_level(image: &RgbImage) -> f64 {
    let (width, height) = (image.width() as usize, image.height() as usize);
    if width < 3 || height < 3 {
        return 0.0;
    }
    let pixels: &[u8] = image.as_raw();
    // The weights of BT.601, of 256.
    let brightness =
        |rgb: &[u8]| ((77 * u16::from(rgb[0]) + 150 * u16::from(rgb[1]) + 29 * u16::from(rgb[2])) >> 8) as i16;
    let step = (width * height).div_ceil(LOOKED_AT);
    let (mut sum, mut count) = (0_u64, 0_u64);
    // Rows above, at and below the one that is looked at, and their second difference.
    let (mut rows, mut outer) = ([const { Vec::new() }; 3], Vec::new());
    let mut fresh = rows.len();
    for middle in (1..height - 1).step_by(step) {
        rows.rotate_left(fresh % 3);
        for (row, place) in rows[3 - fresh..].iter_mut().zip(middle + 2 - fresh..) {
            row.clear();
            row.extend(pixels[3 * width * place..3 * width * (place + 1)].chunks_exact(3).map(brightness));
        }
        fresh = step.min(3);
        let [above, row, below] = &rows;
        outer.clear();
        outer.extend(above.iter().zip(row).zip(below).map(|((above, row), below)| above - 2 * row + below));
        let answers = outer.windows(3).map(|three| u32::from((three[0] - 2 * three[1] + three[2]).unsigned_abs()));
        sum += u64::from(answers.sum::<u32>());
        count += (width - 2) as u64;
    }
    // The mask's weights have 36 as the sum of their squares.
    FRAC_PI_2.sqrt() * sum as f64 / count as f64 / 6.0
}

/// `image`, smoothed if it is noisy.
pub fn denoised(image: &RgbImage) -> Cow<'_, RgbImage> {
    let noise = noise_level(image);
    if noise < NOISY { Cow::Borrowed(image) } else { Cow::Owned(blur(image, sigma_px(noise))) }
}

/// Standard deviation of the blur, pixels, that finds most in photographs with that noise: 1 at 13, 1.5 at 25.
fn sigma_px(noise: f64) -> f32 {
    (0.6 + noise / 28.0) as f32
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;
    use crate::Corruption;

    fn grey(width: u32, height: u32) -> RgbImage {
        RgbImage::from_pixel(width, height, Rgb([128; 3]))
    }

    /// Of noise that is the same in all channels, as the brightness has less of independent noise.
    fn noisy(std: f64, width: u32, height: u32) -> RgbImage {
        let noise = Corruption::GaussianNoise.applied(&grey(width, height), 1, 7);
        // Severity 1 has 0.08 of white.
        RgbImage::from_fn(width, height, |x, y| {
            let change = f64::from(noise.get_pixel(x, y)[0]) - 128.0;
            Rgb([(128.0 + change * std / (0.08 * 255.0)).round().clamp(0.0, 255.0) as u8; 3])
        })
    }

    #[test]
    fn noise_is_measured_whatever_the_size_and_structure_is_not_taken_for_it() {
        for std in [4.0, 12.0, 25.0] {
            for (width, height) in [(200, 150), (1600, 1200)] {
                let level = noise_level(&noisy(std, width, height));
                assert!((level / std - 1.0).abs() < 0.04, "{std}: {level}");
            }
        }
        // Ramps and straight edges along rows and columns vanish under the mask.
        let structured =
            RgbImage::from_fn(300, 200, |x, y| Rgb([(x / 3 + y / 4) as u8 + if x > 150 { 60 } else { 0 }; 3]));
        assert!(noise_level(&structured) < 1.0, "{}", noise_level(&structured));
    }

    #[test]
    fn what_is_clean_stays_byte_for_byte_and_what_is_noisy_gets_smoother() {
        let clean = noisy(8.0, 320, 200);
        assert!(matches!(denoised(&clean), Cow::Borrowed(same) if std::ptr::eq(same, &raw const clean)));
        let rough = noisy(25.0, 320, 200);
        let smooth = denoised(&rough);
        assert_eq!(smooth.dimensions(), rough.dimensions());
        assert!(noise_level(&smooth) < 0.2 * noise_level(&rough), "{}", noise_level(&smooth));
        let mean = |image: &RgbImage| image.as_raw().iter().map(|value| f64::from(*value)).sum::<f64>() / 192_000.0;
        assert!((mean(&smooth) - mean(&rough)).abs() < 0.6);
    }

    #[test]
    fn images_of_few_pixels_are_left_alone() {
        for (width, height) in [(0, 0), (1, 1), (2, 900), (900, 2)] {
            assert!(noise_level(&grey(width, height)) < 1e-9);
        }
        assert!(noise_level(&grey(3, 3)) < 1e-9);
        let board = RgbImage::from_fn(3, 3, |x, y| Rgb([255 * ((x + y) % 2) as u8; 3]));
        assert_eq!(denoised(&board).dimensions(), (3, 3));
    }
}

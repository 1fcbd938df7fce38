//! Images made worse on purpose: the corruptions of ImageNet-C, at its five severities.
//!
//! Parameters are those of Hendrycks and Dietterich, *Benchmarking Neural Network Robustness to Common Corruptions and
//! Perturbations* (2019), as the package `imagecorruptions` has them.

mod blur;
mod dataset;

use std::fmt::{self, Display};
use std::io::Cursor;

use image::codecs::jpeg::JpegEncoder;
use image::{ImageFormat, RgbImage};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

pub use dataset::CorruptedDataset;

/// A way to make an image worse.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Corruption {
    /// Of the sensor.
    GaussianNoise,
    /// Of a lens out of focus, as a Gaussian.
    GaussianBlur,
    /// Of a camera that moves, at a random angle within 45 degrees of level.
    MotionBlur,
    /// Too much light: a larger value of HSV.
    Brightness,
    /// Too little contrast, around the mean of each channel.
    Contrast,
    /// JPEG of a low quality.
    JpegCompression,
}

/// The severities: 1 is weak, 5 strong.
pub const SEVERITIES: [u8; 5] = [1, 2, 3, 4, 5];

impl Corruption {
    /// All of them.
    pub const ALL: [Self; 6] = [
        Self::GaussianNoise,
        Self::GaussianBlur,
        Self::MotionBlur,
        Self::Brightness,
        Self::Contrast,
        Self::JpegCompression,
    ];

    /// Its name in files and tables, ImageNet-C's.
    pub const fn name(self) -> &'static str {
        match self {
            Self::GaussianNoise => "gaussian_noise",
            Self::GaussianBlur => "gaussian_blur",
            Self::MotionBlur => "motion_blur",
            Self::Brightness => "brightness",
            Self::Contrast => "contrast",
            Self::JpegCompression => "jpeg_compression",
        }
    }

    /// `image` made worse by one of [`SEVERITIES`] (others are taken for the nearest); `seed` decides about what is
    /// random.
    pub fn applied(self, image: &RgbImage, severity: u8, seed: u64) -> RgbImage {
        let place = usize::from(severity.clamp(1, 5) - 1);
        let mut rng = Pcg64Mcg::seed_from_u64(seed);
        match self {
            Self::GaussianNoise => noisy(image, [0.08, 0.12, 0.18, 0.26, 0.38][place], &mut rng),
            Self::GaussianBlur => blur::gaussian(image, [1.0, 2.0, 3.0, 4.0, 6.0][place]),
            Self::MotionBlur => {
                let (radius, sigma) = [(10, 3.0), (15, 5.0), (15, 8.0), (15, 12.0), (20, 15.0)][place];
                blur::motion(image, radius, sigma, rng.random_range(-45.0_f64..45.0))
            }
            Self::Brightness => brighter(image, [0.1, 0.2, 0.3, 0.4, 0.5][place]),
            Self::Contrast => flatter(image, [0.4, 0.3, 0.2, 0.1, 0.05][place]),
            Self::JpegCompression => compressed(image, [25, 18, 15, 10, 7][place]),
        }
    }
}

impl Display for Corruption {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The image with each value, 0 to 1, changed by `change`, which gets the channel, too.
fn changed(image: &RgbImage, mut change: impl FnMut(usize, f64) -> f64) -> RgbImage {
    let mut out = image.clone();
    for pixel in out.pixels_mut() {
        for (channel, value) in pixel.0.iter_mut().enumerate() {
            *value = byte(change(channel, f64::from(*value) / 255.0));
        }
    }
    out
}

/// A value of 0 to 1 as a byte; what is beyond is cut, and what is between is cut off, as the reference does.
fn byte(value: f64) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0 + 1e-9) as u8
}

fn noisy(image: &RgbImage, sigma: f64, rng: &mut Pcg64Mcg) -> RgbImage {
    changed(image, |_, value| value + sigma * normal(rng))
}

/// A draw from the standard normal distribution (Box and Muller).
pub(crate) fn normal(rng: &mut Pcg64Mcg) -> f64 {
    let [first, second]: [f64; 2] = [rng.random(), rng.random()];
    (-2.0 * (1.0 - first).ln()).sqrt() * (std::f64::consts::TAU * second).cos()
}

/// HSV's value, the largest channel, grows by `more`; hue and saturation stay.
fn brighter(image: &RgbImage, more: f64) -> RgbImage {
    let mut out = image.clone();
    for pixel in out.pixels_mut() {
        let [r, g, b] = pixel.0.map(|value| f64::from(value) / 255.0);
        let value = r.max(g).max(b);
        let brighter = (value + more).min(1.0);
        // Black has no hue; it becomes grey.
        pixel.0 = [r, g, b].map(|channel| byte(if value > 0.0 { channel * brighter / value } else { brighter }));
    }
    out
}

fn flatter(image: &RgbImage, share: f64) -> RgbImage {
    let count = f64::from(image.width()) * f64::from(image.height());
    let mut means = [0.0; 3];
    for pixel in image.pixels() {
        for (mean, value) in means.iter_mut().zip(pixel.0) {
            *mean += f64::from(value) / 255.0 / count;
        }
    }
    changed(image, |channel, value| (value - means[channel]) * share + means[channel])
}

/// As it comes back from a JPEG file of this quality; as it was where the format cannot hold it.
fn compressed(image: &RgbImage, quality: u8) -> RgbImage {
    let mut file = Vec::new();
    let written = JpegEncoder::new_with_quality(&mut file, quality).encode_image(image);
    let read = written.and_then(|()| image::ImageReader::with_format(Cursor::new(file), ImageFormat::Jpeg).decode());
    read.map_or_else(|_| image.clone(), |decoded| decoded.to_rgb8())
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    /// A small image with all kinds of colours, the same as in the reference's run.
    fn image() -> RgbImage {
        RgbImage::from_fn(8, 6, |x, y| Rgb([(x * 31 + y * 3) as u8, (y * 43) as u8, (x * y * 7 % 256) as u8]))
    }

    /// Red, green and blue of pixels (0, 0), (3, 2) and (7, 5) after `imagecorruptions` 1.1.5.
    const PLACES: [(u32, u32); 3] = [(0, 0), (3, 2), (7, 5)];

    #[test]
    fn what_is_not_random_is_as_in_the_reference() {
        let reference = [
            (Corruption::GaussianBlur, 1, [[12, 15, 0], [99, 86, 42], [219, 199, 215]]),
            (Corruption::GaussianBlur, 3, [[39, 48, 9], [103, 94, 48], [192, 166, 157]]),
            (Corruption::GaussianBlur, 5, [[68, 73, 24], [108, 100, 53], [163, 141, 114]]),
            (Corruption::Brightness, 1, [[25, 25, 25], [124, 108, 52], [241, 223, 255]]),
            (Corruption::Brightness, 3, [[76, 76, 76], [175, 152, 74], [241, 223, 255]]),
            (Corruption::Brightness, 5, [[127, 127, 127], [226, 196, 96], [241, 223, 255]]),
            (Corruption::Contrast, 1, [[69, 64, 36], [109, 98, 53], [162, 150, 134]]),
            (Corruption::Contrast, 3, [[92, 86, 49], [112, 103, 57], [139, 129, 98]]),
            (Corruption::Contrast, 5, [[110, 102, 58], [115, 106, 60], [121, 112, 70]]),
        ];
        for (corruption, severity, expected) in reference {
            let found = corruption.applied(&image(), severity, 0);
            for ((x, y), expected) in PLACES.into_iter().zip(expected) {
                let pixel = found.get_pixel(x, y).0;
                let off = pixel.iter().zip(expected).map(|(a, b)| a.abs_diff(b)).max().unwrap();
                assert!(off <= 1, "{corruption} {severity} at ({x}, {y}): {pixel:?}, {expected:?}");
            }
        }
    }

    #[test]
    fn a_smear_is_that_of_the_reference() {
        // `_motion_blur(image, 10, 3, 20.0)`.
        let found = blur::motion(&image(), 10, 3.0, 20.0);
        for ((x, y), expected) in PLACES.into_iter().zip([[63, 27, 16], [156, 112, 94], [229, 212, 242]]) {
            let pixel = found.get_pixel(x, y).0;
            assert!(pixel.iter().zip(expected).all(|(a, b)| a.abs_diff(b) <= 1), "({x}, {y}): {pixel:?}, {expected:?}");
        }
    }

    #[test]
    fn noise_has_its_deviation_and_follows_the_seed() {
        let grey = RgbImage::from_pixel(128, 128, Rgb([128; 3]));
        let noisy = Corruption::GaussianNoise.applied(&grey, 1, 5);
        assert_eq!(noisy, Corruption::GaussianNoise.applied(&grey, 1, 5));
        assert_ne!(noisy, Corruption::GaussianNoise.applied(&grey, 1, 6));
        let values: Vec<f64> = noisy.as_raw().iter().map(|value| f64::from(*value) / 255.0).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let sigma = (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt();
        assert!((mean - 0.5).abs() < 0.01 && (sigma - 0.08).abs() < 0.002, "{mean} {sigma}");
    }

    #[test]
    fn every_corruption_gets_worse_with_its_severity_and_takes_any_image() {
        let smooth =
            RgbImage::from_fn(64, 48, |x, y| Rgb([(x * 3) as u8, (y * 5) as u8, ((x / 8 + y / 8) % 2 * 200) as u8]));
        let distance = |other: &RgbImage| -> u64 {
            smooth.as_raw().iter().zip(other.as_raw()).map(|(a, b)| u64::from(a.abs_diff(*b)).pow(2)).sum()
        };
        for corruption in Corruption::ALL {
            let far = |severity| distance(&corruption.applied(&smooth, severity, 1));
            assert!(far(1) > 0 && far(5) > far(1), "{corruption}: {} {}", far(1), far(5));
            for (width, height) in [(1, 1), (1, 40), (40, 1)] {
                let tiny = RgbImage::new(width, height);
                assert_eq!(corruption.applied(&tiny, 5, 1).dimensions(), (width, height), "{corruption}");
            }
        }
    }
}

//! Sharpness: more or less fine detail than an image has (torchvision's `adjust_sharpness`).
//!
//! Photographs have more of it than rendered images. A network that has only seen these sees photographed cars near by
//! too far away, the farther the more detail they have. This is to make detail say nothing about distance.

use farsight_core::input::{CHANNEL_MEAN, CHANNEL_STD};
use image::imageops::fast_blur;
use image::{ImageBuffer, Luma};
use rand::{Rng, RngExt};

/// Range of [`Sharpness::sigma_px`].
const SIGMAS_PX: [f64; 2] = [0.8, 4.0];

/// A factor on fine detail.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sharpness {
    /// Detail is what a Gaussian blur takes away that has this standard deviation, pixels of the input.
    pub sigma_px: f32,
    /// Factor on it: 0 is the blurred image, 1 changes nothing.
    pub factor: f32,
}

impl Sharpness {
    /// Draws a factor between one over `most` and `most`.
    pub fn draw(rng: &mut impl Rng, most: f64) -> Self {
        let mut between = |low: f64, high: f64| (low.ln() + (high.ln() - low.ln()) * rng.random::<f64>()).exp() as f32;
        Self { sigma_px: between(SIGMAS_PX[0], SIGMAS_PX[1]), factor: between(1.0 / most, most) }
    }

    /// Changes the normalised planes of `input` (width, height, pixels); colours stay between black and white.
    pub fn apply(&self, input: &mut [f32], [width, height]: [usize; 2]) {
        for (plane, values) in input.chunks_exact_mut(width * height).enumerate() {
            let (mean, std) = (CHANNEL_MEAN[plane], CHANNEL_STD[plane]);
            let colours: Vec<f32> = values.iter().map(|value| value * std + mean).collect();
            let Some(sharp) = ImageBuffer::<Luma<f32>, _>::from_raw(width as u32, height as u32, colours) else {
                return;
            };
            let blurred = fast_blur(&sharp, self.sigma_px);
            for ((value, sharp), blurred) in values.iter_mut().zip(sharp.iter()).zip(blurred.iter()) {
                let colour = blurred + self.factor * (sharp - blurred);
                *value = (colour.clamp(0.0, 1.0) - mean) / std;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    use super::*;

    const SIZE: [usize; 2] = [64, 32];

    /// A board of squares, two greys, 2 pixels a side, as normalised planes.
    fn board() -> Vec<f32> {
        let [width, height] = SIZE;
        let colour = |k: usize| if (k % width / 2 + k / width / 2).is_multiple_of(2) { 0.4 } else { 0.6 };
        let plane =
            |plane: usize| (0..width * height).map(move |k| (colour(k) - CHANNEL_MEAN[plane]) / CHANNEL_STD[plane]);
        (0..3).flat_map(plane).collect()
    }

    /// Mean and standard deviation of the colours of a plane.
    fn colours(input: &[f32], plane: usize) -> [f32; 2] {
        let area = SIZE[0] * SIZE[1];
        let values = &input[plane * area..(plane + 1) * area];
        let colours: Vec<f32> = values.iter().map(|value| value * CHANNEL_STD[plane] + CHANNEL_MEAN[plane]).collect();
        assert!(colours.iter().all(|colour| (-1e-5..=1.0 + 1e-5).contains(colour)));
        let mean = colours.iter().sum::<f32>() / area as f32;
        [mean, (colours.iter().map(|colour| (colour - mean).powi(2)).sum::<f32>() / area as f32).sqrt()]
    }

    #[test]
    fn the_factor_is_that_of_the_detail_and_the_mean_stays() {
        for (factor, expected) in [(0.5, 0.05), (1.0, 0.1), (2.0, 0.2)] {
            let mut input = board();
            Sharpness { sigma_px: 4.0, factor }.apply(&mut input, SIZE);
            for plane in 0..3 {
                let [mean, deviation] = colours(&input, plane);
                assert!((mean - 0.5).abs() < 0.003, "{mean}");
                assert!((deviation - expected).abs() < 0.1 * expected, "times {factor}: {deviation}");
            }
        }
    }

    #[test]
    fn what_has_no_detail_stays_and_any_draw_fits_any_size() {
        for seed in 0..200 {
            let mut rng = Pcg64Mcg::seed_from_u64(seed);
            for size in [[1, 1], [1, 7], SIZE] {
                let drawn = Sharpness::draw(&mut rng, 3.0);
                assert!((1.0 / 3.0 - 1e-6..=3.0 + 1e-6).contains(&drawn.factor));
                let mut input = vec![0.7; 3 * size[0] * size[1]];
                drawn.apply(&mut input, size);
                assert!(input.iter().all(|&value| (value - 0.7).abs() < 1e-4), "{drawn:?} {size:?} {input:?}");
            }
        }
    }
}

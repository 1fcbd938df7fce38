//! Noise, blur and motion blur, as cameras add them in the dark, out of focus and on the move.
//!
//! The trained network shall look past them. How much is lost to them is measured with
//! [`Corruption`](crate::Corruption), whose blurs and severities are others.

use std::f64::consts::TAU;

use farsight_core::input::{CHANNEL_MEAN, CHANNEL_STD};
use image::imageops::fast_blur;
use image::{ImageBuffer, Luma};
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::corruption::normal;

/// Range of the noise's standard deviation, shares of white.
const NOISE_STDS: [f64; 2] = [0.02, 0.25];

/// Range of the blur's standard deviation, pixels of the input.
const BLUR_SIGMAS_PX: [f64; 2] = [0.5, 4.0];

/// Range of the length of motion blur, pixels of the input.
const MOTION_LENGTHS_PX: [f64; 2] = [2.0, 16.0];

/// One way in which a camera makes an image worse.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Degradation {
    /// Gaussian noise, each value of each channel alone.
    Noise {
        /// Standard deviation, shares of white.
        std: f32,
        /// What the noise is drawn from.
        seed: u64,
    },
    /// A Gaussian blur.
    Blur {
        /// Standard deviation, pixels of the input.
        sigma_px: f32,
    },
    /// The mean along a line through each pixel.
    Motion {
        /// Length of the line, pixels of the input.
        length_px: f32,
        /// Its angle from level, radians.
        angle_rad: f32,
    },
}

impl Degradation {
    /// Draws one; each way has the same share.
    pub fn draw(rng: &mut impl Rng) -> Self {
        let share: f64 = rng.random();
        let between = |[low, high]: [f64; 2]| (low.ln() + (high.ln() - low.ln()) * share).exp() as f32;
        match rng.random_range(0..3) {
            0 => Self::Noise { std: between(NOISE_STDS), seed: rng.random() },
            1 => Self::Blur { sigma_px: between(BLUR_SIGMAS_PX) },
            _ => Self::Motion { length_px: between(MOTION_LENGTHS_PX), angle_rad: (rng.random::<f64>() * TAU) as f32 },
        }
    }

    /// Changes the normalised planes of `input` (width, height, pixels); colours stay between black and white.
    pub fn apply(&self, input: &mut [f32], size: [usize; 2]) {
        let mut rng = Pcg64Mcg::seed_from_u64(if let Self::Noise { seed, .. } = self { *seed } else { 0 });
        for (plane, values) in input.chunks_exact_mut(size[0] * size[1]).enumerate() {
            let (mean, std) = (CHANNEL_MEAN[plane], CHANNEL_STD[plane]);
            let colours: Vec<f32> = values.iter().map(|value| value * std + mean).collect();
            let worse = match self {
                Self::Noise { std, .. } => {
                    colours.iter().map(|colour| colour + std * normal(&mut rng) as f32).collect()
                }
                Self::Blur { sigma_px } => blurred(colours, size, *sigma_px),
                Self::Motion { length_px, angle_rad } => smeared(&colours, size, *length_px, *angle_rad),
            };
            for (value, colour) in values.iter_mut().zip(worse) {
                *value = (colour.clamp(0.0, 1.0) - mean) / std;
            }
        }
    }
}

fn blurred(colours: Vec<f32>, [width, height]: [usize; 2], sigma_px: f32) -> Vec<f32> {
    let image = ImageBuffer::<Luma<f32>, _>::from_raw(width as u32, height as u32, colours);
    image.map_or_else(Vec::new, |image| fast_blur(&image, sigma_px).into_raw())
}

/// The mean of the nearest pixels at steps of one along the line; at the border the last pixel goes on.
fn smeared(colours: &[f32], [width, height]: [usize; 2], length_px: f32, angle_rad: f32) -> Vec<f32> {
    let steps = (length_px / 2.0).round() as i64;
    let (down, across) = angle_rad.sin_cos();
    let offsets: Vec<[i64; 2]> =
        (-steps..=steps).map(|step| [across, down].map(|share| (step as f32 * share).round() as i64)).collect();
    let at = |place: i64, side: usize| place.clamp(0, side as i64 - 1) as usize;
    let mut sums = vec![0.0; colours.len()];
    for [right, below] in &offsets {
        for (y, row) in sums.chunks_exact_mut(width).enumerate() {
            let from = at(y as i64 + below, height) * width;
            for (x, sum) in row.iter_mut().enumerate() {
                *sum += colours[from + at(x as i64 + right, width)];
            }
        }
    }
    let share = 1.0 / offsets.len() as f32;
    sums.into_iter().map(|sum| sum * share).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [usize; 2] = [64, 48];
    const AREA: usize = SIZE[0] * SIZE[1];

    /// Planes of one grey but for a white column amid them.
    fn with_column() -> Vec<f32> {
        let colour = |k: usize| if k % SIZE[0] == 32 { 1.0 } else { 0.4 };
        (0..3)
            .flat_map(|plane| (0..AREA).map(move |k| (colour(k) - CHANNEL_MEAN[plane]) / CHANNEL_STD[plane]))
            .collect()
    }

    /// Colours of a plane.
    fn colours(input: &[f32], plane: usize) -> Vec<f32> {
        let values = &input[plane * AREA..(plane + 1) * AREA];
        values.iter().map(|value| value * CHANNEL_STD[plane] + CHANNEL_MEAN[plane]).collect()
    }

    fn applied(degradation: Degradation) -> Vec<Vec<f32>> {
        let mut input = with_column();
        degradation.apply(&mut input, SIZE);
        (0..3).map(|plane| colours(&input, plane)).collect()
    }

    #[test]
    fn noise_has_its_deviation_no_mean_and_differs_by_channel_and_seed() {
        let noise = |seed| applied(Degradation::Noise { std: 0.1, seed });
        let [first, other] = [noise(1), noise(2)];
        assert_eq!(first, noise(1));
        assert_ne!(first, other);
        for plane in &first {
            let changes: Vec<f32> =
                plane.iter().enumerate().filter(|(k, _)| k % SIZE[0] != 32).map(|(_, colour)| colour - 0.4).collect();
            let mean = changes.iter().sum::<f32>() / changes.len() as f32;
            let std = (changes.iter().map(|change| change * change).sum::<f32>() / changes.len() as f32).sqrt();
            // Four standard errors of 3,024 draws.
            assert!(mean.abs() < 0.0073 && (std - 0.1).abs() < 0.0052, "{mean} {std}");
        }
        assert_ne!(first[0], first[1]);
    }

    #[test]
    fn blur_keeps_the_mean_and_widens_the_column() {
        let before = applied(Degradation::Motion { length_px: 0.0, angle_rad: 0.0 });
        let after = applied(Degradation::Blur { sigma_px: 4.0 });
        let middle = |planes: &[Vec<f32>], x: usize| planes[1][24 * SIZE[0] + x];
        assert!((middle(&before, 32) - 1.0).abs() < 1e-5 && (middle(&before, 31) - 0.4).abs() < 1e-5);
        let [sum_before, sum_after] = [&before, &after].map(|planes| planes[1].iter().sum::<f32>());
        assert!((sum_before / sum_after - 1.0).abs() < 1e-3, "{sum_before} {sum_after}");
        // The column's variance is the Gaussian's; `fast_blur` comes near a Gaussian with boxes of whole pixels.
        let moment = |power: i32| -> f32 {
            (0..SIZE[0]).map(|x| (x as f32 - 32.0).powi(power) * (middle(&after, x) - 0.4) / 0.6).sum()
        };
        let (mean, variance) = (moment(1) / moment(0), moment(2) / moment(0));
        assert!(mean.abs() < 0.01 && (variance - 16.0).abs() < 3.2, "{mean} {variance}");
    }

    #[test]
    fn motion_smears_along_its_line_alone() {
        let across = applied(Degradation::Motion { length_px: 4.0, angle_rad: 0.0 });
        let row = &across[0][10 * SIZE[0]..11 * SIZE[0]];
        for (x, colour) in row.iter().enumerate() {
            let expected = if (30..=34).contains(&x) { 0.4 + 0.6 / 5.0 } else { 0.4 };
            assert!((colour - expected).abs() < 1e-5, "{x}: {colour}");
        }
        let down = applied(Degradation::Motion { length_px: 9.0, angle_rad: std::f32::consts::FRAC_PI_2 });
        for (one, other) in
            down.iter().flatten().zip(applied(Degradation::Motion { length_px: 0.0, angle_rad: 0.0 }).iter().flatten())
        {
            assert!((one - other).abs() < 1e-5);
        }
    }

    #[test]
    fn any_draw_fits_any_size_and_what_has_no_detail_stays_under_blurs() {
        for seed in 0..200 {
            let drawn = Degradation::draw(&mut Pcg64Mcg::seed_from_u64(seed));
            for [width, height] in [[1, 1], [1, 7], [9, 2], SIZE] {
                let mut input = vec![0.7; 3 * width * height];
                drawn.apply(&mut input, [width, height]);
                assert!(input.iter().all(|value| value.is_finite()));
                if !matches!(drawn, Degradation::Noise { .. }) {
                    assert!(input.iter().all(|&value| (value - 0.7).abs() < 1e-4), "{drawn:?}");
                }
            }
        }
    }
}

//! Shadows with spots of light in them, as under trees (albumentations' `RandomShadow` has polygons).
//!
//! Photographed cars often stand in shadows so deep that little but their outline is left, next to a road in the sun.
//! Rendered shadows are lighter and fall where the sun wants them. These fall anywhere.

use farsight_core::input::{CHANNEL_MEAN, CHANNEL_STD};
use rand::{Rng, RngExt};

use crate::noise_mask::NoiseMask;

/// Factors on colours in a shadow: from black to hardly any.
const BRIGHTNESS: [f64; 2] = [0.12, 0.7];

/// Thresholds and scales, pixels of the input, of the masks of shadows and of the spots of light in them.
const SHADOWS: [[f64; 2]; 2] = [[0.35, 0.65], [30.0, 400.0]];
const SPOTS: [[f64; 2]; 2] = [[0.6, 0.9], [3.0, 25.0]];

/// What is darkened where.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shadow {
    /// Factor on colours where the mask is 1.
    pub brightness: f32,
    /// Where it is dark.
    pub mask: NoiseMask,
    /// Where light falls through.
    pub spots: NoiseMask,
    /// Share of the light that falls through there, 0 to 1.
    pub spot_light: f32,
}

impl Shadow {
    /// Draws a shadow.
    pub fn draw(rng: &mut impl Rng) -> Self {
        let [darkest, lightest] = BRIGHTNESS.map(f64::ln);
        let [mask, spots] = [SHADOWS, SPOTS].map(|[thresholds, scales_px]| NoiseMask::draw(rng, thresholds, scales_px));
        Self {
            brightness: (darkest + (lightest - darkest) * rng.random::<f64>()).exp() as f32,
            mask,
            spots,
            spot_light: rng.random::<f32>().powi(2),
        }
    }

    /// Lays it over the normalised planes of `input` (width, height, pixels).
    pub fn apply(&self, input: &mut [f32], [width, height]: [usize; 2]) {
        let (mask, spots) = (self.mask.render([width, height]), self.spots.render([width, height]));
        let area = width * height;
        for y in 0..height {
            for x in 0..width {
                let depth = mask.at(x, y);
                if depth > 0.0 {
                    let depth = depth * (1.0 - self.spot_light * spots.at(x, y));
                    let factor = 1.0 - depth * (1.0 - self.brightness);
                    for plane in 0..3 {
                        let (mean, std) = (CHANNEL_MEAN[plane], CHANNEL_STD[plane]);
                        let value = &mut input[plane * area + y * width + x];
                        *value = ((*value * std + mean) * factor - mean) / std;
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    use super::*;

    const SIZE: [usize; 2] = [64, 32];

    /// Normalised planes of one grey.
    fn grey(colour: f32, [width, height]: [usize; 2]) -> Vec<f32> {
        let plane = |plane: usize| vec![(colour - CHANNEL_MEAN[plane]) / CHANNEL_STD[plane]; width * height];
        (0..3).flat_map(plane).collect()
    }

    /// The colours of normalised planes, 0 to 1.
    fn colours(input: &[f32], area: usize) -> Vec<f32> {
        let colour = |(k, value): (usize, &f32)| value * CHANNEL_STD[k / area] + CHANNEL_MEAN[k / area];
        input.iter().enumerate().map(colour).collect()
    }

    #[test]
    fn colours_in_a_shadow_have_the_factor_and_the_others_stay() {
        let mask = NoiseMask { threshold: 0.5, scale_px: 8.0, seed: 3 };
        let spots = NoiseMask { threshold: 0.5, scale_px: 4.0, seed: 4 };
        let mut input = grey(0.8, SIZE);
        Shadow { brightness: 0.25, mask, spots, spot_light: 0.0 }.apply(&mut input, SIZE);
        let found = colours(&input, SIZE[0] * SIZE[1]);
        assert!(found.iter().all(|colour| (0.2 - 1e-5..=0.8 + 1e-5).contains(colour)));
        for expected in [0.2, 0.8] {
            let count = found.iter().filter(|colour| (*colour - expected).abs() < 1e-5).count();
            assert!(count > found.len() / 5, "{expected}: {count} of {}", found.len());
        }
        // Light that falls through whole leaves no shadow where it falls, and the shadow elsewhere.
        let mut spotted = grey(0.8, SIZE);
        Shadow { brightness: 0.25, mask, spots, spot_light: 1.0 }.apply(&mut spotted, SIZE);
        let spotted = colours(&spotted, SIZE[0] * SIZE[1]);
        assert!(spotted.iter().zip(&found).all(|(a, b)| *a >= b - 1e-5));
        let lit = spotted.iter().zip(&found).filter(|(a, b)| (*a - 0.8).abs() < 1e-5 && (*b - 0.2).abs() < 1e-5);
        assert!(lit.count() > found.len() / 20);
    }

    #[test]
    fn any_draw_fits_any_size_and_never_brightens() {
        for seed in 0..200 {
            let mut rng = Pcg64Mcg::seed_from_u64(seed);
            for size in [[1, 1], [1, 7], SIZE] {
                let mut input = grey(0.6, size);
                Shadow::draw(&mut rng).apply(&mut input, size);
                let found = colours(&input, size[0] * size[1]);
                assert!(found.iter().all(|colour| (0.07..=0.6 + 1e-5).contains(colour)));
            }
        }
    }
}

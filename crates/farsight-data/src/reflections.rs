//! Reflections: regions in which another place of the same image shines through, as in paint and glass.
//!
//! An image mixed with itself, as `MixUp` mixes two, under a random mask.
//!
//! Rendered surfaces are plainer than photographed ones, and a network that has only seen plain ones sees photographed
//! cars near by too far away, as if it took their detail for that of smaller cars. This puts more than any mirror would
//! on everything, so that shapes are what is left to go by.

use rand::{Rng, RngExt};

use crate::noise_mask::NoiseMask;

/// What shines through where.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reflections {
    /// Share of the other place where the mask is 1, from 0 to 1.
    pub strength: f32,
    /// Where.
    pub mask: NoiseMask,
    /// The place that shines through the first pixel, pixels of the input.
    pub from: [f32; 2],
    /// Pixels there for one pixel here, along x and y; negative ones mirror.
    pub scale: [f32; 2],
}

impl Reflections {
    /// Draws reflections for an input of `size` (width, height, pixels), at most this strong.
    pub fn draw(rng: &mut impl Rng, size: [usize; 2], strongest: f64) -> Self {
        let mask = NoiseMask::draw(rng, [0.35, 0.65], [4.0, 60.0]);
        let mut between = |low: f64, high: f64| (low + (high - low) * rng.random::<f64>()) as f32;
        let scale = [0, 1].map(|_| between(-0.7, 1.4).exp2());
        Self {
            strength: between(0.2, 1.0) * strongest as f32,
            mask,
            from: size.map(|side| between(0.0, side as f64)),
            scale: [scale[0].copysign(between(-1.0, 1.0)), scale[1].copysign(between(-1.0, 1.0))],
        }
    }

    /// Lays them over the planes of `input` (width, height, pixels).
    pub fn apply(&self, input: &mut [f32], [width, height]: [usize; 2]) {
        let mask = self.mask.render([width, height]);
        let there: [Vec<usize>; 2] = [0, 1].map(|axis| self.places(axis, [width, height][axis]));
        let area = width * height;
        let before = input.to_vec();
        for y in 0..height {
            for x in 0..width {
                let share = self.strength * mask.at(x, y);
                if share > 0.0 {
                    let (here, there) = (y * width + x, there[1][y] * width + there[0][x]);
                    for plane in 0..3 {
                        let value = &mut input[plane * area + here];
                        *value += share * (before[plane * area + there] - *value);
                    }
                }
            }
        }
    }

    /// Which column (axis 0) or row (1) shines through each of the `count` columns or rows.
    fn places(&self, axis: usize, count: usize) -> Vec<usize> {
        let place = |here: usize| (self.from[axis] + self.scale[axis] * here as f32).rem_euclid(count as f32) as usize;
        (0..count).map(|here| place(here).min(count - 1)).collect()
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    use super::*;

    const SIZE: [usize; 2] = [64, 32];

    fn ramp() -> Vec<f32> {
        (0..3 * SIZE[0] * SIZE[1]).map(|k| ((k * 37) % 101) as f32).collect()
    }

    fn reflections() -> Reflections {
        let mask = NoiseMask { threshold: 0.5, scale_px: 8.0, seed: 3 };
        Reflections { strength: 0.5, mask, from: [10.0, 31.0], scale: [1.0, -1.0] }
    }

    #[test]
    fn patches_hold_the_share_of_the_other_place_and_the_rest_stays() {
        let (before, mut after) = (ramp(), ramp());
        reflections().apply(&mut after, SIZE);
        let area = SIZE[0] * SIZE[1];
        let mut counts = [0; 2];
        for k in 0..area {
            let (x, y) = (k % SIZE[0], k / SIZE[0]);
            let there = (SIZE[1] - 1 - y) * SIZE[0] + (x + 10) % SIZE[0];
            let shares: Vec<f32> = (0..3)
                .map(|plane| plane * area)
                .filter(|plane| (before[plane + there] - before[plane + k]).abs() > 1.0)
                .map(|plane| (after[plane + k] - before[plane + k]) / (before[plane + there] - before[plane + k]))
                .collect();
            assert!(shares.iter().all(|share| (-1e-5..=0.5 + 1e-5).contains(share)), "{shares:?}");
            assert!(shares.windows(2).all(|pair| (pair[0] - pair[1]).abs() < 1e-4), "{shares:?}");
            if let Some(&share) = shares.first() {
                counts[0] += usize::from(share < 1e-6);
                counts[1] += usize::from(share > 0.5 - 1e-5);
            }
        }
        assert!(counts.iter().all(|&count| count > area / 5), "{counts:?} of {area}");
    }

    #[test]
    fn of_no_strength_they_change_nothing_and_any_draw_fits_any_size() {
        let mut input = ramp();
        Reflections { strength: 0.0, ..reflections() }.apply(&mut input, SIZE);
        assert_eq!(input, ramp());
        for seed in 0..200 {
            let mut rng = Pcg64Mcg::seed_from_u64(seed);
            for size in [[1, 1], [1, 7], SIZE] {
                let drawn = Reflections::draw(&mut rng, size, 0.6);
                assert!((0.0..=0.6).contains(&drawn.strength));
                let mut input = vec![1.0; 3 * size[0] * size[1]];
                drawn.apply(&mut input, size);
                assert!(input.iter().all(|&value| (value - 1.0).abs() < 1e-6));
            }
        }
    }
}

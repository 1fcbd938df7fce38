//! Patches in which another place of the same image shines through, as in paint and glass.
//!
//! Rendered surfaces are plainer than photographed ones, and a network that has only seen plain ones sees photographed cars near by too far away, as if it
//! took their detail for that of smaller cars. This puts more than any mirror would on everything, so that shapes are what is left to go by.

use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// How wide the edge of a patch is, in units of the noise that makes the patches.
const EDGE: f32 = 0.06;

/// What shines through where.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reflections {
    /// Share of the other place in the middle of a patch, 0 to 1.
    pub strength: f32,
    /// Patches are where smooth noise (0 to 1) is above this.
    pub level: f32,
    /// About how large patches are, pixels of the input.
    pub patch_px: f32,
    /// The place that shines through the first pixel, pixels of the input.
    pub from: [f32; 2],
    /// Pixels there for one pixel here, along x and y; negative ones mirror.
    pub scale: [f32; 2],
    /// Seed of the noise.
    pub seed: u64,
}

impl Reflections {
    /// Draws reflections for an input of `size` (width, height, pixels), at most this strong.
    pub fn draw(rng: &mut impl Rng, size: [usize; 2], strongest: f64) -> Self {
        let mut between = |low: f64, high: f64| (low + (high - low) * rng.random::<f64>()) as f32;
        let scale = [0, 1].map(|_| between(-0.7, 1.4).exp2());
        Self {
            strength: between(0.2, 1.0) * strongest as f32,
            level: between(0.35, 0.65),
            patch_px: between(4f64.ln(), 60f64.ln()).exp(),
            from: size.map(|side| between(0.0, side as f64)),
            scale: [scale[0].copysign(between(-1.0, 1.0)), scale[1].copysign(between(-1.0, 1.0))],
            seed: rng.random(),
        }
    }

    /// Lays them over the planes of `input` (width, height, pixels).
    pub fn apply(&self, input: &mut [f32], [width, height]: [usize; 2]) {
        let patches = Patches::new(self, [width, height]);
        let there: [Vec<usize>; 2] = [0, 1].map(|axis| self.places(axis, [width, height][axis]));
        let area = width * height;
        let before = input.to_vec();
        for y in 0..height {
            for x in 0..width {
                let share = self.strength * patches.at(x, y);
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

/// Smooth noise over the image: random numbers on a grid, interpolated.
struct Patches {
    grid: Vec<f32>,
    columns: usize,
    pitch: f32,
    level: f32,
}

impl Patches {
    fn new(reflections: &Reflections, size: [usize; 2]) -> Self {
        let pitch = reflections.patch_px.max(1.0);
        let [columns, rows] = size.map(|side| (side as f32 / pitch) as usize + 2);
        let mut rng = Pcg64Mcg::seed_from_u64(reflections.seed);
        let grid = (0..columns * rows).map(|_| rng.random()).collect();
        Self { grid, columns, pitch, level: reflections.level }
    }

    /// How much of a patch covers a pixel, 0 to 1.
    fn at(&self, x: usize, y: usize) -> f32 {
        let [(column, across), (row, down)] = [x, y].map(|place| {
            let place = place as f32 / self.pitch;
            let part = place.fract();
            (place as usize, part * part * (3.0 - 2.0 * part))
        });
        let value = |column: usize, row: usize| self.grid[row * self.columns + column];
        let mix = |a: f32, b: f32, share: f32| a + (b - a) * share;
        let upper = mix(value(column, row), value(column + 1, row), across);
        let lower = mix(value(column, row + 1), value(column + 1, row + 1), across);
        ((mix(upper, lower, down) - self.level) / EDGE + 0.5).clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [usize; 2] = [64, 32];

    fn ramp() -> Vec<f32> {
        (0..3 * SIZE[0] * SIZE[1]).map(|k| ((k * 37) % 101) as f32).collect()
    }

    fn reflections() -> Reflections {
        Reflections { strength: 0.5, level: 0.5, patch_px: 8.0, from: [10.0, 31.0], scale: [1.0, -1.0], seed: 3 }
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

//! Patches of an image, at random, with soft edges.

use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// How wide the edge of a patch is, in units of the noise that makes the patches.
const EDGE: f32 = 0.06;

/// Where patches lie.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Patches {
    /// They are where smooth noise (0 to 1) is above this.
    pub level: f32,
    /// About how large they are, pixels of the input.
    pub size_px: f32,
    /// Seed of the noise.
    pub seed: u64,
}

impl Patches {
    /// Draws patches with a level and a size, pixels, in these ranges. Above a level of one half lies about half an image.
    pub fn draw(rng: &mut impl Rng, levels: [f64; 2], sizes_px: [f64; 2]) -> Self {
        let mut between = |[low, high]: [f64; 2]| (low + (high - low) * rng.random::<f64>()) as f32;
        let (level, size_px) = (between(levels), between(sizes_px.map(f64::ln)).exp());
        Self { level, size_px, seed: rng.random() }
    }

    /// The patches of an image of `size` (width, height, pixels).
    pub fn over(&self, size: [usize; 2]) -> PatchMap {
        let pitch = self.size_px.max(1.0);
        let [columns, rows] = size.map(|side| (side as f32 / pitch) as usize + 2);
        let mut rng = Pcg64Mcg::seed_from_u64(self.seed);
        let grid = (0..columns * rows).map(|_| rng.random()).collect();
        PatchMap { grid, columns, pitch, level: self.level }
    }
}

/// Smooth noise over an image: random numbers on a grid, interpolated.
#[derive(Debug)]
pub struct PatchMap {
    grid: Vec<f32>,
    columns: usize,
    pitch: f32,
    level: f32,
}

impl PatchMap {
    /// How much of a patch covers a pixel, 0 to 1.
    pub fn at(&self, x: usize, y: usize) -> f32 {
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

//! Random soft-edged masks: value noise cut at a threshold.

use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// How wide the soft edge of a region is, in units of the noise.
const EDGE: f32 = 0.06;

/// A random mask of about as many regions as an image has room for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseMask {
    /// The mask is 1 where smooth noise (0 to 1) is above this.
    pub threshold: f32,
    /// About how large its regions are, pixels of the input.
    pub scale_px: f32,
    /// Seed of the noise.
    pub seed: u64,
}

impl NoiseMask {
    /// Draws a threshold and a scale, pixels, from these ranges. Above a threshold of one half lies about half an
    /// image.
    pub fn draw(rng: &mut impl Rng, thresholds: [f64; 2], scales_px: [f64; 2]) -> Self {
        let mut between = |[low, high]: [f64; 2]| (low + (high - low) * rng.random::<f64>()) as f32;
        let (threshold, scale_px) = (between(thresholds), between(scales_px.map(f64::ln)).exp());
        Self { threshold, scale_px, seed: rng.random() }
    }

    /// The mask of an image of `size` (width, height, pixels).
    pub fn render(&self, size: [usize; 2]) -> RenderedMask {
        let pitch = self.scale_px.max(1.0);
        let [columns, rows] = size.map(|side| (side as f32 / pitch) as usize + 2);
        let mut rng = Pcg64Mcg::seed_from_u64(self.seed);
        let grid = (0..columns * rows).map(|_| rng.random()).collect();
        RenderedMask { grid, columns, pitch, threshold: self.threshold }
    }
}

/// A mask over an image: random numbers on a grid, interpolated.
#[derive(Debug)]
pub struct RenderedMask {
    grid: Vec<f32>,
    columns: usize,
    pitch: f32,
    threshold: f32,
}

impl RenderedMask {
    /// The mask at a pixel, 0 to 1.
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
        ((mix(upper, lower, down) - self.threshold) / EDGE + 0.5).clamp(0.0, 1.0)
    }
}

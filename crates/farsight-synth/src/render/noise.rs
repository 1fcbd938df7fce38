//! Value noise from hashed whole numbers: the same bits everywhere.

use crate::vector::{floor, log2};

/// Noise in the plane.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Noise {
    /// Size of the largest features.
    pub(crate) scale: f32,
    /// Each has features half the size and strength of the one before; at most 5.
    pub(crate) octaves: u32,
    /// Which noise.
    pub(crate) seed: u32,
}

/// A well-mixed number from a cell of the plane.
#[inline]
pub(crate) fn hash(x: i32, y: i32, seed: u32) -> u32 {
    mixed((x as u32).wrapping_mul(0x8da6_b343) ^ (y as u32).wrapping_mul(0xd816_3841) ^ seed.wrapping_mul(0xcb1a_b31f))
}

#[inline]
const fn mixed(mut h: u32) -> u32 {
    h = (h ^ (h >> 16)).wrapping_mul(0x7feb_352d);
    h = (h ^ (h >> 15)).wrapping_mul(0x846c_a68b);
    h ^ (h >> 16)
}

/// A hash as a number in `[0, 1)`.
#[inline]
pub(crate) const fn unit(hash: u32) -> f32 {
    (hash >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// Side of the table of random values; noise repeats after as many cells.
const SIDE: usize = 64;

/// Random values in `[-0.5, 0.5)`: reading them is several times faster than hashing.
static VALUES: [[f32; SIDE]; SIDE] = values();

const fn values() -> [[f32; SIDE]; SIDE] {
    let mut values = [[0.0; SIDE]; SIDE];
    let mut y = 0;
    while y < SIDE {
        let mut x = 0;
        while x < SIDE {
            values[y][x] = unit(mixed((y * SIDE + x) as u32 + 1)) - 0.5;
            x += 1;
        }
        y += 1;
    }
    values
}

/// Strength of the first octave with which the strengths of so many octaves sum to 1.
const FIRST_STRENGTH: [f32; 6] = [1.0, 1.0, 2.0 / 3.0, 4.0 / 7.0, 8.0 / 15.0, 16.0 / 31.0];

/// One octave with cells of size 1, in `[-0.5, 0.5]`.
#[inline]
fn octave(x: f32, y: f32, seed: u32) -> f32 {
    let (ix, iy) = (floor(x), floor(y));
    let (fx, fy) = (x - ix as f32, y - iy as f32);
    let (sx, sy) = (fx * fx * (3.0 - 2.0 * fx), fy * fy * (3.0 - 2.0 * fy));
    // Another seed starts elsewhere in the table.
    let column = (ix as u32).wrapping_add(seed) as usize;
    let row = (iy as u32).wrapping_add(seed >> 8) as usize;
    let (upper, lower) = (&VALUES[row % SIDE], &VALUES[(row + 1) % SIDE]);
    let (left, right) = (column % SIDE, (column + 1) % SIDE);
    let (a, b, c, d) = (upper[left], upper[right], lower[left], lower[right]);
    let (top, bottom) = (a + (b - a) * sx, c + (d - c) * sx);
    top + (bottom - top) * sy
}

impl Noise {
    /// The noise at a place, between -0.5 and 0.5 with mean 0; features smaller than `footprint` are left out.
    #[inline]
    pub(crate) fn at(&self, uv: [f32; 2], footprint: f32) -> f32 {
        let mut cells = 1.0 / self.scale;
        let mut strength = FIRST_STRENGTH[self.octaves as usize];
        let mut sum = 0.0;
        let mut seed = self.seed.wrapping_mul(0x9e37_79b9);
        for _ in 0..self.octaves {
            let shown = 2.0 - 2.0 * footprint * cells;
            if shown <= 0.0 {
                break;
            }
            sum += octave(uv[0] * cells, uv[1] * cells, seed >> 8) * (strength * shown.min(1.0));
            cells *= 2.03;
            strength *= 0.5;
            seed = seed.wrapping_add(0x3c6e_f372);
        }
        sum
    }

    /// The value below which this share of the noise lies, 0 to 1; of two octaves, roughly.
    pub(crate) fn quantile(share: f32) -> f32 {
        // The logistic function is close to the integral of a normal distribution.
        let share = share.clamp(1e-4, 1.0 - 1e-4);
        log2(share / (1.0 - share)) * (TWO_OCTAVES_DEVIATION / (1.702 * std::f32::consts::LOG2_E))
    }
}

/// Standard deviation of noise of two octaves; of more it is a little less.
pub(crate) const TWO_OCTAVES_DEVIATION: f32 = 0.162;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_centred_and_its_quantiles_are_about_right() {
        let noise = Noise { scale: 1.0, octaves: 2, seed: 7 };
        let values: Vec<f32> =
            (0..40_000).map(|i| noise.at([(i % 200) as f32 * 0.37, (i / 200) as f32 * 0.37], 0.0)).collect();
        let mean = values.iter().sum::<f32>() / values.len() as f32;
        let deviation = (values.iter().map(|v| (v - mean) * (v - mean)).sum::<f32>() / values.len() as f32).sqrt();
        assert!((deviation / TWO_OCTAVES_DEVIATION - 1.0).abs() < 0.05, "deviation {deviation}");
        assert!(mean.abs() < 0.02, "mean {mean}");
        for share in [0.2, 0.5, 0.8] {
            let below = values.iter().filter(|&&v| v < Noise::quantile(share)).count() as f32 / values.len() as f32;
            assert!((below - share).abs() < 0.04, "{below} of the plane is below the quantile {share}");
        }
    }

    #[test]
    fn features_smaller_than_a_pixel_are_not_there() {
        let noise = Noise { scale: 1.0, octaves: 4, seed: 7 };
        assert_eq!(noise.at([0.3, 0.4], 1.0), 0.0);
        assert_ne!(noise.at([0.3, 0.4], 0.4), 0.0);
    }
}

//! Value noise from hashed whole numbers: the same bits everywhere.

use wide::{bytemuck::cast, i32x4, u32x4};

use super::lanes::{Lanes, all, clamp, floor, integers};
use crate::vector::log2;

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

/// [`hash`] of four cells, as numbers in `[0, 1)`.
#[inline]
pub(crate) fn units(x: i32x4, y: i32x4, seed: u32) -> Lanes {
    let hashes = x.to_array().into_iter().zip(y.to_array()).map(|(x, y)| unit(hash(x, y, seed)));
    let mut units = [0.0; 4];
    for (unit, hash) in units.iter_mut().zip(hashes) {
        *unit = hash;
    }
    units.into()
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

/// Side of the table of random values; an octave repeats after as many cells.
const SIDE: usize = 32;

/// The random values in `[-0.5, 0.5)` at the four corners of each cell: reading them is several times faster than
/// hashing.
static CORNERS: [[f32; 4]; SIDE * SIDE] = corners();

const fn corners() -> [[f32; 4]; SIDE * SIDE] {
    let mut corners = [[0.0; 4]; SIDE * SIDE];
    let mut cell = 0;
    while cell < SIDE * SIDE {
        let (x, y) = (cell % SIDE, cell / SIDE);
        let mut corner = 0;
        while corner < 4 {
            let at = (y + corner / 2) % SIDE * SIDE + (x + corner % 2) % SIDE;
            corners[cell][corner] = unit(mixed(at as u32 + 1)) - 0.5;
            corner += 1;
        }
        cell += 1;
    }
    corners
}

/// Strength of the first octave with which the strengths of so many octaves sum to 1.
const FIRST_STRENGTH: [f32; 6] = [1.0, 1.0, 2.0 / 3.0, 4.0 / 7.0, 8.0 / 15.0, 16.0 / 31.0];

/// One octave with cells of size 1, in `[-0.5, 0.5]`.
#[inline]
fn octave(x: Lanes, y: Lanes, seed: u32) -> Lanes {
    let (left, top) = (floor(x), floor(y));
    let (fx, fy) = (x - left, y - top);
    let smooth = |f: Lanes| f * f * (all(3.0) - all(2.0) * f);
    let (sx, sy) = (smooth(fx), smooth(fy));
    // Another seed starts elsewhere in the table.
    let last = i32x4::splat(SIDE as i32 - 1);
    let column = (integers(left) + i32x4::splat((seed & 0xffff) as i32)) & last;
    let row = (integers(top) + i32x4::splat((seed >> 16) as i32)) & last;
    let [i, j, k, l] = (row * i32x4::splat(SIDE as i32) + column).to_array();
    let at = |cell: i32| Lanes::from(CORNERS[cell as usize % (SIDE * SIDE)]);
    let [a, b, c, d] = Lanes::transpose([at(i), at(j), at(k), at(l)]);
    let (upper, lower) = (a + (b - a) * sx, c + (d - c) * sx);
    upper + (lower - upper) * sy
}

impl Noise {
    /// The noise at four places, between -0.5 and 0.5 with mean 0; features smaller than `footprint` are left out.
    #[inline]
    pub(crate) fn at(&self, [u, v]: [Lanes; 2], footprint: Lanes) -> Lanes {
        let mut cells = 1.0 / self.scale;
        let mut strength = FIRST_STRENGTH[self.octaves as usize];
        let mut sum = Lanes::ZERO;
        let mut seed = mixed(self.seed);
        for _ in 0..self.octaves {
            let shown = clamp(all(2.0) - footprint * all(2.0 * cells), 0.0, 1.0);
            if shown.simd_gt(Lanes::ZERO).to_bitmask() == 0 {
                break;
            }
            sum += octave(u * all(cells), v * all(cells), seed) * (shown * all(strength));
            cells *= 2.03;
            strength *= 0.5;
            seed = seed.wrapping_mul(0x9e37_79b1).rotate_left(9);
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

/// Size of the grains of asphalt, plaster and stone.
const GRAIN: f32 = 0.02;

/// Fine grain, between -0.5 and 0.5 with mean 0, that gets fainter where a pixel covers many grains.
///
/// A level road far away is seen at a grazing angle: pixels that cover many grains along it still cover few across. So
/// the grains are stretched, in each direction by a power of two, to about the pixel's extent, and lose the strength
/// that the mean over so many would.
#[inline]
pub(crate) fn grain([u, v]: [Lanes; 2], [across, along]: [Lanes; 2], seed: u32) -> Lanes {
    let (wide, long) = (power_above(across * all(2.0 / GRAIN)), power_above(along * all(2.0 / GRAIN)));
    let cells = |at: Lanes, stretch: Lanes| at * all(1.0 / GRAIN) / stretch;
    octave(cells(u, wide), cells(v, long), mixed(seed)) / (wide * long).sqrt()
}

/// The power of two above `x`, at least 1 and at most a million.
#[inline]
fn power_above(x: Lanes) -> Lanes {
    let bits: i32x4 = cast(clamp(x, 0.5, 500_000.0));
    let exponent = (bits & i32x4::splat(0x7f80_0000)) + i32x4::splat(0x0080_0000);
    cast(exponent)
}

/// Standard deviation of noise of two octaves; of more it is a little less.
pub(crate) const TWO_OCTAVES_DEVIATION: f32 = 0.162;

/// A mask from the lowest four bits of a number.
#[inline]
pub(crate) fn mask(bits: u32) -> Lanes {
    let each = u32x4::from([1, 2, 4, 8]);
    cast((u32x4::splat(bits) & each).simd_eq(each))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_centred_and_its_quantiles_are_about_right() {
        let noise = Noise { scale: 1.0, octaves: 2, seed: 7 };
        let place = |i: i32| [all((i % 200) as f32 * 0.37), all((i / 200) as f32 * 0.37)];
        let values: Vec<f32> = (0..40_000).map(|i| noise.at(place(i), Lanes::ZERO).to_array()[0]).collect();
        let mean = values.iter().sum::<f32>() / values.len() as f32;
        let deviation = (values.iter().map(|v| (v - mean) * (v - mean)).sum::<f32>() / values.len() as f32).sqrt();
        assert!((deviation / TWO_OCTAVES_DEVIATION - 1.0).abs() < 0.05, "deviation {deviation}");
        assert!(mean.abs() < 0.02, "mean {mean}");
        for share in [0.2, 0.5, 0.8] {
            let below = values.iter().filter(|&&v| v < Noise::quantile(share)).count() as f32 / values.len() as f32;
            assert!((below - share).abs() < 0.05, "{below} of the plane is below the quantile {share}");
        }
    }

    #[test]
    fn features_smaller_than_a_pixel_are_not_there() {
        let noise = Noise { scale: 1.0, octaves: 4, seed: 7 };
        let at = |footprint: f32| noise.at([all(0.3), all(0.4)], all(footprint)).to_array()[0];
        assert!(at(1.0).abs() < 1e-9 && at(0.4).abs() > 1e-3);
    }

    #[test]
    fn grain_is_stretched_by_powers_of_two_and_gets_fainter() {
        for (x, power) in [(0.0, 1.0), (0.9, 1.0), (1.0, 2.0), (3.9, 4.0), (4.0, 8.0), (1e9, 524_288.0)] {
            assert!((power_above(all(x)).to_array()[0] - power).abs() < 1e-6, "above {x}");
        }
        let spread = |footprint: [f32; 2]| {
            let at =
                |i: i32| grain([all(i as f32 * 0.011), all(i as f32 * 0.017)], footprint.map(all), 3).to_array()[0];
            (0..5000).map(|i| at(i) * at(i)).sum::<f32>().sqrt()
        };
        let ratio = spread([0.5 * GRAIN * 0.9, 0.5 * GRAIN * 7.9]) / spread([0.5 * GRAIN * 0.9; 2]);
        assert!((ratio - 0.125_f32.sqrt()).abs() < 0.05, "eight grains long: {ratio}");
    }

    #[test]
    fn masks_have_their_bits() {
        for bits in 0..16 {
            assert_eq!(mask(bits).to_bitmask(), bits);
        }
    }
}

//! Comparing engines: a fixed input, and how far two answers are apart.

use farsight_core::HeadMaps;
use farsight_net::graph::{LOGITS, REGRESSION};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Any number will do, as long as it is always the same.
const SEED: u64 = 4;

/// About the range of a normalised image.
const RANGE: f32 = 2.0;

/// An input of `size` (width, height) pixels, planar `[3, height, width]`: noise, the same every time and everywhere.
pub fn input([width, height]: [usize; 2]) -> Vec<f32> {
    let mut rng = Pcg64Mcg::seed_from_u64(SEED);
    (0..3 * width * height).map(|_| rng.random_range(-RANGE..=RANGE)).collect()
}

/// How far two answers are apart in one map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Difference {
    /// The map.
    pub name: &'static str,
    /// The largest absolute difference; infinite where the sizes differ or one value is not a number.
    pub largest: f32,
}

impl Difference {
    /// Whether the maps are the same up to `tolerance`.
    pub fn within(&self, tolerance: f32) -> bool {
        self.largest <= tolerance
    }
}

/// Differences of the heat map's logits and of the regression maps.
pub fn differences(found: &HeadMaps, expected: &HeadMaps) -> Vec<Difference> {
    let pairs = [(LOGITS, &found.logits, &expected.logits), (REGRESSION, &found.regression, &expected.regression)];
    pairs.map(|(name, found, expected)| Difference { name, largest: largest_difference(found, expected) }).into()
}

/// The largest absolute difference; infinite where the lengths differ or a value is not a number.
pub fn largest_difference(found: &[f32], expected: &[f32]) -> f32 {
    if found.len() != expected.len() {
        return f32::INFINITY;
    }
    let apart = |(a, b): (&f32, &f32)| if (a - b).is_nan() { f32::INFINITY } else { (a - b).abs() };
    found.iter().zip(expected).map(apart).fold(0.0, f32::max)
}

#[cfg(test)]
mod tests {
    use super::{input, largest_difference};

    #[test]
    fn noise_is_always_the_same() {
        let noise = input([32, 32]);
        assert_eq!(noise, input([32, 32]));
        assert!(noise.iter().any(|v| *v > 1.9) && noise.iter().any(|v| *v < -1.9));
    }

    #[test]
    fn what_cannot_be_compared_is_infinitely_far_apart() {
        let table = [
            (vec![1.0, 2.0], vec![1.0, 2.5], 0.5),
            (vec![1.0], vec![1.0, 2.0], f32::INFINITY),
            (vec![f32::NAN], vec![f32::NAN], f32::INFINITY),
            (vec![f32::INFINITY], vec![f32::INFINITY], f32::INFINITY),
        ];
        for (a, b, expected) in table {
            assert_eq!(largest_difference(&a, &b), expected, "{a:?} {b:?}");
        }
    }
}

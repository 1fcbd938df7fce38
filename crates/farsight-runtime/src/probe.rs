//! Comparing engines: a fixed input, and how far two answers are apart.

use farsight_onnx::TensorInfo;
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64Mcg;

use crate::Tensor;

/// Any number will do, as long as it is always the same.
const SEED: u64 = 4;

/// Width and height of the fixed input, pixels: every level has several rows and columns, and not equally many, so that
/// exchanged axes show.
pub const SIZE: [usize; 2] = [128, 64];

/// An input of `size` (width, height) pixels, planar `[3, height, width]`: noise, the same every time and everywhere,
/// with the mean and deviation that normalisation gives to images.
pub fn input([width, height]: [usize; 2]) -> Vec<f32> {
    noise(3 * width * height)
}

/// As [`input()`], for an input of `channels`: `[1, channels, height, width]`.
pub fn tensor(channels: usize, [width, height]: [usize; 2]) -> Tensor {
    Tensor { shape: vec![1, channels, height, width], values: noise(channels * width * height) }
}

fn noise(count: usize) -> Vec<f32> {
    let mut rng = Pcg64Mcg::seed_from_u64(SEED);
    (0..count).map(|_| rng.sample(StandardNormal)).collect()
}

/// How far two answers are apart in one map.
#[derive(Debug, Clone, PartialEq)]
pub struct Difference {
    /// The output.
    pub name: String,
    /// The largest absolute difference; infinite where the sizes differ or one value is not a number.
    pub largest: f32,
    /// The largest absolute value expected.
    pub scale: f32,
}

impl Difference {
    /// Whether the maps are the same up to `tolerance`: absolute for values up to 1, and relative to the largest value
    /// beyond, because single precision rounds relative to what it rounds.
    pub fn within(&self, tolerance: f32) -> bool {
        self.largest <= tolerance * self.scale.max(1.0)
    }
}

/// Differences of the outputs called `names`; an output that one side lacks is infinitely far off.
pub fn differences(names: &[TensorInfo], found: &[Tensor], expected: &[Tensor]) -> Vec<Difference> {
    let difference = |(index, output): (usize, &TensorInfo)| {
        let values = |tensors: &[Tensor]| tensors.get(index).map_or_else(Vec::new, |tensor| tensor.values.clone());
        let (found, expected) = (values(found), values(expected));
        Difference {
            name: output.name.clone(),
            largest: largest_difference(&found, &expected),
            scale: expected.iter().fold(0.0, |largest, value| value.abs().max(largest)),
        }
    };
    names.iter().enumerate().map(difference).collect()
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
#[allow(clippy::float_cmp, reason = "these values are exact")]
mod tests {
    use super::{input, largest_difference};

    #[test]
    fn noise_is_always_the_same() {
        let noise = input([32, 32]);
        assert_eq!(noise, input([32, 32]));
        let mean = noise.iter().sum::<f32>() / noise.len() as f32;
        assert!(mean.abs() < 0.1 && noise.iter().any(|v| *v > 1.9), "{mean}");
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

//! Eight bits for a range of numbers, and numbers in those eight bits.

/// Steps from the lowest to the highest of 256 values.
const STEPS: f32 = 255.0;

/// A bias of more steps than this makes the steps of its channel longer: sums are kept in 32 bits.
const MAX_BIAS: f64 = (1_u64 << 30) as f64;

/// The numbers that 8 bits stand for: from `low` to `high` in 255 equal steps, zero exactly among them.
///
/// Zero must be exact because maps are padded with it, and because `ReLU` is then nothing but the lower end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    low: f32,
    high: f32,
}

impl Range {
    /// From `low` to `high`, widened so that it contains zero. A range of zeros only, or of what is no number, becomes
    /// 0 to 1.
    pub fn new(low: f32, high: f32) -> Self {
        let (low, high) = (low.min(0.0), high.max(0.0));
        let sound = low.is_finite() && high.is_finite() && (high - low).is_normal();
        if sound { Self { low, high } } else { Self { low: 0.0, high: 1.0 } }
    }

    /// Both ends.
    pub fn ends(&self) -> [f32; 2] {
        [self.low, self.high]
    }

    /// The smallest range that contains both.
    pub fn joined(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// Length of a step.
    pub fn scale(&self) -> f32 {
        (self.high - self.low) / STEPS
    }

    /// Which of the 256 values is zero.
    pub fn zero_point(&self) -> u8 {
        // A float becomes the nearest number that a byte can hold.
        (-self.low / self.scale()).round_ties_even() as u8
    }

    /// The number that stands for `x`: the nearest, or the end beyond which `x` lies.
    pub fn rounded(&self, x: f32) -> f32 {
        let zero = f32::from(self.zero_point());
        let step = ((x / self.scale()).round_ties_even() + zero).clamp(0.0, STEPS);
        (step - zero) * self.scale()
    }
}

/// Which 8-bit numbers the weights take; symmetric, so -128 is none of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum WeightRange {
    /// -127 to 127.
    #[default]
    Full,
    /// -63 to 63, ONNX Runtime's `reduce_range`: the sum of two products with unsigned bytes fits into 16 bits, in
    /// which x86 CPUs without VNNI add them and cut off what goes beyond.
    Reduced,
}

impl WeightRange {
    /// What this CPU computes rightly.
    pub fn of_this_cpu() -> Self {
        #[cfg(target_arch = "x86_64")]
        if !is_x86_feature_detected!("avx512vnni") && !is_x86_feature_detected!("avxvnni") {
            return Self::Reduced;
        }
        Self::Full
    }

    fn largest(self) -> f32 {
        match self {
            Self::Full => 127.0,
            Self::Reduced => 63.0,
        }
    }
}

/// Weight and bias of a convolution in 8 and 32 bits, with a step for each channel.
#[derive(Debug, Clone, PartialEq)]
pub struct QuantizedWeights {
    /// As many as there were weights, in the numbers of a [`WeightRange`]; zero is 0.
    pub values: Vec<i8>,
    /// Length of a step of each output channel.
    pub scales: Vec<f32>,
    /// The biases in steps of [`Self::bias_scales`].
    pub bias: Vec<i32>,
    /// Length of a step of each bias: that of the input times that of the weights, so that it is added to the sums as
    /// they are.
    pub bias_scales: Vec<f32>,
}

impl QuantizedWeights {
    /// The weights `[out, in, k, k]` and the biases `[out]` (or none) of a convolution whose input has steps of
    /// `input_scale`.
    pub fn new(weight: &[f32], bias: &[f32], channels: usize, input_scale: f32, range: WeightRange) -> Self {
        let rows = weight.chunks_exact((weight.len() / channels.max(1)).max(1));
        let scales: Vec<f32> =
            rows.clone().enumerate().map(|(i, row)| channel_scale(row, bias.get(i), input_scale, range)).collect();
        let mut values = Vec::with_capacity(weight.len());
        for (row, scale) in rows.zip(&scales) {
            values.extend(row.iter().map(|value| nearest(value / scale)));
        }
        let bias_scales: Vec<f32> = scales.iter().map(|scale| scale * input_scale).collect();
        let bias = bias.iter().zip(&bias_scales).map(|(b, s)| (f64::from(*b) / f64::from(*s)).round() as i32).collect();
        Self { values, scales, bias, bias_scales }
    }
}

/// The nearest whole number, of two the even one, to a number that is no larger than a weight can be. All x86 CPUs do
/// this for many numbers at once; what rounds any number is a call for each of them.
fn nearest(step: f32) -> i8 {
    /// Here the numbers of single precision are 1 apart.
    const SHIFT: f32 = 1.5 * (1 << 23) as f32;
    ((step + SHIFT) - SHIFT) as i8
}

/// The shortest step that reaches the largest weight of a channel and its bias. A channel of zeros gets steps of 1.
fn channel_scale(row: &[f32], bias: Option<&f32>, input_scale: f32, range: WeightRange) -> f32 {
    let largest = row.iter().fold(0.0_f32, |largest, value| largest.max(value.abs()));
    let for_bias = bias.map_or(0.0, |bias| f64::from(bias.abs()) / (f64::from(input_scale) * MAX_BIAS));
    let scale = (largest / range.largest()).max(for_bias as f32);
    if scale.is_normal() { scale } else { 1.0 }
}

#[cfg(test)]
#[allow(clippy::float_cmp, reason = "these values are exact")]
mod tests {
    use proptest::prelude::*;

    use super::{QuantizedWeights, Range, WeightRange, nearest};

    #[test]
    fn the_nearest_whole_number_is_that_of_the_standard_library() {
        for step in (-8128..=8128).map(|sixtyfourth| sixtyfourth as f32 / 64.0) {
            assert_eq!(f32::from(nearest(step)), step.round_ties_even(), "{step}");
        }
    }

    proptest! {
        #[test]
        fn zero_is_exact_and_the_rest_within_half_a_step(low in -50.0_f32..50.0, span in 1e-3_f32..50.0, share in 0.0_f32..1.0) {
            let range = Range::new(low, low + span);
            let [low, high] = range.ends();
            prop_assert!(low <= 0.0 && high >= 0.0);
            prop_assert_eq!(range.rounded(0.0).abs(), 0.0);
            let x = low + share * (high - low);
            // Zero falls on a step, which can move both ends by half a step.
            prop_assert!((range.rounded(x) - x).abs() <= range.scale() * 1.001, "{x} becomes {}", range.rounded(x));
            prop_assert_eq!(range.rounded(range.rounded(x)), range.rounded(x));
        }

        #[test]
        fn weights_are_within_half_a_step(weight in prop::collection::vec(-3.0_f32..3.0, 12), bias in prop::collection::vec(-9.0_f32..9.0, 3)) {
            for range in [WeightRange::Full, WeightRange::Reduced] {
                let found = QuantizedWeights::new(&weight, &bias, 3, 0.02, range);
                for (i, value) in weight.iter().enumerate() {
                    let scale = found.scales[i / 4];
                    prop_assert!((f32::from(found.values[i]) * scale - value).abs() <= scale * 0.501);
                }
                let limit = if range == WeightRange::Full { 127 } else { 63 };
                prop_assert!(found.values.iter().all(|value| value.unsigned_abs() <= limit));
            }
            let found = QuantizedWeights::new(&weight, &bias, 3, 0.02, WeightRange::Full);
            for (i, value) in bias.iter().enumerate() {
                let scale = found.bias_scales[i];
                prop_assert!((found.bias[i] as f32 * scale - value).abs() <= scale * 0.51 + 1e-5);
            }
        }
    }

    #[test]
    fn ranges_of_nothing() {
        for (low, high) in [(0.0, 0.0), (f32::NAN, f32::NAN), (f32::NEG_INFINITY, 1.0), (0.0, 1e-45)] {
            assert_eq!(Range::new(low, high).ends(), [0.0, 1.0], "{low} to {high}");
        }
        assert_eq!(Range::new(2.0, 3.0).ends(), [0.0, 3.0]);
        assert_eq!(Range::new(0.0, 3.0).zero_point(), 0);
        assert_eq!(Range::new(-3.0, 0.0).zero_point(), 255);
    }

    #[test]
    fn two_products_of_reduced_weights_fit_into_16_bits() {
        let weights = QuantizedWeights::new(&[1.0, -1.0], &[], 2, 1.0, WeightRange::Reduced).values;
        assert_eq!(weights, [63, -63]);
        assert!(2 * 255 * i32::from(weights[0]) <= i32::from(i16::MAX));
    }

    #[test]
    fn a_bias_that_would_not_fit_makes_longer_steps() {
        let found = QuantizedWeights::new(&[1e-12, 0.0], &[5.0, 0.0], 2, 1e-3, WeightRange::Full);
        assert!((f64::from(found.bias[0]) * f64::from(found.bias_scales[0]) - 5.0).abs() < 1e-4, "{found:?}");
        assert_eq!(found.values, [0, 0]);
        assert_eq!(found.scales[1].to_bits(), 1.0_f32.to_bits());
    }
}

//! What is wrong with a guidance, as classes: for each of seven numbers a bin, none where it is too far off.

use farsight_core::overlap::iou_3d;
use farsight_core::{Box3d, Dimensions, wrapped_angle};

/// x, y, z, height, width, length, yaw.
pub const NUMBERS: usize = 7;

/// Bins of each number; the middle one changes nothing.
pub const BINS: usize = 7;

/// No refined side is smaller, metres.
const MIN_SIDE_M: f64 = 0.1;

/// Overlaps with the right box from which on a refined one is as good as can be, and up to which it is worth nothing
/// (paper, section 3.4).
const OVERLAP_LIMITS: [f64; 2] = [0.25, 0.75];

/// The bin of each number; none where no bin reaches so far.
pub type Bins = [Option<usize>; NUMBERS];

/// Bins of equal width.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Refinement {
    /// Width of the bins of each number: the standard deviation of the guidance's errors, metres and radians.
    pub widths: [f64; NUMBERS],
}

impl Refinement {
    /// The bins that lead from `guidance` to `truth`.
    pub fn encode(&self, guidance: &Box3d, truth: &Box3d) -> Bins {
        let (from, to) = (numbers(guidance), numbers(truth));
        let yaw_off = wrapped_angle(truth.yaw - guidance.yaw);
        std::array::from_fn(|k| {
            let off = if k == NUMBERS - 1 { yaw_off } else { to[k] - from[k] };
            let bin = (off / self.widths[k]).round() + (BINS / 2) as f64;
            (0.0..BINS as f64).contains(&bin).then_some(bin as usize)
        })
    }

    /// `guidance` moved to the middles of `bins`; numbers without a bin stay.
    pub fn decode(&self, guidance: &Box3d, bins: &Bins) -> Box3d {
        let off = |k: usize| bins[k].map_or(0.0, |bin| (bin as f64 - (BINS / 2) as f64) * self.widths[k]);
        let [x, y, z, height, width, length, yaw] = {
            let from = numbers(guidance);
            std::array::from_fn(|k| from[k] + off(k))
        };
        let side = |side: f64| side.max(MIN_SIDE_M);
        let dimensions = Dimensions { height: side(height), width: side(width), length: side(length) };
        Box3d { dimensions, location: [x, y, z], yaw: wrapped_angle(yaw) }
    }

    /// What the network should answer: how good the refined box is, in the right bin of each number; zeros elsewhere.
    pub fn target(&self, guidance: &Box3d, truth: &Box3d) -> [f32; NUMBERS * BINS] {
        let bins = self.encode(guidance, truth);
        let quality = quality(iou_3d(&self.decode(guidance, &bins), truth)) as f32;
        let mut target = [0.0; NUMBERS * BINS];
        for (k, bin) in bins.iter().enumerate() {
            if let Some(bin) = bin {
                target[k * BINS + bin] = quality;
            }
        }
        target
    }
}

/// How good a box with such an overlap with the right one is, 0 to 1.
pub fn quality(overlap: f64) -> f64 {
    let [low, high] = OVERLAP_LIMITS;
    ((overlap - low) / (high - low)).clamp(0.0, 1.0)
}

fn numbers(object: &Box3d) -> [f64; NUMBERS] {
    let [x, y, z] = object.location;
    let Dimensions { height, width, length } = object.dimensions;
    [x, y, z, height, width, length, object.yaw]
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const WIDTHS: [f64; NUMBERS] = [0.4, 0.2, 1.5, 0.15, 0.1, 0.4, 0.2];

    fn car() -> Box3d {
        let dimensions = Dimensions { height: 1.53, width: 1.63, length: 3.88 };
        Box3d { dimensions, location: [2.0, 1.7, 20.0], yaw: 3.0 }
    }

    proptest! {
        #[test]
        fn what_is_encoded_comes_back_to_half_a_bin(off in prop::array::uniform7(-3.49..3.49)) {
            let refinement = Refinement { widths: WIDTHS };
            let guidance = car();
            let mut truth = guidance;
            for (axis, value) in truth.location.iter_mut().enumerate() {
                *value += off[axis] * WIDTHS[axis];
            }
            truth.dimensions.height += off[3] * WIDTHS[3];
            truth.dimensions.width += off[4] * WIDTHS[4];
            truth.dimensions.length += off[5] * WIDTHS[5];
            truth.yaw = wrapped_angle(truth.yaw + off[6] * WIDTHS[6]);
            let bins = refinement.encode(&guidance, &truth);
            prop_assert!(bins.iter().all(Option::is_some), "{bins:?}");
            let back = refinement.decode(&guidance, &bins);
            for (k, (a, b)) in numbers(&back).into_iter().zip(numbers(&truth)).enumerate().take(NUMBERS - 1) {
                prop_assert!((a - b).abs() <= WIDTHS[k] / 2.0 + 1e-9, "{k}: {a} and {b}");
            }
            prop_assert!(wrapped_angle(back.yaw - truth.yaw).abs() <= WIDTHS[6] / 2.0 + 1e-9);
            // A box that is right already stays.
            let again = refinement.encode(&back, &back);
            prop_assert_eq!(again, [Some(BINS / 2); NUMBERS]);
        }
    }

    #[test]
    fn what_is_too_far_off_has_no_bin_and_stays() {
        let refinement = Refinement { widths: WIDTHS };
        let truth = Box3d { location: [2.0, 1.7, 20.0 + 3.6 * 1.5], ..car() };
        let bins = refinement.encode(&car(), &truth);
        assert_eq!(bins[2], None);
        assert!((refinement.decode(&car(), &bins).location[2] - 20.0).abs() < 1e-12);
        // It is somewhere else, so nothing of it is worth anything.
        assert!(refinement.target(&car(), &truth).iter().all(|value| *value == 0.0));
    }

    #[test]
    fn quality_is_that_of_the_paper() {
        for (overlap, expected) in [(0.0, 0.0), (0.25, 0.0), (0.3, 0.1), (0.5, 0.5), (0.75, 1.0), (0.9, 1.0)] {
            assert!((quality(overlap) - expected).abs() < 1e-12, "{overlap}");
        }
        let target = Refinement { widths: WIDTHS }.target(&car(), &car());
        let ones: Vec<usize> = target.iter().enumerate().filter(|(_, v)| **v > 0.99).map(|(k, _)| k).collect();
        assert_eq!(ones, [3, 10, 17, 24, 31, 38, 45]);
    }
}

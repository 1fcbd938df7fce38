//! The observation angle in twelve bins (`MonoDLE`, after `FrustumNet`).

use std::f64::consts::TAU;

use farsight_core::wrapped_angle;

/// Bins of the observation angle; the first lies around zero.
pub const HEADING_BINS: usize = 12;

/// Width of a bin, radians.
const BIN_WIDTH: f64 = TAU / HEADING_BINS as f64;

/// An observation angle as a bin and what is left.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Heading {
    /// The bin.
    pub bin: usize,
    /// Angle less the bin's middle, radians.
    pub residual: f64,
}

impl Heading {
    /// The bin that `alpha` (radians) lies in.
    pub fn from_alpha(alpha: f64) -> Self {
        let from_first_edge = (alpha + BIN_WIDTH / 2.0).rem_euclid(TAU);
        // An angle just below zero rounds to a whole turn.
        let bin = ((from_first_edge / BIN_WIDTH) as usize).min(HEADING_BINS - 1);
        Self { bin, residual: from_first_edge - (bin as f64 + 0.5) * BIN_WIDTH }
    }

    /// What the channels of a cell say: a logit for each bin, then a residual for each. Of equal bins the first counts.
    pub fn from_channels(value: impl Fn(usize) -> f64) -> Self {
        let bin = (1..HEADING_BINS).fold(0, |best, bin| if value(bin) > value(best) { bin } else { best });
        Self { bin, residual: value(HEADING_BINS + bin) }
    }

    /// The angle, radians in `[-pi, pi]`.
    pub fn alpha(&self) -> f64 {
        wrapped_angle(self.bin as f64 * BIN_WIDTH + self.residual)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn every_angle_lies_in_its_bin(alpha in -10.0..10.0) {
            let heading = Heading::from_alpha(alpha);
            prop_assert!(heading.bin < HEADING_BINS && heading.residual.abs() <= BIN_WIDTH / 2.0 + 1e-9);
            prop_assert!(wrapped_angle(heading.alpha() - alpha).abs() < 1e-9);
        }
    }

    #[test]
    fn angles_at_the_borders_of_bins_have_one() {
        let bin = |degrees: f64| Heading::from_alpha(degrees.to_radians()).bin;
        assert_eq!([bin(0.0), bin(14.9), bin(15.1), bin(-14.9), bin(-15.1), bin(180.0)], [0, 0, 1, 0, 11, 6]);
        assert!(Heading::from_alpha(-1e-300 - BIN_WIDTH / 2.0).bin < HEADING_BINS);
    }
}

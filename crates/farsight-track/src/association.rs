//! What it costs to take a detection for a track.

use farsight_core::Box2d;
use farsight_core::overlap::iou_2d;

use crate::filter::{Filter, Measured};
use crate::options::TrackerOptions;

/// How strictly a detection has to lie where a track was expected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Strictness {
    /// The least overlap.
    pub(crate) min_overlap: f64,
    /// Boxes may be so much larger on each side, in their sides: what moves fast is beside where it was expected.
    pub(crate) margin: f64,
    /// Gate of distance and size, standard deviations, of boxes that overlap by half.
    pub(crate) gate_sigmas: f64,
}

/// What overlap in the image counts less when the boxes had to be made larger for it.
const MARGIN_WEIGHT: f64 = 0.5;

/// The gates are as they are called where boxes overlap by one less this.
const USUAL_OVERLAP_GAP: f64 = 0.5;

/// Share of the cost that distance and size have at their gates.
const MISFIT_WEIGHT: f64 = 0.15;

/// From 0 to 1 and more, where 1 is not worth it; infinite outside the gates.
pub(crate) fn cost(
    filter: &Filter,
    expected: &Box2d,
    measured: &Measured,
    seen: &Box2d,
    strictness: Strictness,
    options: &TrackerOptions,
) -> f64 {
    let Strictness { min_overlap, margin, gate_sigmas } = strictness;
    let wide = iou_2d(&grown(expected, margin), &grown(seen, margin));
    let overlap = iou_2d(expected, seen).max(MARGIN_WEIGHT * wide);
    if overlap < min_overlap {
        return f64::INFINITY;
    }
    // The better it lies, the odder its distance may be: errors have longer tails than the normal distribution.
    let gate = gate_sigmas * (overlap + USUAL_OVERLAP_GAP);
    let misfit = filter.misfit(measured, &options.noise).map(|off| (off / gate).powi(2));
    if misfit.iter().any(|squared| *squared > 1.0) {
        return f64::INFINITY;
    }
    1.0 - overlap + MISFIT_WEIGHT * misfit.iter().sum::<f64>()
}

fn grown(area: &Box2d, margin: f64) -> Box2d {
    let [x, y] = [margin * area.width(), margin * area.height()];
    Box2d::new(area.x1 - x, area.y1 - y, area.x2 + x, area.y2 + y)
}

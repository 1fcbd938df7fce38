//! Whether error bars mean what they say.

use serde::Serialize;

use super::matching::Target;
use super::slices::{Group, Slice};
use crate::parts::Part;

/// How often the true z lies within one and two standard deviations of the predicted one. For errors of a normal
/// distribution the shares are 0.683 and 0.954; smaller ones say that the detector is too sure of itself.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Calibration {
    /// Over all found objects with an error bar, then by true z; only bins that have any.
    pub rows: Vec<CoverageRow>,
    /// Over all of them, for k from 0 to 3 in steps of 0.1: the share within k standard deviations.
    pub coverage: Vec<CoveragePoint>,
}

/// How many true z lie within k standard deviations of the predicted one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CoveragePoint {
    /// k.
    pub sigmas: f64,
    /// The share that a normal distribution has there.
    pub expected: f64,
    /// The share that was counted.
    pub observed: f64,
}

/// Steps from 0 to the largest k of the coverage, and how many make one standard deviation.
const COVERAGE_STEPS: u32 = 30;
const STEPS_PER_SIGMA: u32 = 10;

/// The error bars in one range of distances.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CoverageRow {
    /// Metres of true z, or `all`.
    pub distance: &'static str,
    /// How many found objects have an error bar.
    pub count: usize,
    /// Mean standard deviation that was predicted, metres.
    pub mean_sigma_m: f64,
    /// Share of them whose true z lies within one standard deviation.
    pub within_1_sigma: f64,
    /// The same for two.
    pub within_2_sigma: f64,
}

impl Calibration {
    /// The calibration over the found ones of `targets`; `None` when no detection carries an error bar.
    pub(super) fn new(targets: &[&Target]) -> Option<Self> {
        let [_, distances, ..] = Part::divisions();
        let parts = std::iter::once(("all", Part::Whole)).chain(distances);
        let rows: Vec<_> = parts.filter_map(|(name, part)| CoverageRow::new(name, part, targets)).collect();
        (!rows.is_empty()).then(|| Self { rows, coverage: coverage(targets) })
    }
}

fn coverage(targets: &[&Target]) -> Vec<CoveragePoint> {
    let bars: Vec<_> = targets.iter().filter_map(|target| error_and_sigma(target)).collect();
    let points = (0..=COVERAGE_STEPS).map(|step| {
        let sigmas = f64::from(step) / f64::from(STEPS_PER_SIGMA);
        let within = bars.iter().filter(|(error, sigma)| *error <= sigmas * sigma).count();
        CoveragePoint {
            sigmas,
            expected: libm::erf(sigmas * std::f64::consts::FRAC_1_SQRT_2),
            observed: within as f64 / bars.len() as f64,
        }
    });
    points.collect()
}

/// Absolute error of z and the standard deviation that the detection gives it, metres; `None` without either.
fn error_and_sigma(target: &Target) -> Option<(f64, f64)> {
    let found = target.found?;
    Some(((found.depth_m - target.depth_m).abs(), found.sigma_m?))
}

impl CoverageRow {
    fn new(distance: &'static str, part: Part, targets: &[&Target]) -> Option<Self> {
        let slice = Slice { group: Group::All, part };
        let bars = targets.iter().filter(|target| slice.holds(target)).filter_map(|target| error_and_sigma(target));
        let (mut count, mut sigma_sum, mut within) = (0, 0.0, [0, 0]);
        for (error, sigma) in bars {
            count += 1;
            sigma_sum += sigma;
            within[0] += usize::from(error <= sigma);
            within[1] += usize::from(error <= 2.0 * sigma);
        }
        let [within_1_sigma, within_2_sigma] = within.map(|n| n as f64 / count as f64);
        (count > 0).then(|| Self {
            distance,
            count,
            mean_sigma_m: sigma_sum / count as f64,
            within_1_sigma,
            within_2_sigma,
        })
    }
}

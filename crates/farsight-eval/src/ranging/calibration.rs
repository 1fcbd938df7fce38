//! Whether error bars mean what they say.

use serde::Serialize;

use super::matching::Target;
use super::slices::{Group, Slice};
use crate::bootstrap::Interval;
use crate::parts::Part;

/// How often the true z lies within the intervals that a detection's standard deviation stands for. Smaller shares than
/// they should be say that the detector is too sure of itself.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Calibration {
    /// Over all found objects with an error bar, then by true z; only bins that have any.
    pub rows: Vec<CoverageRow>,
    /// By height in the image.
    pub by_height: Vec<CoverageRow>,
    /// By KITTI's occlusion level.
    pub by_occlusion: Vec<CoverageRow>,
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

/// The error bars in one part of the data.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CoverageRow {
    /// Metres of true z, pixels of height, or an occlusion level; `all` of all.
    pub part: &'static str,
    /// How many found objects have an error bar.
    pub count: usize,
    /// Mean standard deviation that was predicted, metres.
    pub mean_sigma_m: f64,
    /// Share of them whose true z lies within one standard deviation.
    pub within_1_sigma: f64,
    /// The same for two.
    pub within_2_sigma: f64,
    /// Share within the 50% interval. All three intervals are in proportion, as the program tells them: a factor too
    /// far is as likely as the same factor too near.
    pub within_50: Share,
    /// Share within the 68% interval, of one standard deviation.
    pub within_68: Share,
    /// Share within the 90% interval.
    pub within_90: Share,
}

/// A share of some objects, with what it can tell of all such objects.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Share {
    /// The share.
    pub share: f64,
    /// Its 95% interval (Wilson 1927), as if each object were drawn by itself.
    pub interval: Interval,
}

impl Share {
    /// The share of `part` objects in `all`, of which there must be some.
    fn new(part: usize, all: usize) -> Self {
        /// 97.5% quantile of a normal distribution.
        const Z: f64 = 1.959_963_984_540_054;
        let (n, share) = (all as f64, part as f64 / all as f64);
        let scale = 1.0 + Z * Z / n;
        let middle = (share + Z * Z / (2.0 * n)) / scale;
        let half = Z * (share * (1.0 - share) / n + Z * Z / (4.0 * n * n)).sqrt() / scale;
        Self { share, interval: Interval { low: (middle - half).max(0.0), high: (middle + half).min(1.0) } }
    }
}

impl Calibration {
    /// The calibration over the found ones of `targets`; `None` when no detection carries an error bar.
    /// `interval_sigmas`: half the widths of the 50 and 90% intervals.
    pub(super) fn new(targets: &[&Target], interval_sigmas: [f64; 2]) -> Option<Self> {
        let [heights, distances, occlusions, _] = Part::divisions();
        let rows = |parts: &mut dyn Iterator<Item = (&'static str, Part)>| -> Vec<_> {
            parts.filter_map(|(name, part)| CoverageRow::new(name, part, targets, interval_sigmas)).collect()
        };
        let by_distance = rows(&mut std::iter::once(("all", Part::Whole)).chain(distances));
        (!by_distance.is_empty()).then(|| Self {
            rows: by_distance,
            by_height: rows(&mut heights.into_iter()),
            by_occlusion: rows(&mut occlusions.into_iter()),
            coverage: coverage(targets),
        })
    }
}

fn coverage(targets: &[&Target]) -> Vec<CoveragePoint> {
    let bars: Vec<_> = targets.iter().filter_map(|target| ErrorBar::of(target)).collect();
    let points = (0..=COVERAGE_STEPS).map(|step| {
        let sigmas = f64::from(step) / f64::from(STEPS_PER_SIGMA);
        CoveragePoint {
            sigmas,
            expected: libm::erf(sigmas * std::f64::consts::FRAC_1_SQRT_2),
            observed: count_within(&bars, sigmas) as f64 / bars.len() as f64,
        }
    });
    points.collect()
}

fn count_within(bars: &[ErrorBar], sigmas: f64) -> usize {
    bars.iter().filter(|bar| bar.error_m <= sigmas * bar.sigma_m).count()
}

/// An error of z and what the detection says of it.
struct ErrorBar {
    /// Absolute, metres.
    error_m: f64,
    /// Absolute, of the logarithm.
    log_error: f64,
    /// Standard deviation, metres.
    sigma_m: f64,
    /// Standard deviation of the logarithm.
    log_sigma: f64,
}

impl ErrorBar {
    /// `None` of what was not found or has no error bar.
    fn of(target: &Target) -> Option<Self> {
        let found = target.found?;
        let sigma_m = found.sigma_m?;
        Some(Self {
            error_m: (found.depth_m - target.depth_m).abs(),
            log_error: (found.depth_m / target.depth_m).ln().abs(),
            sigma_m,
            log_sigma: sigma_m / found.depth_m,
        })
    }
}

impl CoverageRow {
    fn new(part_name: &'static str, part: Part, targets: &[&Target], interval_sigmas: [f64; 2]) -> Option<Self> {
        let slice = Slice { group: Group::All, part };
        let bars = targets.iter().filter(|target| slice.holds(target)).filter_map(|target| ErrorBar::of(target));
        let bars: Vec<_> = bars.collect();
        let count = bars.len();
        (count > 0).then(|| {
            let [within_1_sigma, within_2_sigma] =
                [1.0, 2.0].map(|sigmas| count_within(&bars, sigmas) as f64 / count as f64);
            let [half, most] = interval_sigmas;
            let [within_50, within_68, within_90] = [half, 1.0, most].map(|sigmas| {
                Share::new(bars.iter().filter(|bar| bar.log_error <= sigmas * bar.log_sigma).count(), count)
            });
            let mean_sigma_m = bars.iter().map(|bar| bar.sigma_m).sum::<f64>() / count as f64;
            Self {
                part: part_name,
                count,
                mean_sigma_m,
                within_1_sigma,
                within_2_sigma,
                within_50,
                within_68,
                within_90,
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::Share;

    #[test]
    fn intervals_of_shares_are_those_of_wilson() {
        // The formula worked in Python.
        for (part, all, low, high) in [
            (0, 10, 0.0, 0.277_533),
            (5, 10, 0.236_593, 0.763_407),
            (10, 10, 0.722_467, 1.0),
            (90, 100, 0.825_634, 0.944_771),
        ] {
            let interval = Share::new(part, all).interval;
            assert!((interval.low - low).abs() < 1e-5 && (interval.high - high).abs() < 1e-5, "{part}: {interval:?}");
        }
    }
}

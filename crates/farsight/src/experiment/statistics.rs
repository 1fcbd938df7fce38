//! What the answers of cells are worth, and what their differences say.

use std::collections::BTreeMap;

use anyhow::Result;
use farsight_data::Dataset;
use farsight_eval::ap::{Metric as ApMetric, OverlapSet};
use farsight_eval::ranging::{
    Bootstrap, Group, RangingMetric, RangingOptions, SeedDifference, Target, compare_seeds,
};
use farsight_eval::{Difficulty, EvaluatedClass, Evaluation, FrameFiles, Report};

use super::plan::PlannedComparison;
use super::results::{Comparison, Verdict};
use super::{Cell, Experiment, Metric};

/// From here on a car is far, metres.
const FAR_M: f64 = 40.0;

/// Below this a car is small, pixels of the image; KITTI's limit of Easy.
const SMALL_PX: f64 = 40.0;

/// The answers of a cell beside the labels.
pub(super) struct Judged {
    evaluation: Evaluation,
    report: Report,
}

impl Judged {
    pub(super) fn new(files: &FrameFiles) -> Result<Self> {
        let options = RangingOptions { bootstrap: None, ..RangingOptions::default() };
        let (evaluation, _) = files.evaluate(&options)?;
        let report = evaluation.report();
        Ok(Self { evaluation, report })
    }
}

/// Judges cells of one experiment, all on the same frames.
pub(super) struct Judge {
    /// Heights of the 2D boxes of each frame's labels, pixels.
    heights_px: Vec<Vec<f64>>,
    cells: Vec<(Cell, Judged)>,
}

impl Judge {
    pub(super) fn new(dataset: &dyn Dataset) -> Result<Self> {
        let heights = |index: usize| -> Result<Vec<f64>> {
            Ok(dataset.labels(index)?.iter().map(|label| label.box2d.height()).collect())
        };
        Ok(Self { heights_px: (0..dataset.len()).map(heights).collect::<Result<_>>()?, cells: Vec::new() })
    }

    pub(super) fn has(&self, cell: &Cell) -> bool {
        self.cells.iter().any(|(kept, _)| kept == cell)
    }

    pub(super) fn keep(&mut self, cell: Cell, judged: Judged) {
        self.cells.push((cell, judged));
    }

    /// All figures of one cell.
    pub(super) fn metrics(&self, judged: &Judged) -> BTreeMap<Metric, f64> {
        let value = |metric: Metric| Some((metric, self.value(judged, metric)?));
        Metric::ALL.into_iter().filter_map(value).collect()
    }

    fn value(&self, judged: &Judged, metric: Metric) -> Option<f64> {
        if metric.is_ap() {
            return Some(average_precision(&judged.report, metric));
        }
        let targets = judged.evaluation.targets();
        // One arm against itself: its own figure, of all that it found.
        let none = Bootstrap { resamples: 0, seed: 0 };
        let pairs: [[&[Target]; 2]; 1] = [[targets, targets]];
        let holds = |target: &Target| self.holds(metric, target);
        Some(compare_seeds(&pairs, self.heights_px.len(), ranging_metric(metric), holds, &none)?.value)
    }

    /// Whether an error of this object belongs to the metric.
    fn holds(&self, metric: Metric, target: &Target) -> bool {
        let is_level = |level: Difficulty| Group::Level(level).holds(target.difficulty);
        let is_in = match metric {
            Metric::MaeFar | Metric::FoundFar => is_level(Difficulty::Moderate) && target.depth_m >= FAR_M,
            Metric::MaeSmall => {
                let heights = self.heights_px.get(target.frame as usize);
                let height = heights.and_then(|heights| heights.get(target.label as usize));
                is_level(Difficulty::Moderate) && height.is_some_and(|height| *height < SMALL_PX)
            }
            // Largely hidden cars count at Hard only.
            Metric::MaeOccluded | Metric::FoundOccluded => {
                is_level(Difficulty::Hard) && (1..=2).contains(&target.occlusion)
            }
            _ => is_level(Difficulty::Moderate),
        };
        target.class == EvaluatedClass::Car && is_in
    }

    /// Every comparison of the plan for which both arms have a seed.
    pub(super) fn comparisons(&self, plan: &Experiment) -> Vec<Comparison> {
        let metrics = || plan.endpoints.primary.iter().chain(&plan.endpoints.secondary).copied();
        let pairs = |planned: &PlannedComparison| {
            let of = |arm: &str, seed: u64| {
                self.cells.iter().find(|(cell, _)| cell.arm == arm && cell.seed == seed).map(|(_, judged)| judged)
            };
            let ours = self.cells.iter().filter(|(cell, _)| cell.arm == planned.arm);
            ours.filter_map(|(cell, judged)| Some([judged, of(&planned.against, cell.seed)?])).collect::<Vec<_>>()
        };
        let compared = |planned: &PlannedComparison| {
            let pairs = pairs(planned);
            metrics().filter_map(|metric| self.compared(plan, planned, metric, &pairs)).collect::<Vec<_>>()
        };
        plan.comparisons.iter().flat_map(compared).collect()
    }

    fn compared(
        &self,
        plan: &Experiment,
        planned: &PlannedComparison,
        metric: Metric,
        pairs: &[[&Judged; 2]],
    ) -> Option<Comparison> {
        let bootstrap = Bootstrap { resamples: plan.endpoints.resamples, seed: 0 };
        let found = if metric.is_ap() {
            ap_difference(pairs, metric, &bootstrap)?
        } else {
            let targets: Vec<[&[Target]; 2]> =
                pairs.iter().map(|pair| pair.map(|judged| judged.evaluation.targets())).collect();
            let holds = |target: &Target| self.holds(metric, target);
            compare_seeds(&targets, self.heights_px.len(), ranging_metric(metric), holds, &bootstrap)?
        };
        let relative = || planned.relative_claims.get(&metric).map(|share| share * found.against);
        let claim = planned.claims.get(&metric).copied().or_else(relative);
        let interval = found.interval.map(<[f64; 2]>::from);
        let has_seeds = pairs.len() >= plan.endpoints.least_seeds;
        Some(Comparison {
            arm: planned.arm.clone(),
            against: planned.against.clone(),
            metric,
            seeds: pairs.len(),
            difference: found.difference,
            interval,
            claim,
            verdict: Verdict::of(interval, claim, metric, has_seeds),
        })
    }
}

fn ranging_metric(metric: Metric) -> RangingMetric {
    match metric {
        Metric::Rmse => RangingMetric::RmseZ,
        Metric::Found | Metric::FoundFar | Metric::FoundOccluded => RangingMetric::Share,
        _ => RangingMetric::MaeZ,
    }
}

/// The overlap, box and difficulty of an AP.
fn ap_of(metric: Metric) -> (OverlapSet, ApMetric, Difficulty) {
    use Difficulty::{Easy, Hard, Moderate};
    use OverlapSet::{Loose, Strict};
    match metric {
        Metric::Ap3dEasy => (Strict, ApMetric::Box3d, Easy),
        Metric::Ap3dHard => (Strict, ApMetric::Box3d, Hard),
        Metric::Bev => (Strict, ApMetric::Bev, Moderate),
        Metric::BevEasy => (Strict, ApMetric::Bev, Easy),
        Metric::BevHard => (Strict, ApMetric::Bev, Hard),
        Metric::Ap3d05 => (Loose, ApMetric::Box3d, Moderate),
        Metric::Bev05 => (Loose, ApMetric::Bev, Moderate),
        Metric::Ap2d => (Strict, ApMetric::Image, Moderate),
        _ => (Strict, ApMetric::Box3d, Moderate),
    }
}

/// Percent; 0 when nothing was found.
fn average_precision(report: &Report, metric: Metric) -> f64 {
    let (set, box_metric, level) = ap_of(metric);
    report.ap.ap(set, box_metric, EvaluatedClass::Car).map_or(0.0, |ap| ap.r40[level as usize])
}

/// The difference of AP over the seeds.
fn ap_difference(pairs: &[[&Judged; 2]], metric: Metric, _bootstrap: &Bootstrap) -> Option<SeedDifference> {
    let mean = |arm: usize| {
        let values = pairs.iter().map(|pair| average_precision(&pair[arm].report, metric));
        values.sum::<f64>() / pairs.len() as f64
    };
    let [value, against] = [mean(0), mean(1)];
    (!pairs.is_empty()).then_some(SeedDifference { value, against, difference: value - against, interval: None })
}

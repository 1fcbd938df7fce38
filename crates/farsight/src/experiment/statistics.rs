//! What the answers of cells are worth, and what their differences say.

use std::collections::BTreeMap;

use anyhow::{Context, Result};
use farsight_eval::ap::{CurveSpec, Metric as ApMetric, OverlapSet};
use farsight_eval::paired::{self, ClaimedEffect, Endpoint, PairedDifference, PairedRuns, holm, judge};
use farsight_eval::ranging::{Group, RangingMetric, RangingOptions, Slice};
use farsight_eval::{Bootstrap, Difficulty, EvaluatedClass, Evaluation, FrameFiles, Part};

use super::plan::PlannedComparison;
use super::results::{ArmResult, Comparison, Verdict};
use super::{Cell, Experiment, Metric};

/// The chance of a false alarm that a verdict takes, over all metrics of a comparison.
const SIGNIFICANCE: f64 = 0.05;

/// Answers beside labels.
pub(crate) fn evaluation(files: &FrameFiles) -> Result<Evaluation> {
    let options = RangingOptions { bootstrap: None, ..RangingOptions::default() };
    Ok(files.evaluate(&options)?.0)
}

/// All figures of one cell.
pub(crate) fn metrics(cell: &Evaluation) -> Result<BTreeMap<Metric, f64>> {
    // An arm against itself: its own figures, of all that it found.
    let runs = PairedRuns::new(vec![(cell, cell)]).context("the labels changed while they were read")?;
    let found = runs.compare(&Metric::ALL.map(endpoint), &Bootstrap { resamples: 0, seed: 0 });
    let values = Metric::ALL.into_iter().zip(found);
    Ok(values.filter_map(|(metric, found)| Some((metric, found?.value))).collect())
}

/// Cells of one experiment, all on the same frames.
#[derive(Default)]
pub(crate) struct Judge {
    cells: Vec<(Cell, Evaluation)>,
    /// Comparisons that are made already, with the number of their seeds: a cell more changes few of them.
    known: BTreeMap<(String, String), (usize, Vec<Comparison>)>,
    /// The same of single arms.
    known_arms: BTreeMap<String, (usize, Vec<ArmResult>)>,
}

impl Judge {
    pub(crate) fn has(&self, cell: &Cell) -> bool {
        self.cells.iter().any(|(kept, _)| kept == cell)
    }

    pub(crate) fn keep(&mut self, cell: Cell, evaluation: Evaluation) {
        self.cells.push((cell, evaluation));
    }

    /// Every arm of the plan that has a seed, by every endpoint.
    pub(crate) fn arms(&mut self, plan: &Experiment) -> Result<Vec<ArmResult>> {
        let mut all = Vec::new();
        for arm in plan.arms() {
            let cells = self.cells.iter().filter(|(cell, _)| cell.arm == arm);
            let runs: Vec<(&Evaluation, &Evaluation)> = cells.map(|(_, own)| (own, own)).collect();
            let seeds = runs.len();
            let made = match self.known_arms.get(&arm).filter(|(known, _)| *known == seeds) {
                Some((_, made)) => made.clone(),
                None if runs.is_empty() => Vec::new(),
                None => alone(plan, &arm, runs)?,
            };
            self.known_arms.insert(arm, (seeds, made.clone()));
            all.extend(made);
        }
        Ok(all)
    }

    /// Every comparison of the plan for which both arms have a seed.
    pub(crate) fn comparisons(&mut self, plan: &Experiment) -> Result<Vec<Comparison>> {
        let mut all = Vec::new();
        for planned in &plan.comparisons {
            let key = (planned.arm.clone(), planned.against.clone());
            let pairs = self.pairs(planned);
            let known = self.known.get(&key).filter(|(seeds, _)| *seeds == pairs.len()).map(|(_, made)| made.clone());
            let made = match known {
                Some(made) => made,
                None if pairs.is_empty() => Vec::new(),
                None => compared(plan, planned, pairs)?,
            };
            let seeds = made.first().map_or(0, |comparison| comparison.seeds);
            self.known.insert(key, (seeds, made.clone()));
            all.extend(made);
        }
        Ok(all)
    }

    /// The cells of both arms, seed by seed.
    fn pairs(&self, planned: &PlannedComparison) -> Vec<(&Evaluation, &Evaluation)> {
        let of = |arm: &str, seed: u64| {
            let cell = self.cells.iter().find(|(cell, _)| cell.arm == arm && cell.seed == seed);
            cell.map(|(_, evaluation)| evaluation)
        };
        let ours = self.cells.iter().filter(|(cell, _)| cell.arm == planned.arm);
        ours.filter_map(|(cell, ours)| Some((ours, of(&planned.against, cell.seed)?))).collect()
    }
}

/// One arm, as pairs of every run with itself, by every endpoint: of all that it found.
fn alone(plan: &Experiment, arm: &str, runs: Vec<(&Evaluation, &Evaluation)>) -> Result<Vec<ArmResult>> {
    let seeds = runs.len();
    let runs = PairedRuns::new(runs).context("cells were judged on different labels")?;
    let metrics: Vec<Metric> = plan.endpoints.all().collect();
    let endpoints: Vec<Endpoint> = metrics.iter().map(|metric| endpoint(*metric)).collect();
    let found = runs.compare(&endpoints, &Bootstrap { resamples: plan.endpoints.resamples, seed: 0 });
    let result = |(metric, found): (Metric, Option<PairedDifference>)| {
        let found = found?;
        let interval = found.value_interval.map(<[f64; 2]>::from);
        Some(ArmResult { arm: arm.to_owned(), metric, seeds, value: found.value, interval })
    };
    Ok(metrics.into_iter().zip(found).filter_map(result).collect())
}

/// One arm against another by every endpoint; claims, and what nothing is claimed of, are a family each.
fn compared(
    plan: &Experiment,
    planned: &PlannedComparison,
    pairs: Vec<(&Evaluation, &Evaluation)>,
) -> Result<Vec<Comparison>> {
    let seeds = pairs.len();
    let metrics: Vec<Metric> = plan.endpoints.all().collect();
    let endpoints: Vec<Endpoint> = metrics.iter().map(|metric| endpoint(*metric)).collect();
    let runs = PairedRuns::new(pairs).context("cells were judged on different labels")?;
    let bootstrap = Bootstrap { resamples: plan.endpoints.resamples, seed: 0 };
    let differences = runs.compare(&endpoints, &bootstrap);
    let found: Vec<(Metric, &PairedDifference)> =
        metrics.iter().zip(&differences).filter_map(|(metric, found)| Some((*metric, found.as_ref()?))).collect();

    let claim = |metric: &Metric| {
        let absolute = planned.claims.get(metric).map(|claim| ClaimedEffect::Absolute(*claim));
        absolute.or_else(|| planned.relative_claims.get(metric).map(|share| ClaimedEffect::Relative(*share)))
    };
    let claimed: Vec<(Metric, &PairedDifference, ClaimedEffect)> =
        found.iter().filter_map(|(metric, difference)| Some((*metric, *difference, claim(metric)?))).collect();
    let judged = judge(&claimed.iter().map(|(_, difference, claim)| (*difference, *claim)).collect::<Vec<_>>());
    let open: Vec<(Metric, &PairedDifference)> =
        found.iter().filter(|(metric, _)| claim(metric).is_none()).copied().collect();
    let p_zero = holm(&open.iter().map(|(_, difference)| difference.p_value(0.0)).collect::<Vec<_>>());

    let has_seeds = seeds >= plan.endpoints.least_seeds;
    let comparison =
        |metric: Metric, difference: &PairedDifference, claim: Option<f64>, verdict: Verdict, short| Comparison {
            arm: planned.arm.clone(),
            against: planned.against.clone(),
            metric,
            seeds,
            difference: difference.difference,
            interval: difference.interval.map(<[f64; 2]>::from),
            claim,
            verdict: if has_seeds { verdict } else { Verdict::Undecided },
            excludes_claim: has_seeds && short,
        };
    let of_claims = claimed.iter().zip(judged).map(|((metric, difference, _), judged)| {
        let verdict = match judged.verdict {
            paired::Verdict::Supported => Verdict::Supported,
            paired::Verdict::Refuted => Verdict::Refuted,
            paired::Verdict::Undecided => Verdict::Undecided,
        };
        comparison(*metric, difference, Some(judged.claimed), verdict, judged.excludes_effect)
    });
    let of_others = open.iter().zip(p_zero).map(|((metric, difference), p_zero)| {
        let is_better = (difference.difference < 0.0) == metric.is_error();
        let verdict = match p_zero < SIGNIFICANCE {
            true if is_better => Verdict::Better,
            true => Verdict::Worse,
            false => Verdict::Undecided,
        };
        comparison(*metric, difference, None, verdict, false)
    });
    let mut all: Vec<Comparison> = of_claims.chain(of_others).collect();
    all.sort_by_key(|comparison| metrics.iter().position(|metric| *metric == comparison.metric));
    Ok(all)
}

/// What the evaluator calls a metric.
fn endpoint(metric: Metric) -> Endpoint {
    use Difficulty::{Easy, Hard, Moderate};
    use OverlapSet::{Loose, Strict};
    let class = EvaluatedClass::Car;
    let ap = |overlaps, metric, difficulty, part| {
        Endpoint::Ap(CurveSpec { part, ..CurveSpec::new(overlaps, metric, class, difficulty) })
    };
    let ranging =
        |metric, level, part| Endpoint::Ranging { metric, class, slice: Slice { group: Group::Level(level), part } };
    let found = |class| Endpoint::FoundAtAlarms { class, most_per_frame: 0.3 };
    // 40 to 50 m; 25 to 40 pixels; largely hidden, which counts at Hard only.
    let (far, small, hidden) = (Part::Distance(4), Part::Height(1), Part::Occlusion(2));
    match metric {
        Metric::Ap3d => ap(Strict, ApMetric::Box3d, Moderate, Part::Whole),
        Metric::Ap3dEasy => ap(Strict, ApMetric::Box3d, Easy, Part::Whole),
        Metric::Ap3dHard => ap(Strict, ApMetric::Box3d, Hard, Part::Whole),
        Metric::Bev => ap(Strict, ApMetric::Bev, Moderate, Part::Whole),
        Metric::BevEasy => ap(Strict, ApMetric::Bev, Easy, Part::Whole),
        Metric::BevHard => ap(Strict, ApMetric::Bev, Hard, Part::Whole),
        Metric::Ap3d05 => ap(Loose, ApMetric::Box3d, Moderate, Part::Whole),
        Metric::Bev05 => ap(Loose, ApMetric::Bev, Moderate, Part::Whole),
        Metric::Ap3d05Far => ap(Loose, ApMetric::Box3d, Moderate, far),
        Metric::Ap3d05Small => ap(Loose, ApMetric::Box3d, Moderate, small),
        Metric::Ap3d05Occluded => ap(Loose, ApMetric::Box3d, Hard, hidden),
        Metric::Ap2d => ap(Strict, ApMetric::Image, Moderate, Part::Whole),
        Metric::Mae => ranging(RangingMetric::MaeZ, Moderate, Part::Whole),
        Metric::Rmse => ranging(RangingMetric::RmseZ, Moderate, Part::Whole),
        Metric::MaeFar => ranging(RangingMetric::MaeZ, Moderate, far),
        Metric::MaeSmall => ranging(RangingMetric::MaeZ, Moderate, small),
        Metric::MaeOccluded => ranging(RangingMetric::MaeZ, Hard, hidden),
        Metric::Found => ranging(RangingMetric::Share, Moderate, Part::Whole),
        Metric::FoundFar => ranging(RangingMetric::Share, Moderate, far),
        Metric::FoundSmall => ranging(RangingMetric::Share, Moderate, small),
        Metric::FoundOccluded => ranging(RangingMetric::Share, Hard, hidden),
        Metric::Found03 => found(EvaluatedClass::Car),
        Metric::Pedestrians03 => found(EvaluatedClass::Pedestrian),
        Metric::Cyclists03 => found(EvaluatedClass::Cyclist),
    }
}

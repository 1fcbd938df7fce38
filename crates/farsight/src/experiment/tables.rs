//! Markdown tables of an experiment.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};

use super::results::{Comparison, Verdict};
use super::times::Times;
use super::{Experiment, Metric, Results};
use crate::layout::table;

/// What the mark of a table of an experiment names beside its `table`: the plan, relative to the document.
pub(crate) const PLAN_OPTION: &str = "experiment";

/// The rows of the table that `options` ask for; `folder` is that of the document.
pub(crate) fn rows(file: &Path, folder: &Path, mut options: BTreeMap<&str, &str>) -> Result<Vec<String>> {
    let plan = options.remove(PLAN_OPTION).context("expected experiment=FILE")?;
    let plan = Experiment::read(&folder.join(plan))?;
    let name = options.remove("table").context("expected table=NAME")?;
    if name == "times" {
        ensure!(options.is_empty(), "unknown {:?}; expected table and experiment", options.keys());
        return Ok(Times::read(file)?.rows(&plan));
    }
    let results = Results::read(file)?;
    let metrics =
        options.remove("metrics").map(|names| names.split(',').map(str::parse).collect::<Result<Vec<Metric>>>());
    let metrics = metrics.transpose()?.unwrap_or_else(|| plan.endpoints.primary.clone());
    ensure!(options.is_empty(), "unknown {:?}; expected table, experiment or metrics", options.keys());
    match name {
        "progress" => Ok(vec![progress(&plan, &results)]),
        "cells" => Ok(cells(&plan, &results, &metrics)),
        "arms" => {
            let has_none = results.arms.is_empty() && !results.cells.is_empty();
            ensure!(!has_none, "written before arms had intervals; `farsight experiment run` writes it anew");
            Ok(arms(&plan, &results, &metrics))
        }
        "comparisons" => Ok(comparisons(&plan, &results, &metrics)),
        other => bail!("no table \"{other}\" of an experiment; expected progress, cells, arms, comparisons or times"),
    }
}

/// How far the experiment has come.
pub(crate) fn progress(plan: &Experiment, results: &Results) -> String {
    let planned = plan.cells();
    let is_done = |arm: &str, seed: u64| results.cells.iter().any(|cell| cell.arm == arm && cell.seed == seed);
    let done = planned.iter().filter(|cell| is_done(&cell.arm, cell.seed)).count();
    let state = if done < planned.len() { "Undecided so far" } else { "Complete" };
    format!("{state}: {done} of {} cells.", planned.len())
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Of a sample of at least two.
fn standard_deviation(values: &[f64]) -> f64 {
    let mean = mean(values);
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    (squares / (values.len() - 1) as f64).sqrt()
}

/// Means over the seeds of each arm, with standard deviations where there are several.
fn cells(plan: &Experiment, results: &Results, metrics: &[Metric]) -> Vec<String> {
    by_arm(plan, results, metrics, |arm, metric| match results.values(arm, metric)[..] {
        [] => "-".to_owned(),
        [value] => metric.shown(value),
        ref values => {
            let deviation = metric.shown_difference(standard_deviation(values));
            format!("{} ±{}", metric.shown(mean(values)), deviation.trim_start_matches('+'))
        }
    })
}

/// The same with 95% intervals over seeds and frames instead.
fn arms(plan: &Experiment, results: &Results, metrics: &[Metric]) -> Vec<String> {
    by_arm(plan, results, metrics, |arm, metric| {
        let Some(found) = results.arms.iter().find(|found| (found.arm.as_str(), found.metric) == (arm, metric)) else {
            return "-".to_owned();
        };
        let interval = found.interval.map(|[low, high]| format!(" ({} to {})", metric.shown(low), metric.shown(high)));
        metric.shown(found.value) + &interval.unwrap_or_default()
    })
}

/// A row for each arm: what it is called, its seeds, and the cell of each metric.
fn by_arm(
    plan: &Experiment,
    results: &Results,
    metrics: &[Metric],
    cell: impl Fn(&str, Metric) -> String,
) -> Vec<String> {
    let seeds = |arm: &str| {
        let done = results.cells.iter().filter(|cell| cell.arm == arm).count();
        let planned = plan.cells().iter().filter(|cell| cell.arm == arm).count();
        format!("{done} of {planned}")
    };
    let row = |arm: &String| {
        let values = metrics.iter().map(|metric| cell(arm, *metric));
        [plan.title(arm).to_owned(), seeds(arm)].into_iter().chain(values).collect()
    };
    let heading = ["arm", "seeds"].map(str::to_owned).into_iter().chain(metrics.iter().map(|m| m.title().to_owned()));
    table(&heading.collect::<Vec<_>>(), &plan.arms().iter().map(row).collect::<Vec<_>>())
}

/// A verdict, and how an effect that is there differs from the one that is claimed.
fn verdict(found: &Comparison) -> String {
    let word = found.verdict.name();
    match found.claim {
        Some(claim) if found.verdict == Verdict::Supported && found.excludes_claim => {
            let other = if found.difference.abs() < claim.abs() { "less" } else { "more" };
            format!("{word}, {other} than claimed")
        }
        _ => word.to_owned(),
    }
}

/// Every comparison of the plan by every metric, done or not.
fn comparisons(plan: &Experiment, results: &Results, metrics: &[Metric]) -> Vec<String> {
    let mut rows = Vec::new();
    for planned in &plan.comparisons {
        for &metric in metrics {
            let is_it = |found: &&Comparison| {
                (&found.arm, &found.against, found.metric) == (&planned.arm, &planned.against, metric)
            };
            let relative = || Some(format!("{:+.0}%", 100.0 * planned.relative_claims.get(&metric)?));
            let absolute = || Some(metric.shown_difference(*planned.claims.get(&metric)?));
            let claim = absolute().or_else(relative).unwrap_or_else(|| "-".to_owned());
            let named = format!("{} against {}", plan.title(&planned.arm), plan.title(&planned.against));
            let found = results.comparisons.iter().find(is_it);
            let interval = |[low, high]: [f64; 2]| {
                format!("{} to {}", metric.shown_difference(low), metric.shown_difference(high))
            };
            rows.push(vec![
                named,
                metric.title().to_owned(),
                found.map_or(0, |found| found.seeds).to_string(),
                found.map_or_else(|| "-".to_owned(), |found| metric.shown_difference(found.difference)),
                found.and_then(|found| found.interval).map_or_else(|| "-".to_owned(), interval),
                claim,
                found.map_or_else(|| "undecided".to_owned(), verdict),
            ]);
        }
    }
    table(&["arms", "metric", "seeds", "difference", "95% interval", "the paper's", "verdict"], &rows)
}

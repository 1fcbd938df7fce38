//! Two result sets on the same frames: AP and distance errors, paired.

use serde::Serialize;

use crate::ap::{CurveSpec, Metric, OverlapSet};
use crate::bootstrap::{Bootstrap, Interval};
use crate::paired::{Endpoint, PairedDifference, PairedRuns};
use crate::ranging::{ComparisonRow, RangingComparison};
use crate::{Difficulty, EvaluatedClass, Evaluation, Part};

/// Two result sets side by side; frames are drawn together for both, so what makes a frame hard for both cancels.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// Whether both say the same, in everything that any figure is made of.
    pub identical: bool,
    /// AP of every class that some object and some result is of.
    pub ap: Vec<ApComparisonRow>,
    /// Errors of distance.
    pub rows: Vec<ComparisonRow>,
}

/// One AP (40 points of recall, percent) of both.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ApComparisonRow {
    /// The class.
    pub class: EvaluatedClass,
    /// `2d`, `bev` or `3d`.
    pub metric: &'static str,
    /// The overlap that a detection must exceed.
    pub overlap: f64,
    /// `easy`, `moderate` or `hard`; parts are of the hard ones, as these are all that count at any level.
    pub group: Difficulty,
    /// `all`, `height`, `distance`, `occlusion` or `truncation`.
    pub division: &'static str,
    /// Which part of the division, `all` of all.
    pub part: &'static str,
    /// Objects that must be found.
    pub objects: usize,
    /// Of the results.
    pub value: f64,
    /// Of the results they are compared with.
    pub against: f64,
    /// `value - against`.
    pub difference: f64,
    /// 95% interval of the difference.
    pub interval: Option<Interval>,
    /// Whether the interval leaves zero out.
    pub excludes_zero: bool,
}

impl Comparison {
    /// Compares two evaluations; `None` when they are of other frames or labels.
    pub(crate) fn new(ours: &Evaluation, theirs: &Evaluation, bootstrap: &Bootstrap) -> Option<Self> {
        let ranging = RangingComparison::new(ours.targets(), theirs.targets(), ours.frames(), bootstrap)?;
        let identical = ranging.identical && ours.says_the_same_as(theirs);
        let runs = PairedRuns::new(vec![(ours, theirs)])?;
        // Class by class, as what the curves are made of takes memory.
        let rows =
            EvaluatedClass::ALL.into_iter().flat_map(|class| rows_of_class(class, ours, theirs, &runs, bootstrap));
        Some(Self { identical, ap: rows.collect(), rows: ranging.rows })
    }
}

fn rows_of_class(
    class: EvaluatedClass,
    ours: &Evaluation,
    theirs: &Evaluation,
    runs: &PairedRuns,
    bootstrap: &Bootstrap,
) -> Vec<ApComparisonRow> {
    let curves = compared_curves(class);
    // Where both are not evaluated there is no AP to compare.
    let objects: Vec<Option<usize>> = [ours, theirs]
        .map(|arm| arm.curve_outcomes(&curves))
        .into_iter()
        .map(|outcomes| outcomes.iter().map(|outcomes| outcomes.as_ref().map(|o| o.objects())).collect::<Vec<_>>())
        .reduce(|ours, theirs| ours.into_iter().zip(theirs).map(|(ours, theirs)| ours.or(theirs)).collect())
        .unwrap_or_default();
    let (curves, objects): (Vec<_>, Vec<_>) = curves
        .into_iter()
        .zip(objects)
        .filter_map(|(curve, objects)| Some((curve, objects.filter(|n| *n > 0)?)))
        .unzip();
    let endpoints: Vec<_> = curves.iter().copied().map(Endpoint::Ap).collect();
    let differences = runs.compare(&endpoints, bootstrap);
    let rows = curves.iter().zip(objects).zip(differences);
    rows.filter_map(|((curve, objects), difference)| Some(ApComparisonRow::new(curve, objects, &difference?))).collect()
}

/// Every curve of the devkit and the loose ones, then each of them over the parts of the hard objects.
fn compared_curves(class: EvaluatedClass) -> Vec<CurveSpec> {
    let [heights, distances, occlusions, _] = Part::divisions();
    let parts: Vec<Part> = [heights, distances, occlusions].into_iter().flatten().map(|(_, part)| part).collect();
    let mut curves = Vec::new();
    for (overlaps, metric) in [
        (OverlapSet::Strict, Metric::Image),
        (OverlapSet::Strict, Metric::Bev),
        (OverlapSet::Strict, Metric::Box3d),
        (OverlapSet::Loose, Metric::Bev),
        (OverlapSet::Loose, Metric::Box3d),
    ] {
        curves.extend(Difficulty::ALL.map(|level| CurveSpec::new(overlaps, metric, class, level)));
        let hard = CurveSpec::new(overlaps, metric, class, Difficulty::Hard);
        curves.extend(parts.iter().map(|part| hard.of_part(*part)));
    }
    curves
}

impl ApComparisonRow {
    fn new(curve: &CurveSpec, objects: usize, difference: &PairedDifference) -> Self {
        let CurveSpec { overlaps, metric, class, difficulty, part } = *curve;
        let PairedDifference { value, against, difference, interval, .. } = *difference;
        Self {
            class,
            metric: metric.name(),
            overlap: overlaps.min_overlap(class, metric),
            group: difficulty,
            division: part.division(),
            part: part.name(),
            objects,
            value,
            against,
            difference,
            interval,
            excludes_zero: interval.is_some_and(|interval| interval.excludes_zero()),
        }
    }
}

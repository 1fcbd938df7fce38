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
        let mut ap = Vec::new();
        // Class by class, as what the curves are made of takes memory.
        for class in EvaluatedClass::ALL {
            ap.extend(ap_rows([level_curves(class), part_curves(class)].concat(), ours, theirs, bootstrap)?);
        }
        Some(Self { identical, ap, rows: ranging.rows })
    }
}

impl Evaluation {
    /// These results beside `others` on the same frames; `None` when the labels differ.
    pub fn compared_with(&self, others: &Self, bootstrap: &Bootstrap) -> Option<Comparison> {
        Comparison::new(self, others, bootstrap)
    }
}

/// AP of two evaluations by each of these curves that either is evaluated on and that has objects; `None` when they are
/// of other labels.
pub(crate) fn ap_rows(
    curves: Vec<CurveSpec>,
    ours: &Evaluation,
    theirs: &Evaluation,
    bootstrap: &Bootstrap,
) -> Option<Vec<ApComparisonRow>> {
    let runs = PairedRuns::new(vec![(ours, theirs)])?;
    let [ours, theirs] = [ours, theirs].map(|arm| arm.curve_outcomes(&curves));
    let objects = ours.iter().zip(&theirs).map(|(ours, theirs)| Some(ours.as_ref().or(theirs.as_ref())?.objects()));
    let compared: Vec<_> = curves
        .into_iter()
        .zip(objects)
        .filter_map(|(curve, objects)| Some((curve, objects.filter(|n| *n > 0)?)))
        .collect();
    let endpoints: Vec<_> = compared.iter().map(|(curve, _)| Endpoint::Ap(*curve)).collect();
    let rows = compared.iter().zip(runs.compare(&endpoints, bootstrap));
    Some(rows.filter_map(|((curve, objects), found)| Some(ApComparisonRow::new(curve, *objects, &found?))).collect())
}

/// The kinds of curves, for one class.
fn kinds(class: EvaluatedClass) -> impl Iterator<Item = impl Fn(Difficulty) -> CurveSpec> {
    let kinds = [
        (OverlapSet::Strict, Metric::Image),
        (OverlapSet::Strict, Metric::Bev),
        (OverlapSet::Strict, Metric::Box3d),
        (OverlapSet::Loose, Metric::Bev),
        (OverlapSet::Loose, Metric::Box3d),
    ];
    kinds.into_iter().map(move |(overlaps, metric)| move |level| CurveSpec::new(overlaps, metric, class, level))
}

/// Every curve of the devkit and the loose ones.
pub(crate) fn level_curves(class: EvaluatedClass) -> Vec<CurveSpec> {
    kinds(class).flat_map(|curve| Difficulty::ALL.map(curve)).collect()
}

/// The same over the parts of the hard objects.
fn part_curves(class: EvaluatedClass) -> Vec<CurveSpec> {
    let [heights, distances, occlusions, _] = Part::divisions();
    let parts: Vec<Part> = [heights, distances, occlusions].into_iter().flatten().map(|(_, part)| part).collect();
    kinds(class)
        .flat_map(|curve| parts.iter().map(move |part| curve(Difficulty::Hard).of_part(*part)).collect::<Vec<_>>())
        .collect()
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

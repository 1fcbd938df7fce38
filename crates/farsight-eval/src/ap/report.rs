//! The AP report: every curve, and the tables made of them.

use serde::Serialize;
use serde::ser::{SerializeMap, Serializer};

use super::curve::{percent_r11, percent_r40};
use super::intervals::ApIntervals;
use super::scores::ScoreRange;
use super::{Curve, CurveSpec, Metric, OverlapSet};
use crate::bootstrap::Interval;
use crate::{Difficulty, EvaluatedClass};

/// All curves of a result set.
#[derive(Debug, Clone, PartialEq)]
pub struct ApReport {
    /// By overlap set, metric, class and difficulty; `None` where the devkit evaluates nothing.
    curves: Vec<Option<Curve>>,
    /// Intervals of the same curves; `None` where there are none or nobody asked.
    intervals: Vec<Option<ApIntervals<Option<Interval>>>>,
    /// How many detections each class has, with which scores.
    scores: [ScoreRange; 3],
    /// Whether every detection states its angle, so that AOS can be computed.
    pub has_orientation: bool,
}

/// Average precision at the three difficulties, percent.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ApValues {
    /// Over 40 points of recall: easy, moderate, hard.
    pub r40: [f64; 3],
    /// Over 11 points of recall.
    pub r11: [f64; 3],
    /// Their 95% intervals over frames, when they were asked for; in JSON `r40_interval` and `r11_interval`.
    #[serde(flatten)]
    pub intervals: Option<ApIntervals<[Option<Interval>; 3]>>,
}

/// AP of every class under one overlap set; in JSON class, metric, recall points.
#[derive(Debug, Clone, Copy)]
pub struct ApTable<'a> {
    report: &'a ApReport,
    set: OverlapSet,
}

/// AP of one class; in JSON a map from metric.
struct ClassTable<'a>(ApTable<'a>, EvaluatedClass);

impl ApReport {
    /// How many curves there are at most.
    pub(super) const CURVES: usize =
        OverlapSet::ALL.len() * Metric::ALL.len() * EvaluatedClass::ALL.len() * Difficulty::ALL.len();

    pub(super) fn new(
        curves: Vec<Option<Curve>>,
        intervals: Vec<Option<ApIntervals<Option<Interval>>>>,
        scores: [ScoreRange; 3],
        has_orientation: bool,
    ) -> Self {
        Self { curves, intervals, scores, has_orientation }
    }

    /// Where a curve of the whole data set stands.
    pub(super) fn place(curve: &CurveSpec) -> usize {
        let CurveSpec { overlaps, metric, class, difficulty, .. } = *curve;
        // In the image the two sets are the same.
        let overlaps = if metric == Metric::Image { OverlapSet::Strict } else { overlaps };
        let row =
            (overlaps as usize * Metric::ALL.len() + metric as usize) * EvaluatedClass::ALL.len() + class as usize;
        row * Difficulty::ALL.len() + difficulty as usize
    }

    /// The scores of the detections of one class.
    pub fn scores(&self, class: EvaluatedClass) -> ScoreRange {
        self.scores[class as usize]
    }

    /// One curve; `None` when no detection of the class has what the metric needs (spec rule 6).
    pub fn curve(
        &self,
        set: OverlapSet,
        metric: Metric,
        class: EvaluatedClass,
        difficulty: Difficulty,
    ) -> Option<&Curve> {
        self.curves.get(Self::place(&CurveSpec::new(set, metric, class, difficulty)))?.as_ref()
    }

    /// AP of one class in one metric; `None` when it is not evaluated.
    pub fn ap(&self, set: OverlapSet, metric: Metric, class: EvaluatedClass) -> Option<ApValues> {
        let values = self.values(set, metric, class, |curve| Some(curve.precision))?;
        let intervals = Difficulty::ALL
            .map(|difficulty| self.intervals[Self::place(&CurveSpec::new(set, metric, class, difficulty))]);
        let has_any = intervals.iter().any(Option::is_some);
        let all = |of: fn(ApIntervals<Option<Interval>>) -> Option<Interval>| intervals.map(|curve| curve.and_then(of));
        let intervals = has_any.then(|| ApIntervals { r40: all(|curve| curve.r40), r11: all(|curve| curve.r11) });
        Some(ApValues { intervals, ..values })
    }

    /// Average orientation similarity of one class; `None` when it is not evaluated or a detection has no angle.
    pub fn aos(&self, class: EvaluatedClass) -> Option<ApValues> {
        self.values(OverlapSet::Strict, Metric::Image, class, |curve| curve.orientation)
    }

    /// The table of one overlap set, for JSON.
    pub fn table(&self, set: OverlapSet) -> ApTable<'_> {
        ApTable { report: self, set }
    }

    fn values(
        &self,
        set: OverlapSet,
        metric: Metric,
        class: EvaluatedClass,
        points: impl Fn(&Curve) -> Option<[f64; super::RECALL_POINTS]>,
    ) -> Option<ApValues> {
        let mut values = ApValues { r40: [0.0; 3], r11: [0.0; 3], intervals: None };
        for difficulty in Difficulty::ALL {
            let points = points(self.curve(set, metric, class, difficulty)?)?;
            values.r40[difficulty as usize] = percent_r40(&points);
            values.r11[difficulty as usize] = percent_r11(&points);
        }
        Some(values)
    }
}

impl Serialize for ApTable<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(EvaluatedClass::ALL.map(|class| (class.name(), ClassTable(*self, class))))
    }
}

impl Serialize for ClassTable<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Self(ApTable { report, set }, class) = *self;
        let mut map = serializer.serialize_map(Some(Metric::ALL.len() + 1))?;
        for metric in Metric::ALL {
            map.serialize_entry(metric.name(), &report.ap(set, metric, class))?;
            if metric == Metric::Image {
                map.serialize_entry("aos", &report.aos(class))?;
            }
        }
        map.end()
    }
}

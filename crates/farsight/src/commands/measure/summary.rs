//! From the evaluator's reports to the figures that are kept.

use std::collections::BTreeMap;

use farsight_eval::ap::{ApReport, Metric, OverlapSet};
use farsight_eval::ranging::{Calibration, Group, OperatingPoint, RangingMetric, RangingReport, SliceErrors};
use farsight_eval::{Difficulty, EvaluatedClass, Interval, Report};

use crate::figures::{AveragePrecision, ClassFigures, DistanceErrors, ErrorBars, Errors, Operating};

const MODERATE: Group = Group::Level(Difficulty::Moderate);

/// Digits of the kept numbers after the point: more than documents show, fewer than another CPU changes.
const DIGITS: f64 = 1e4;

/// Whether any object was found with an error bar: a model has them for all or for none.
pub(super) fn has_error_bars(report: &Report) -> bool {
    let of_class = |class| report.ranging.group(class, MODERATE)?.calibration.as_ref();
    EvaluatedClass::ALL.into_iter().any(|class| of_class(class).is_some())
}

/// The figures of every class with objects. `by_place` is AP ranked by place scores, which need error bars.
pub(super) fn class_figures(report: &Report, by_place: Option<&ApReport>) -> BTreeMap<String, ClassFigures> {
    let classes = EvaluatedClass::ALL.into_iter().filter_map(|class| {
        let moderate = report.ranging.group(class, MODERATE)?;
        let calibration = moderate.calibration.as_ref();
        let by_distance = moderate.by_distance.0.iter().map(|(metres, row)| DistanceErrors {
            metres: (*metres).to_owned(),
            errors: errors(row),
            within_1_sigma: coverage(calibration, metres).map(|bars| bars.within_1_sigma),
        });
        let points = report.operating.classes.iter().find(|(of, _)| *of == class);
        let operating = points.map_or_else(Vec::new, |(_, points)| points.iter().map(operating).collect());
        let figures = ClassFigures {
            all_scores: errors(&moderate.whole),
            error_bars: coverage(calibration, "all"),
            by_distance: by_distance.collect(),
            operating,
            ap: average_precision(&report.ap, class),
            ap_by_place: by_place.map(|by_place| average_precision(by_place, class)),
            baselines: BTreeMap::new(),
        };
        Some((class.name().to_owned(), figures))
    });
    classes.collect()
}

/// Adds the errors of a geometric ranger on the same detections: of cars alone, whose sizes vary least.
pub(super) fn with_baseline(classes: &mut BTreeMap<String, ClassFigures>, name: &str, report: &RangingReport) {
    let class = EvaluatedClass::Car;
    let moderate = report.group(class, MODERATE);
    if let Some((figures, moderate)) = classes.get_mut(class.name()).zip(moderate) {
        figures.baselines.insert(name.to_owned(), errors(&moderate.whole));
    }
}

/// Takes away what labels without distances cannot tell.
pub(super) fn without_distances(figures: &mut ClassFigures) {
    let Errors { objects, found, .. } = figures.all_scores;
    figures.all_scores = Errors { objects, found, mae_m: None, bias_m: None, relative: None, signed_relative: None };
    figures.error_bars = None;
    figures.by_distance.clear();
    figures.baselines.clear();
    for point in &mut figures.operating {
        (point.mae_m, point.relative_median) = (None, None);
        (point.frames_with_objects, point.nearest_missed) = (0, 0);
    }
}

fn errors(slice: &SliceErrors) -> Errors {
    let value = |metric| slice.metrics.get(metric).map(rounded);
    Errors {
        objects: slice.objects,
        found: slice.found,
        mae_m: value(RangingMetric::MaeZ),
        bias_m: value(RangingMetric::BiasZ),
        relative: value(RangingMetric::AbsRelZ),
        signed_relative: value(RangingMetric::BiasRelZ),
    }
}

fn coverage(calibration: Option<&Calibration>, metres: &str) -> Option<ErrorBars> {
    let row = calibration?.rows.iter().find(|row| row.part == metres)?;
    Some(ErrorBars {
        count: row.count,
        within_1_sigma: rounded(row.within_1_sigma),
        within_2_sigma: rounded(row.within_2_sigma),
        mean_sigma_m: rounded(row.mean_sigma_m),
        within_intervals: Some([row.within_50, row.within_68, row.within_90].map(|within| {
            let Interval { low, high } = within.interval;
            [within.share, low, high].map(rounded)
        })),
    })
}

fn operating(point: &OperatingPoint) -> Operating {
    Operating {
        score: rounded(point.score),
        objects: point.objects,
        found: point.found,
        false_alarms_per_frame: rounded(point.false_alarms_per_frame),
        frames_with_objects: point.frames_with_objects,
        nearest_missed: point.nearest_missed,
        mae_m: point.mae_z.map(rounded),
        relative_median: point.median_abs_rel_z.map(rounded),
    }
}

fn average_precision(report: &ApReport, class: EvaluatedClass) -> AveragePrecision {
    let ap = |set, metric| report.ap(set, metric, class).map(|values| values.r40.map(rounded));
    let objects = Difficulty::ALL
        .map(|level| report.curve(OverlapSet::Strict, Metric::Image, class, level).map_or(0, |curve| curve.objects));
    AveragePrecision {
        objects,
        image: ap(OverlapSet::Strict, Metric::Image),
        orientation: report.aos(class).map(|values| values.r40.map(rounded)),
        bev_strict: ap(OverlapSet::Strict, Metric::Bev),
        bev_loose: ap(OverlapSet::Loose, Metric::Bev),
        box3d_strict: ap(OverlapSet::Strict, Metric::Box3d),
        box3d_loose: ap(OverlapSet::Loose, Metric::Box3d),
    }
}

fn rounded(value: f64) -> f64 {
    (value * DIGITS).round() / DIGITS
}

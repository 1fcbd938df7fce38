//! Which charts the page has.

use crate::ap::{Metric, OverlapSet};
use crate::parts::{DISTANCE_BINS, bin_middle_m};
use crate::ranging::{ClassRanging, CoverageRow, Group, GroupRanging, RangingMetric, Share};
use crate::{Difficulty, EvaluatedClass, Report};

use super::chart::{Chart, Series};

/// Colours of the three difficulties, told apart by colour-blind eyes too (Okabe and Ito 2008).
const LEVEL_COLORS: [[u8; 3]; 3] = [[0, 158, 115], [0, 114, 178], [213, 94, 0]];

/// Colour of what curves are compared with.
const REFERENCE_COLOR: [u8; 3] = [120, 120, 120];

/// Bins with fewer found objects are not drawn: their error is an accident.
const MIN_FOUND: usize = 5;

/// Where the axis of distance ends, metres.
const END_M: f64 = 80.0;

/// All charts with the names of their files.
pub(super) fn charts(report: &Report) -> Vec<(String, Chart)> {
    let mut charts = Vec::new();
    for class in EvaluatedClass::ALL {
        for metric in [Metric::Box3d, Metric::Bev, Metric::Image] {
            charts.extend(curve_chart(report, class, metric).map(|c| (format!("{class}_{}_curve", metric.name()), c)));
        }
        let ranging = report.ranging.classes.iter().find(|ranging| ranging.class == class);
        if let Some(ranging) = ranging.filter(|ranging| ranging.groups.iter().any(|group| group.whole.found > 0)) {
            let errors = error_chart(ranging);
            if errors.series.iter().any(|series| !series.points.is_empty()) {
                charts.push((format!("{class}_distance_error"), errors));
            }
            charts.push((format!("{class}_share_found"), share_chart(ranging)));
            charts.extend(coverage_chart(ranging).map(|chart| (format!("{class}_error_bar_coverage"), chart)));
            let by_distance = coverage_by_distance_chart(ranging);
            charts.extend(by_distance.map(|chart| (format!("{class}_error_bars_by_distance"), chart)));
        }
    }
    charts
}

fn curve_chart(report: &Report, class: EvaluatedClass, metric: Metric) -> Option<Chart> {
    let mut series = Vec::new();
    let intervals = report.ap.ap(OverlapSet::Strict, metric, class)?.intervals;
    for (level, color) in Difficulty::ALL.into_iter().zip(LEVEL_COLORS) {
        let interval = intervals.and_then(|intervals| intervals.r40[level as usize]);
        let interval = interval.map_or_else(String::new, |i| format!(" [{:.1}, {:.1}]", i.low, i.high));
        let curve = report.ap.curve(OverlapSet::Strict, metric, class, level)?;
        let points = curve.precision.iter().enumerate().map(|(i, p)| [i as f64 / 40.0, *p]).collect();
        series.push(Series {
            name: format!("{level} {:.1}{interval}", curve.ap_r40()),
            color,
            points,
            band: Vec::new(),
            is_reference: false,
        });
    }
    let limit = OverlapSet::Strict.min_overlap(class, metric);
    let with_intervals = if intervals.is_some() { ", with 95% intervals" } else { "" };
    Some(Chart {
        title: format!("{class}, {} overlap above {limit}: AP R40, percent{with_intervals}", metric.name()),
        x_label: "recall".to_owned(),
        y_label: "precision".to_owned(),
        x_end: 1.0,
        y_end: 1.0,
        series,
    })
}

fn error_chart(ranging: &ClassRanging) -> Chart {
    let series: Vec<_> = level_series(ranging, RangingMetric::MaeZ, MIN_FOUND);
    let tops = series.iter().flat_map(|s| s.points.iter().map(|p| p[1]).chain(s.band.iter().map(|band| band[1])));
    let highest = tops.fold(0.0_f64, f64::max);
    Chart {
        title: format!("{}: error of distance, 95% intervals; {MIN_FOUND} found or more", ranging.class),
        x_label: "true distance z, m".to_owned(),
        y_label: "mean absolute error of z, m".to_owned(),
        x_end: END_M,
        y_end: if highest > 0.0 { 1.1 * highest } else { 1.0 },
        series,
    }
}

fn share_chart(ranging: &ClassRanging) -> Chart {
    Chart {
        title: format!("{}: share of the objects found", ranging.class),
        x_label: "true distance z, m".to_owned(),
        y_label: "found / objects".to_owned(),
        x_end: END_M,
        y_end: 1.05,
        series: level_series(ranging, RangingMetric::Share, 0),
    }
}

/// How often the truth lies within k standard deviations, against how often it should; `None` without error bars.
fn coverage_chart(ranging: &ClassRanging) -> Option<Chart> {
    let calibrated = ranging.groups.iter().zip(LEVEL_COLORS).filter_map(|(group, color)| {
        let calibration = group.calibration.as_ref()?;
        let objects = calibration.rows.first().map_or(0, |all| all.count);
        let points = calibration.coverage.iter().map(|point| [point.expected, point.observed]).collect();
        let name = format!("{}: {objects} objects", group.group.name());
        Some(Series { name, color, points, band: Vec::new(), is_reference: false })
    });
    let calibrated: Vec<_> = calibrated.collect();
    let ideal = Series {
        name: "expected".to_owned(),
        color: REFERENCE_COLOR,
        points: vec![[0.0, 0.0], [1.0, 1.0]],
        band: Vec::new(),
        is_reference: true,
    };
    (!calibrated.is_empty()).then(|| Chart {
        title: format!("{}: share of true z within k sigma; below the line: too sure", ranging.class),
        x_label: "expected share (normal distribution: 1 sigma 0.68, 2 sigma 0.95)".to_owned(),
        y_label: "observed share".to_owned(),
        x_end: 1.0,
        y_end: 1.0,
        series: [ideal].into_iter().chain(calibrated).collect(),
    })
}

/// One of the shares of a row.
type ShareOf = fn(&CoverageRow) -> Share;

/// How often the truth lies in the 50%, 68% and 90% intervals by distance; `None` without error bars.
fn coverage_by_distance_chart(ranging: &ClassRanging) -> Option<Chart> {
    let group = ranging.groups.iter().find(|group| group.group == Group::Level(Difficulty::Moderate))?;
    let rows = &group.calibration.as_ref()?.rows;
    let filled = || {
        let bins = DISTANCE_BINS.iter().enumerate();
        bins.filter_map(|(bin, name)| Some((bin, rows.iter().find(|row| row.part == *name && row.count >= MIN_FOUND)?)))
    };
    let shares: [(&str, f64, ShareOf); 3] = [
        ("90% interval", 0.90, |row| row.within_90),
        ("68% interval", 0.68, |row| row.within_68),
        ("50% interval", 0.50, |row| row.within_50),
    ];
    let series = shares.iter().zip(LEVEL_COLORS).flat_map(|((name, expected, share), color)| {
        let observed = Series {
            name: (*name).to_owned(),
            color,
            points: filled().map(|(bin, row)| [bin_middle_m(bin), share(row).share]).collect(),
            band: filled().map(|(_, row)| share(row).interval).map(|i| [i.low, i.high]).collect(),
            is_reference: false,
        };
        let expected = Series {
            name: format!("{:.0}%", 100.0 * expected),
            color,
            points: vec![[0.0, *expected], [END_M, *expected]],
            band: Vec::new(),
            is_reference: true,
        };
        [observed, expected]
    });
    (filled().count() > 0).then(|| Chart {
        title: format!("{}, moderate: share of true z in the error bars' intervals", ranging.class),
        x_label: "true distance z, m".to_owned(),
        y_label: "observed share".to_owned(),
        x_end: END_M,
        y_end: 1.05,
        series: series.collect(),
    })
}

fn level_series(ranging: &ClassRanging, figure: RangingMetric, min_found: usize) -> Vec<Series> {
    let of_group = |(group, color): (&GroupRanging, [u8; 3])| {
        let bins = group.by_distance.0.iter().enumerate();
        let filled = bins.filter(|(_, (_, errors))| errors.objects > 0 && errors.found >= min_found);
        let (mut points, mut band) = (Vec::new(), Vec::new());
        for (bin, (_, errors)) in filled {
            let Some(value) = errors.metrics.get(figure) else { continue };
            points.push([bin_middle_m(bin), value]);
            band.extend(errors.intervals.and_then(|all| all.get(figure)).map(|i| [i.low, i.high]));
        }
        // A band needs an interval at every point.
        if band.len() != points.len() {
            band.clear();
        }
        Series { name: group.group.name().to_owned(), color, points, band, is_reference: false }
    };
    ranging.groups.iter().zip(LEVEL_COLORS).map(of_group).collect()
}

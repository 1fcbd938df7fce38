//! The report as a table for a terminal.

mod comparison;
mod oracle;

pub use comparison::comparison_lines;
pub use oracle::oracle_lines;

use crate::ap::{ApIntervals, ApReport, ApValues, Metric, OverlapSet};
use crate::bootstrap::Interval;
use crate::ranging::{
    FIXED_RECALL, GroupRanging, OperatingPoint, OperatingPoints, RangingMetric, RangingReport, SliceErrors,
};
use crate::{Difficulty, EvaluatedClass, Report};

/// Objects that it takes for AP to be able to reach 100 (spec kitti-eval.md, rule 20).
const OBJECTS_FOR_100: usize = 41;

/// Results whose scores all reach this were probably cut at a score; detectors give lower ones to what is doubtful.
const CUT_FROM: f64 = 0.1;

/// With fewer detections the lowest score is an accident.
const ENOUGH_DETECTIONS: usize = 50;

/// The tables of a report, line by line.
pub fn lines(report: &Report) -> Vec<String> {
    let mut lines = vec![format!("{} frame{}", report.frames, if report.frames == 1 { "" } else { "s" })];
    for class in EvaluatedClass::ALL {
        let rows = ap_rows(&report.ap, class);
        if !rows.is_empty() {
            lines.push(String::new());
            lines.push(
                format!("{:<24}{:^36}    {:^36}", format!("AP {class}, percent"), "R40", "R11").trim_end().to_owned(),
            );
            let levels = Difficulty::ALL.map(|level| format!("{:>12}", level.name())).concat();
            lines.push(format!("{:<24}{levels}    {levels}", "  overlap more than"));
            lines.extend(rows);
        }
    }
    lines.extend(ranging_lines(&report.ranging));
    lines.extend(operating_lines(&report.operating));
    lines
}

/// What a reader of the figures must know, one line each.
pub fn notes(report: &Report) -> Vec<String> {
    let mut notes = Vec::new();
    let evaluated = |class| Metric::ALL.map(|metric| report.ap.ap(OverlapSet::Strict, metric, class).is_some());
    for class in EvaluatedClass::ALL {
        let metrics = evaluated(class);
        if metrics == [false; 3] {
            notes.push(format!(
                "{class}: not evaluated, as there is no usable detection of the class (the devkit writes nothing either)"
            ));
        } else if !metrics[1] || !metrics[2] {
            notes.push(format!("{class}: no detection has a 3D box; bev and 3d are not evaluated where that is so"));
        }
        for level in Difficulty::ALL {
            let curve = report.ap.curve(OverlapSet::Strict, Metric::Image, class, level);
            match curve.map(|curve| curve.objects) {
                Some(0) => notes.push(format!("{class} {level}: no object counts; its AP means nothing")),
                Some(objects) if objects < OBJECTS_FOR_100 => notes.push(format!(
                    "{class} {level}: {objects} object{}; with fewer than {OBJECTS_FOR_100} AP (R40) cannot exceed {:.1}",
                    if objects == 1 { "" } else { "s" },
                    2.5 * (objects - 1) as f64
                )),
                _ => {}
            }
        }
    }
    for class in EvaluatedClass::ALL {
        notes.extend(cut_note(&report.ap, class));
        notes.extend(recall_note(&report.ranging, class));
    }
    if !report.ap.has_orientation {
        notes.push(
            "a detection has alpha -10 (unknown): AOS is not computed for any class, as in the devkit".to_owned(),
        );
    }
    notes
}

/// That results were cut at a score, as far as the scores show it.
fn cut_note(report: &ApReport, class: EvaluatedClass) -> Option<String> {
    let scores = report.scores(class);
    // A score above 1 is no probability, and nothing is known of where doubt begins.
    let is_cut = scores.count >= ENOUGH_DETECTIONS && scores.lowest >= CUT_FROM && scores.highest <= 1.0;
    let curve = report.curve(OverlapSet::Strict, Metric::Image, class, Difficulty::Moderate)?;
    let end = curve.thresholds.last()?;
    let recall = end.true_positives as f64 / curve.objects as f64;
    // Rounded down, or "below" would not be true of it.
    let lowest = (100.0 * scores.lowest).floor() / 100.0;
    (is_cut && end.false_negatives > 0).then(|| {
        format!(
            "{class}: no detection has a score below {lowest:.2}; if they were cut there, AP is too low: the moderate 2d \
             curve ends at a recall of {recall:.3}, and precision counts as 0 beyond"
        )
    })
}

/// That the recall at which detectors are compared is not reached.
fn recall_note(report: &RangingReport, class: EvaluatedClass) -> Option<String> {
    let of_class = report.classes.iter().find(|of_class| of_class.class == class)?;
    let lacks = |group: &&GroupRanging| group.whole.found > 0 && group.fixed_recall.is_none();
    let lacking: Vec<_> = of_class.groups.iter().filter(lacks).map(|group| group.group.name()).collect();
    (!lacking.is_empty()).then(|| {
        format!(
            "{class}: fewer than {:.0}% of the objects are found ({}), so there are no errors at that recall",
            100.0 * FIXED_RECALL,
            lacking.join(", ")
        )
    })
}

fn ap_rows(report: &ApReport, class: EvaluatedClass) -> Vec<String> {
    let mut rows = Vec::new();
    let mut push = |name: &str, limit: f64, values: Option<ApValues>| {
        rows.extend(values.into_iter().flat_map(|values| {
            let cells = |three: [f64; 3]| three.map(|ap| format!("{ap:>12.2}")).concat();
            let row =
                format!("{:<24}{}    {}", format!("  {name:<4} {limit:.2}"), cells(values.r40), cells(values.r11));
            std::iter::once(row).chain(values.intervals.map(|intervals| interval_row(&intervals)))
        }));
    };
    for set in OverlapSet::ALL {
        for metric in Metric::ALL {
            let limit = set.min_overlap(class, metric);
            if set == OverlapSet::Loose && metric == Metric::Image {
                continue;
            }
            push(metric.name(), limit, report.ap(set, metric, class));
            if metric == Metric::Image {
                push("aos", limit, report.aos(class));
            }
        }
    }
    rows
}

/// The 95% intervals below a row of AP.
fn interval_row(intervals: &ApIntervals<[Option<Interval>; 3]>) -> String {
    let cell = |interval: Option<Interval>| {
        let text = interval.map_or_else(|| "-".to_owned(), |i| format!("{:.1}-{:.1}", i.low, i.high));
        format!("{text:>12}")
    };
    let cells = |three: [Option<Interval>; 3]| three.map(cell).concat();
    format!("{:<24}{}    {}", "    95% interval", cells(intervals.r40), cells(intervals.r11))
}

fn ranging_lines(report: &RangingReport) -> Vec<String> {
    let mut lines = Vec::new();
    for class in &report.classes {
        lines.push(String::new());
        let Some(all) = class.groups.iter().max_by_key(|group| group.whole.objects) else { continue };
        if all.whole.found == 0 {
            // No error to speak of, and a share that must not go unsaid.
            lines.push(format!("distance of {}s: none of {} objects found", class.class, all.whole.objects));
            continue;
        }
        let has_intervals = class.groups.iter().any(|group| group.whole.intervals.is_some());
        let intervals = if has_intervals { "; 95% intervals over frames" } else { "" };
        lines.push(format!("distance of {}s, metres{intervals}", class.class));
        lines.push(columns());
        for group in &class.groups {
            lines.push(slice_line(group.group.name(), &group.whole));
            if let Some(fixed) = &group.fixed_recall {
                lines.push(slice_line(&format!("  at recall {FIXED_RECALL:.1}"), &fixed.errors));
            }
        }
        if let Some(moderate) = class.groups.iter().find(|group| group.group.name() == "moderate") {
            lines.extend(distance_lines(moderate));
        }
    }
    lines
}

/// What each limit of score gives, in steps that fit a screen: every other one, until nothing is left.
fn operating_lines(operating: &OperatingPoints) -> Vec<String> {
    let mut lines = Vec::new();
    for (class, rows) in &operating.classes {
        let has_any = |row: &&OperatingPoint| row.found > 0 || row.false_alarms_per_frame > 0.0;
        let shown: Vec<_> = rows.iter().skip(1).step_by(2).take_while(has_any).collect();
        if !shown.is_empty() {
            lines.push(String::new());
            lines.push(format!(
                "{class}s at moderate by least score; false alarms are detections that are none of anything"
            ));
            lines.push(format!(
                "{:<20}{:>8}{:>8}{:>21}{:>10}{:>16}",
                "  score from", "found", "share", "false alarms/frame", "MAE z", "median AbsRel"
            ));
            lines.extend(shown.into_iter().map(operating_line));
        }
    }
    lines
}

fn operating_line(row: &OperatingPoint) -> String {
    let value = |value: Option<f64>, digits: usize| value.map_or_else(|| "-".to_owned(), |v| format!("{v:.digits$}"));
    format!(
        "  {:<18.2}{:>8}{:>8.3}{:>21.3}{:>10}{:>16}",
        row.score,
        row.found,
        row.found as f64 / row.objects as f64,
        row.false_alarms_per_frame,
        value(row.mae_z, 3),
        value(row.median_abs_rel_z, 4)
    )
}

/// The errors of one class at moderate difficulty, as a whole and by distance; nothing for a class without such
/// objects.
pub fn moderate_lines(report: &RangingReport, class: EvaluatedClass) -> Vec<String> {
    let classes = report.classes.iter().filter(|of_class| of_class.class == class);
    let groups = classes.flat_map(|of_class| &of_class.groups);
    groups
        .filter(|group| group.group.name() == "moderate" && group.whole.found > 0)
        .flat_map(|group| [vec![columns(), slice_line("moderate", &group.whole)], distance_lines(group)].concat())
        .collect()
}

/// The names of the columns of [`slice_line`].
fn columns() -> String {
    format!(
        "{:<20}{:>8}{:>8}{:>8}  {:<21}{:<21}{:>7}{:>8}{:>8}",
        "", "objects", "found", "share", "  MAE z", "  RMSE z", "bias z", "AbsRel", "MAE gr."
    )
}

fn distance_lines(group: &GroupRanging) -> Vec<String> {
    let filled = group.by_distance.0.iter().filter(|(_, errors)| errors.objects > 0);
    let mut lines: Vec<_> = filled.map(|(bin, errors)| slice_line(&format!("  moderate {bin} m"), errors)).collect();
    for row in group.calibration.iter().flat_map(|calibration| &calibration.rows) {
        lines.push(format!(
            "  error bars {:<8} {:>6} objects, mean {:.2} m; truth within 1 sigma {:.1}% (normal: 68.3%), \
             2 sigma {:.1}% (95.4%)",
            row.distance,
            row.count,
            row.mean_sigma_m,
            100.0 * row.within_1_sigma,
            100.0 * row.within_2_sigma
        ));
    }
    lines
}

fn slice_line(name: &str, errors: &SliceErrors) -> String {
    let value = |figure: RangingMetric, digits: usize| {
        errors.metrics.get(figure).map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
    };
    let with_interval = |figure: RangingMetric| {
        let interval = errors.intervals.and_then(|all| all.get(figure));
        let interval = interval.map_or_else(String::new, |i| format!(" [{:.3}, {:.3}]", i.low, i.high));
        format!("{:>5}{interval}", value(figure, 3))
    };
    let row = format!(
        "{name:<20}{:>8}{:>8}{:>8}  {:<21}{:<21}{:>7}{:>8}{:>8}",
        errors.objects,
        errors.found,
        value(RangingMetric::Share, 3),
        with_interval(RangingMetric::MaeZ),
        with_interval(RangingMetric::RmseZ),
        value(RangingMetric::BiasZ, 3),
        value(RangingMetric::AbsRelZ, 4),
        value(RangingMetric::MaeGround, 3)
    );
    row.trim_end().to_owned()
}

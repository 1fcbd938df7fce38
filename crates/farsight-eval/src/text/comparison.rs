//! The comparison with other results, line by line.

use crate::EvaluatedClass;
use crate::bootstrap::Interval;
use crate::compare::{ApComparisonRow, Comparison};
use crate::ranging::RangingMetric;

/// With fewer objects an interval over frames is too narrow to draw a conclusion from.
const FEW_OBJECTS: usize = 10;

/// The comparison with another result set: AP by level, in space also by part, and distances of groups as a whole.
pub fn comparison_lines(comparison: &Comparison) -> Vec<String> {
    if comparison.identical {
        return vec!["identical: both results have the same detections in every frame".to_owned()];
    }
    let mut lines = ap_lines(&comparison.ap);
    lines.extend(ranging_lines(comparison));
    lines
}

fn ap_lines(rows: &[ApComparisonRow]) -> Vec<String> {
    let mut lines = Vec::new();
    for class in EvaluatedClass::ALL {
        // Parts in space are what people ask for; the others are in the JSON.
        let is_shown = |row: &&ApComparisonRow| {
            let found_any = row.value > 0.0 || row.against > 0.0;
            row.class == class && found_any && (row.division == "all" || row.metric == "3d")
        };
        let shown: Vec<_> = rows.iter().filter(is_shown).collect();
        if shown.is_empty() {
            continue;
        }
        lines.push(format!(
            "{:<34}{:>8} {:>9} {:>9}   difference with its 95% interval over frames",
            format!("AP {class}, percent, R40"),
            "objects",
            "these",
            "others"
        ));
        lines.extend(shown.into_iter().map(ap_line));
        lines.push(String::new());
    }
    lines
}

fn ap_line(row: &ApComparisonRow) -> String {
    let part = match row.division {
        "height" => format!(", {} px high", row.part),
        "distance" => format!(", at {} m", row.part),
        "occlusion" => format!(", occlusion {}", row.part),
        _ => String::new(),
    };
    let interval = row.interval.map_or_else(String::new, |i| format!(" [{:+.2}, {:+.2}]", i.low, i.high));
    format!(
        "{:<34}{:>8} {:>9.2} {:>9.2}   {:+.2}{interval}  {}",
        format!("  {:<4} {:.2} {}{part}", row.metric, row.overlap, row.group),
        row.objects,
        row.value,
        row.against,
        row.difference,
        verdict([row.value, row.against], row.objects, row.interval)
    )
}

fn ranging_lines(comparison: &Comparison) -> Vec<String> {
    const SHOWN: [RangingMetric; 5] = [
        RangingMetric::Share,
        RangingMetric::MaeZ,
        RangingMetric::RmseZ,
        RangingMetric::BiasZ,
        RangingMetric::MaeGround,
    ];
    let mut lines = vec![
        "these results and the others (errors on objects that both found)".to_owned(),
        format!("  {:<12}{:>9} {:>9}   difference with its 95% interval over frames", "", "these", "others"),
    ];
    for row in comparison.rows.iter().filter(|row| row.distance == "all" && row.objects > 0) {
        lines
            .push(format!("{} {}: {} objects, {} found by both", row.class, row.group, row.objects, row.found_by_both));
        for figure in SHOWN {
            let Some(d) = row.metrics.get(figure) else { continue };
            let interval = d.interval.map_or_else(String::new, |i| format!(" [{:+.4}, {:+.4}]", i.low, i.high));
            let objects = if figure == RangingMetric::Share { row.objects } else { row.found_by_both };
            lines.push(format!(
                "  {:<12}{:>9.4} {:>9.4}   {:+.4}{interval}  {}",
                figure.name(),
                d.value,
                d.against,
                d.difference,
                verdict([d.value, d.against], objects, d.interval)
            ));
        }
    }
    lines
}

/// Whether a difference is real, in words.
pub(super) fn verdict([value, against]: [f64; 2], objects: usize, interval: Option<Interval>) -> &'static str {
    match interval.is_some_and(|interval| interval.excludes_zero()) {
        _ if value.total_cmp(&against).is_eq() => "the same",
        _ if objects < FEW_OBJECTS => "too few objects to say",
        true => "differs",
        false => "could be chance",
    }
}

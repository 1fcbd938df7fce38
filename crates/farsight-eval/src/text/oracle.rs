//! What the truth of some parts would bring, line by line.

use super::comparison::verdict;
use crate::ap::{Metric, OverlapSet};
use crate::compare::ApComparisonRow;
use crate::oracle::{OraclePart, OracleRow};
use crate::{Difficulty, EvaluatedClass};

/// The columns of the table.
const COLUMNS: [(Metric, OverlapSet); 4] = [
    (Metric::Box3d, OverlapSet::Strict),
    (Metric::Box3d, OverlapSet::Loose),
    (Metric::Bev, OverlapSet::Strict),
    (Metric::Bev, OverlapSet::Loose),
];

/// AP at moderate with some parts of every matched detection replaced by the truth, class by class.
pub fn oracle_lines(rows: &[OracleRow]) -> Vec<String> {
    let mut lines = Vec::new();
    for class in EvaluatedClass::ALL {
        let of_class: Vec<_> = rows.iter().filter_map(|row| Some((row, columns(row, class)?))).collect();
        let Some((_, first)) = of_class.first() else { continue };
        let headings = first.map(|cell| format!("{:>10}", format!("{} {:.2}", cell.metric, cell.overlap))).concat();
        lines.push(format!("AP {class} moderate, R40, if the truth stood in for"));
        lines.push(format!("{:<28}{headings}   gain at {} {:.2}", "", first[0].metric, first[0].overlap));
        lines.push(format!("  {:<26}{}", "nothing", cells(*first, |cell| cell.against)));
        for (row, columns) in of_class {
            let gain = columns[0];
            let interval = gain.interval.map_or_else(String::new, |i| format!(" [{:+.2}, {:+.2}]", i.low, i.high));
            let name = row.parts.iter().map(|part| OraclePart::name(*part)).collect::<Vec<_>>().join(" + ");
            lines.push(format!(
                "  {name:<26}{}   {:+.2}{interval}  {}",
                cells(columns, |cell| cell.value),
                gain.difference,
                verdict([gain.value, gain.against], gain.objects, gain.interval)
            ));
        }
        lines.push(String::new());
    }
    lines.pop();
    lines
}

/// The cells of one class in the order of [`COLUMNS`].
fn columns(row: &OracleRow, class: EvaluatedClass) -> Option<[&ApComparisonRow; 4]> {
    let of_class = || row.ap.iter().filter(|cell| cell.class == class && cell.group == Difficulty::Moderate);
    let [a, b, c, d] = COLUMNS.map(|(metric, overlaps)| {
        let overlap = overlaps.min_overlap(class, metric);
        of_class().find(|cell| cell.metric == metric.name() && cell.overlap.total_cmp(&overlap).is_eq())
    });
    Some([a?, b?, c?, d?])
}

fn cells(columns: [&ApComparisonRow; 4], value: impl Fn(&ApComparisonRow) -> f64) -> String {
    columns.map(|cell| format!("{:>10.2}", value(cell))).concat()
}

//! How often the truth lies within the error bars, line by line.

use crate::ranging::{ClassRanging, CoverageRow, Share};

/// The error bars of one class: at moderate by distance, and of the hard objects by what hides them.
pub(super) fn coverage_lines(class: &ClassRanging) -> Vec<String> {
    let calibration = |name: &str| {
        let group = class.groups.iter().find(|group| group.group.name() == name);
        group.and_then(|group| group.calibration.as_ref())
    };
    let by_distance = calibration("moderate").into_iter().flat_map(|calibration| &calibration.rows);
    let by_occlusion = calibration("hard").into_iter().flat_map(|calibration| &calibration.by_occlusion);
    let mut rows = by_distance
        .map(|row| {
            let name = if row.part == "all" { "moderate".to_owned() } else { format!("  moderate {} m", row.part) };
            coverage_line(&name, row)
        })
        .chain(by_occlusion.map(|row| coverage_line(&format!("  hard, occlusion {}", row.part), row)))
        .peekable();
    if rows.peek().is_none() {
        return Vec::new();
    }
    let heading = format!(
        "{:<24}{:>8}{:>14}{:>18}{:>18}{:>18}",
        format!("error bars of {}s", class.class),
        "objects",
        "mean sigma",
        "true z in 50%",
        "in 68%",
        "in 90%"
    );
    std::iter::once(heading).chain(rows).collect()
}

/// Shares in percent, each with its 95% interval.
fn coverage_line(name: &str, row: &CoverageRow) -> String {
    let cell = |Share { share, interval }: Share| {
        format!("{:.0}% [{:.0}, {:.0}]", 100.0 * share, 100.0 * interval.low, 100.0 * interval.high)
    };
    let [within_50, within_68, within_90] = [row.within_50, row.within_68, row.within_90].map(cell);
    format!("{name:<24}{:>8}{:>12.2} m{within_50:>18}{within_68:>18}{within_90:>18}", row.count, row.mean_sigma_m)
}

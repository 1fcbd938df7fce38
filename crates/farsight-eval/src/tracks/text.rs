//! The report of tracks for people.

use std::fmt::Write as _;

use super::report::{Difference, TracksReport};
use crate::tracking::TrackingMetrics;

/// Tables of what was found.
pub fn text(report: &TracksReport) -> String {
    let mut text = "             HOTA   DetA   AssA   LocA   MOTA   MOTP   IDF1  switches  fragments\n".to_owned();
    for (name, metrics) in [("in the image", &report.image), ("in space", &report.space)] {
        text += &row(name, metrics);
    }
    let errors = &report.errors;
    let number =
        |value: Option<f64>, unit: &str| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.2}{unit}"));
    let shares = |value: Option<[f64; 3]>| {
        value.map_or_else(
            || "-".to_owned(),
            |value| {
                let [a, b, c] = value.map(|share| 100.0 * share);
                format!("{a:.0}% / {b:.0}% / {c:.0}%")
            },
        )
    };
    let [near, far] = errors.closing_mae_mps.map(|value| number(value, " m/s"));
    let [ground_near, ground_far] = errors.speed_mae_mps.map(|value| number(value, " m/s"));
    // Writing to a string cannot fail.
    let _ = write!(
        text,
        "\n{} matches in the image\n\
         distance: MAE {}, median relative error {}; inside 50 / 68 / 90% intervals {}\n\
         closing speed after 1 s: MAE {near} below 30 m, {far} from 30 to 60 m; inside {}\n\
         speed over the ground after 1 s: MAE {ground_near} below 30 m, {ground_far} from 30 to 60 m; inside {}\n",
        errors.count,
        number(errors.depth_mae_m, " m"),
        number(errors.depth_relative.map(|share| 100.0 * share), "%"),
        shares(errors.depth_coverage),
        shares(errors.closing_coverage),
        shares(errors.speed_coverage),
    );
    for bin in &errors.ttc {
        let _ = writeln!(
            text,
            "time to collision {}: told in {} of {}, mean relative error {}, motion in depth {}",
            bin.name,
            bin.told,
            bin.count,
            number(bin.relative_error.map(|share| 100.0 * share), "%"),
            number(bin.motion_in_depth, ""),
        );
    }
    let held = number(errors.ttc_coverage.map(|share| 100.0 * share), "%");
    let _ = writeln!(text, "time to collision inside 90% intervals: {held}");
    text += "\nsequence      HOTA 2D  HOTA 3D  switches  distance MAE  closing MAE below 30 m\n";
    for (name, image, space, errors) in &report.sequences {
        let _ = writeln!(
            text,
            "{name:12} {:>7.1}% {:>7.1}% {:>9} {:>13} {:>23}",
            100.0 * image.hota,
            100.0 * space.hota,
            image.switches,
            number(errors.depth_mae_m, " m"),
            number(errors.closing_mae_mps[0], " m/s"),
        );
    }
    text
}

fn row(name: &str, metrics: &TrackingMetrics) -> String {
    let TrackingMetrics { hota, det_a, ass_a, loc_a, mota, motp, idf1, switches, fragments, .. } = metrics;
    let [hota, det_a, ass_a, loc_a, mota, motp, idf1] =
        [hota, det_a, ass_a, loc_a, mota, motp, idf1].map(|share| format!("{:.1}%", 100.0 * share));
    format!(
        "{name:12} {hota:>6} {det_a:>6} {ass_a:>6} {loc_a:>6} {mota:>6} {motp:>6} {idf1:>6}  {switches:>8}  {fragments:>9}\n"
    )
}

/// Tracks against others, paired by sequence.
pub fn differences_text(differences: &[Difference]) -> String {
    let mut text = String::new();
    for Difference { name, means: [ours, theirs], interval } in differences {
        let interval =
            interval.map_or_else(String::new, |range| format!(" (95%: {:+.3} to {:+.3})", range.low, range.high));
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{name}: {ours:.3} against {theirs:.3}, {:+.3}{interval}", ours - theirs);
    }
    text
}

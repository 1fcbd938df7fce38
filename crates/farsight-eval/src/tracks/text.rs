//! The report of tracks for people.

use std::fmt::Write as _;

use super::report::{Difference, TracksReport};
use crate::tracking::TrackingMetrics;

/// Tables of what was found.
pub fn text(report: &TracksReport) -> String {
    let mut text =
        "             HOTA   DetA   AssA   LocA   MOTA   MOTP   IDF1   MT   PT   ML  switches  fragments\n".to_owned();
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
    let lives = &report.lifetimes;
    let seconds = |value: Option<f64>| number(value, " s");
    let _ = writeln!(
        text,
        "{} of {} objects told of, one identity for {} of {}; after {} (TID), with a speed after {}; longest gap {} (LGD)",
        lives.told,
        lives.objects,
        seconds(lives.track_s),
        seconds(lives.present_s),
        seconds(lives.told_after_s),
        seconds(lives.speed_after_s),
        seconds(lives.longest_gap_s),
    );
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
    let TrackingMetrics { mostly_tracked: mt, partially_tracked: pt, mostly_lost: ml, .. } = metrics;
    let [hota, det_a, ass_a, loc_a, mota, motp, idf1] =
        [hota, det_a, ass_a, loc_a, mota, motp, idf1].map(|share| format!("{:.1}%", 100.0 * share));
    format!(
        "{name:12} {hota:>6} {det_a:>6} {ass_a:>6} {loc_a:>6} {mota:>6} {motp:>6} {idf1:>6} {mt:>4} {pt:>4} {ml:>4}  \
         {switches:>8}  {fragments:>9}\n"
    )
}

/// The figures of all sequences together, for a table: what it is, and the figure.
pub fn rows(report: &TracksReport) -> Vec<[String; 2]> {
    let errors = &report.errors;
    let number = |value: Option<f64>, unit: &str| value.map_or_else(dash, |value| format!("{value:.2}{unit}"));
    let both = |[near, far]: [Option<f64>; 2]| format!("{}; {}", number(near, " m/s"), number(far, " m/s"));
    let percents = |shares: &[f64]| {
        let shares: Vec<String> = shares.iter().map(|share| format!("{:.0}", 100.0 * share)).collect();
        format!("{}%", shares.join(" / "))
    };
    let held = |value: Option<[f64; 3]>| value.map_or_else(dash, |shares| percents(&shares));
    let whole = |share: Option<f64>| share.map_or_else(dash, |share| percents(&[share]));
    let (image, space, lives) = (&report.image, &report.space, &report.lifetimes);
    let lengths = format!("{} of {}", number(lives.track_s, " s"), number(lives.present_s, " s"));
    let delays = format!("{}; {}", number(lives.told_after_s, " s"), number(lives.speed_after_s, " s"));
    let row = |what: &str, figure: String| [what.to_owned(), figure];
    let mut rows = vec![
        row("matches in the image", errors.count.to_string()),
        row("distance: MAE", number(errors.depth_mae_m, " m")),
        row("its 50 / 68 / 90% intervals hold", held(errors.depth_coverage)),
        row("closing speed: MAE after a second, below 30 m; to 60 m", both(errors.closing_mae_mps)),
        row("its 50 / 68 / 90% intervals hold, after a second", held(errors.closing_coverage)),
        row("speed over the ground: MAE after a second, below 30 m; to 60 m", both(errors.speed_mae_mps)),
    ];
    rows.extend(errors.ttc.iter().map(|bin| {
        let figure = format!("{} (told in {} of {})", whole(bin.relative_error), bin.told, bin.count);
        row(&format!("time to collision, {}: mean relative error", bin.name), figure)
    }));
    rows.extend([
        row("90% intervals of time to collision hold", whole(errors.ttc_coverage)),
        row("HOTA in space; in the image", format!("{:.1}%; {:.1}%", 100.0 * space.hota, 100.0 * image.hota)),
        row("IDF1 in space; in the image", format!("{:.1}%; {:.1}%", 100.0 * space.idf1, 100.0 * image.idf1)),
        row("identity switches in the image", image.switches.to_string()),
        row(
            "objects mostly tracked; partially; mostly lost",
            format!("{}; {}; {}", image.mostly_tracked, image.partially_tracked, image.mostly_lost),
        ),
        row("objects have one identity, of the time that they are there", lengths),
        row("told after (TID); with a speed after", delays),
        row("longest gap (LGD)", number(lives.longest_gap_s, " s")),
    ]);
    rows
}

fn dash() -> String {
    "-".to_owned()
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

//! A page with the course of each track: distance and closing speed, as they are and as they are told.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use super::errors::Sample;
use super::report::TracksReport;
use super::sequence::JudgedSequence;
use super::text::text;

/// Size of a plot, and what its axes take, pixels.
const WIDTH: f64 = 420.0;
const HEIGHT: f64 = 170.0;
const MARGIN: f64 = 34.0;

/// Tracks that are shown at most, and frames that one must have.
const MAX_SHOWN: usize = 60;
const MIN_FRAMES: usize = 8;

/// 90% of a normal distribution, standard deviations.
const NINETY: f64 = 1.645;

/// One object of the truth and what was told of it.
struct Course<'a> {
    sequence: &'a str,
    id: u64,
    samples: Vec<&'a Sample>,
    /// Mean of |error| / depth.
    error: f64,
}

/// The page as HTML, without anything beside it; the worst tracks first.
pub fn page(report: &TracksReport, sequences: &[JudgedSequence]) -> String {
    let mut courses: Vec<Course> = sequences.iter().flat_map(courses).collect();
    courses.sort_by(|a, b| b.error.total_cmp(&a.error));
    let mut html = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>Tracks</title>\
         <style>body{{font:14px sans-serif;margin:1.5em;max-width:960px}}svg{{background:#fff;margin:2px}}\
         .t{{stroke:#000;fill:none;stroke-width:1.5}}.s{{stroke:#06c;fill:none;stroke-width:1.5}}\
         .b{{fill:#06c;opacity:.18}}.a{{stroke:#ccc}}text{{font-size:11px}}</style>\
         <h1>Tracks</h1><pre>{}</pre><p>Black: as it is. Blue: as it is told, with its 90% interval. By the mean relative \
         error of the distance; {} of {} objects with {MIN_FRAMES} frames or more.</p>",
        escaped(&text(report)),
        courses.len().min(MAX_SHOWN),
        courses.len()
    );
    for course in courses.iter().take(MAX_SHOWN) {
        let told: Vec<u64> = course.samples.iter().map(|one| one.ids[1]).fold(Vec::new(), |mut ids, id| {
            if ids.last() != Some(&id) {
                ids.push(id);
            }
            ids
        });
        // Writing to a string cannot fail.
        let _ = write!(
            html,
            "<h3>{}, object {}: {:.1}% off, told as {told:?}</h3>",
            escaped(course.sequence),
            course.id,
            100.0 * course.error
        );
        let depth = |one: &Sample| {
            let told = one.depth_m + one.depth[0]?;
            Some([one.depth_m, told, NINETY * one.depth[1].unwrap_or(0.0)])
        };
        let closing = |one: &Sample| {
            let ([off, sigma], known) = (one.closing?, one.true_closing_mps?);
            Some([known, known + off, NINETY * sigma])
        };
        html += &plot("distance, m", &course.samples, depth);
        html += &plot("closing speed, m/s", &course.samples, closing);
    }
    html + "</html>\n"
}

fn courses<'a>(sequence: &'a JudgedSequence) -> Vec<Course<'a>> {
    let mut by_id: BTreeMap<u64, Vec<&Sample>> = BTreeMap::new();
    sequence.samples.iter().for_each(|one| by_id.entry(one.ids[0]).or_default().push(one));
    let course = |(id, samples): (u64, Vec<&'a Sample>)| {
        let errors: Vec<f64> = samples.iter().filter_map(|one| Some((one.depth[0]? / one.depth_m).abs())).collect();
        let error = errors.iter().sum::<f64>() / errors.len().max(1) as f64;
        Course { sequence: &sequence.name, id, samples, error }
    };
    by_id.into_iter().filter(|(_, samples)| samples.len() >= MIN_FRAMES).map(course).collect()
}

/// A plot over frames of what is true, what is told, and half the interval around it.
fn plot(title: &str, samples: &[&Sample], value: impl Fn(&Sample) -> Option<[f64; 3]>) -> String {
    let points: Vec<(f64, [f64; 3])> = samples.iter().filter_map(|one| Some((one.frame as f64, value(one)?))).collect();
    let (Some(first), Some(last)) = (points.first(), points.last()) else { return String::new() };
    let low = points.iter().map(|(_, [a, b, c])| a.min(b - c)).fold(f64::INFINITY, f64::min);
    let high = points.iter().map(|(_, [a, b, c])| a.max(b + c)).fold(f64::NEG_INFINITY, f64::max);
    let (low, high) = (low.floor(), high.ceil().max(low.floor() + 1.0));
    let x = |frame: f64| MARGIN + (WIDTH - MARGIN - 4.0) * (frame - first.0) / (last.0 - first.0).max(1.0);
    let y = |value: f64| 18.0 + (HEIGHT - 36.0) * (high - value) / (high - low);
    let line = |pick: &dyn Fn(&[f64; 3]) -> f64| {
        let places = points.iter().map(|(frame, values)| format!("{:.1},{:.1}", x(*frame), y(pick(values))));
        places.collect::<Vec<_>>().join(" ") + " "
    };
    let below = points.iter().rev().map(|(frame, [_, b, c])| format!("{:.1},{:.1}", x(*frame), y(b - c)));
    let band = line(&|[_, b, c]| b + c) + &(below.collect::<Vec<_>>().join(" ") + " ");
    format!(
        "<svg width=\"{WIDTH}\" height=\"{HEIGHT}\"><text x=\"{MARGIN}\" y=\"12\">{title}</text>\
         <line class=\"a\" x1=\"{MARGIN}\" x2=\"{WIDTH}\" y1=\"{0:.1}\" y2=\"{0:.1}\"/>\
         <line class=\"a\" x1=\"{MARGIN}\" x2=\"{WIDTH}\" y1=\"{1:.1}\" y2=\"{1:.1}\"/>\
         <text x=\"2\" y=\"{0:.1}\">{high}</text><text x=\"2\" y=\"{1:.1}\">{low}</text>\
         <text x=\"{MARGIN}\" y=\"{2}\">frame {3} to {4}</text>\
         <polygon class=\"b\" points=\"{band}\"/><polyline class=\"t\" points=\"{5}\"/>\
         <polyline class=\"s\" points=\"{6}\"/></svg>\n",
        y(high),
        y(low),
        HEIGHT - 4.0,
        first.0,
        last.0,
        line(&|[a, ..]| *a),
        line(&|[_, b, _]| *b),
    )
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

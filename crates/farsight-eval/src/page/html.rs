//! The text of the page.

use std::fmt::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

use super::contents::{Page, Picture, ShownFrame};
use super::scenes::{DISTANT_M, SHOWN_SCORE};
use crate::text;

const STYLE: &str = "body{font:15px/1.45 system-ui,sans-serif;margin:2rem auto;max-width:1560px;padding:0 1rem;color:#222}\
h1{font-size:1.5rem}h2{font-size:1.15rem;margin-top:2.2rem;border-bottom:1px solid #ddd}\
pre{background:#f7f7f7;padding:1rem;overflow-x:auto;font:13px/1.4 ui-monospace,monospace}\
.charts{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,480px),1fr));gap:8px}.charts img{width:100%;border:1px solid #eee}\
table{border-collapse:collapse;font-size:14px}td,th{padding:2px 12px 2px 0;text-align:right}td:nth-child(-n+2),th:nth-child(-n+2){text-align:left}\
.pair{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,480px),1fr));gap:8px}figure{margin:0}figure img{width:100%}details{margin:.4rem 0}summary{cursor:pointer}details img{max-width:100%}.note{color:#955}";

/// How to read the frames.
const LEGEND: &str = "<p>g counts the rows of the label file, d those of the result file, both from 0, as in --explain; the \
metres are z. Drawn are ground truth in dashed white and at most 30 detections: those that found an object, then the best scored.</p>\n";

/// The whole page; pictures are inside it.
pub(super) fn page(
    page: &Page,
    charts: &[Picture],
    worst: &[Option<Picture>],
    scenes: &[[Option<Picture>; 2]],
) -> String {
    let mut html = format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{0}</title><style>{STYLE}</style></head><body>\n<h1>{0}</h1>\n",
        escaped(page.title)
    );
    push_lines(&mut html, "Figures", &text::lines(page.report));
    push_notes(&mut html, page);
    if let Some(comparison) = page.comparison {
        push_lines(&mut html, "Comparison", &text::comparison_lines(comparison));
    }
    if !page.oracle.is_empty() {
        push_lines(&mut html, "Parts replaced by the truth", &text::oracle_lines(page.oracle));
    }
    html.push_str("<h2>Curves</h2>\n<div class=\"charts\">\n");
    for chart in charts {
        push_picture(&mut html, chart);
    }
    html.push_str("</div>\n<h2>Frames with the largest errors of distance</h2>\n");
    html.push_str(if page.worst.is_empty() {
        "<p>No object that counts was found, so there is no error of distance.</p>\n"
    } else {
        LEGEND
    });
    for (shown, picture) in page.worst.iter().zip(worst) {
        push_frame(&mut html, shown, picture.as_ref());
    }
    push_scenes(&mut html, page, scenes);
    html.push_str("</body></html>\n");
    html
}

/// Both results beside each other.
fn push_scenes(html: &mut String, page: &Page, pictures: &[[Option<Picture>; 2]]) {
    if page.scenes.is_empty() {
        return;
    }
    html.push_str("<h2>Scenes, side by side</h2>\n<p>");
    let _ = writeln!(
        html,
        "Chosen by their labels: the most objects from {DISTANT_M} m on, the most that are largely hidden, the most of all; \
         counted are those that count at some difficulty. Drawn are ground truth in dashed white, the detections that found \
         an object, and others with a score from {SHOWN_SCORE}, at most 30.</p>"
    );
    for (shown, pictures) in page.scenes.iter().zip(pictures) {
        let (scene, [ours, _]) = (&shown.scene, &shown.results);
        let _ = writeln!(
            html,
            "<h3>{}, {}: {} of {} objects</h3>\n<div class=\"pair\">",
            escaped(&ours.id),
            scene.kind,
            scene.objects,
            ours.targets.len()
        );
        for ((name, result), picture) in page.names.iter().zip(&shown.results).zip(pictures) {
            let found: Vec<f64> = result
                .targets
                .iter()
                .filter_map(|target| Some((target.found?.depth_m - target.depth_m).abs()))
                .collect();
            let mean = found.iter().sum::<f64>() / found.len() as f64;
            let error = if found.is_empty() { String::new() } else { format!(", {mean:.2} m off in the mean") };
            let (count, all) = (found.len(), result.targets.len());
            let _ = writeln!(html, "<figure><figcaption>{}: {count} of {all} found{error}</figcaption>", escaped(name));
            if let Some(picture) = picture {
                push_picture(html, picture);
            }
            html.push_str("</figure>\n");
        }
        html.push_str("</div>\n");
    }
}

fn push_lines(html: &mut String, heading: &str, lines: &[String]) {
    let _ = write!(html, "<h2>{heading}</h2>\n<pre>{}</pre>\n", escaped(&lines.join("\n")));
}

fn push_notes(html: &mut String, page: &Page) {
    let notes: Vec<_> =
        text::notes(page.report).into_iter().chain(page.findings.iter().map(ToString::to_string)).collect();
    if !notes.is_empty() {
        html.push_str("<h2>Notes</h2>\n<ul class=\"note\">\n");
        for note in notes {
            let _ = writeln!(html, "<li>{}</li>", escaped(&note));
        }
        html.push_str("</ul>\n");
    }
}

fn push_picture(html: &mut String, picture: &Picture) {
    let (kind, bytes) = picture.jpeg.as_ref().map_or(("png", &picture.png), |jpeg| ("jpeg", jpeg));
    let data = STANDARD.encode(bytes);
    let _ = writeln!(html, "<img alt=\"{}\" src=\"data:image/{kind};base64,{data}\">", escaped(&picture.name));
}

fn push_frame(html: &mut String, shown: &ShownFrame, picture: Option<&Picture>) {
    let frame = &shown.worst;
    let _ = writeln!(
        html,
        "<details{}><summary>{}: {:.2} m</summary>",
        if picture.is_some() { " open" } else { "" },
        escaped(&frame.id),
        frame.worst_error_m()
    );
    if let Some(picture) = picture {
        push_picture(html, picture);
    }
    html.push_str(
        "<table><tr><th>object</th><th>found by</th><th>true z</th><th>predicted z</th><th>error</th><th>score</th></tr>\n",
    );
    for target in &frame.targets {
        let object = format!("g{} {}", target.label, target.class);
        let row = match &target.found {
            None => format!("<td>missed</td><td>{:.2} m</td><td></td><td></td><td></td>", target.depth_m),
            Some(found) => format!(
                "<td>d{}</td><td>{:.2} m</td><td>{:.2} m</td><td>{:+.2} m</td><td>{:.3}</td>",
                found.prediction,
                target.depth_m,
                found.depth_m,
                found.depth_m - target.depth_m,
                found.score
            ),
        };
        let _ = writeln!(html, "<tr><td>{object}</td>{row}</tr>");
    }
    html.push_str("</table>\n");
    push_others(html, shown);
    html.push_str("</details>\n");
}

/// Labels that need not be found and detections that found none, by name.
fn push_others(html: &mut String, shown: &ShownFrame) {
    let targets = &shown.worst.targets;
    let is_target = |i: usize| targets.iter().any(|target| target.label as usize == i);
    let is_used =
        |i: usize| targets.iter().filter_map(|target| target.found).any(|found| found.prediction as usize == i);
    let labels = shown.frame.labels.iter().enumerate().filter(|(i, _)| !is_target(*i));
    let labels = labels.map(|(i, label)| format!("g{i} {}", label.class));
    let predictions = shown.frame.predictions.iter().enumerate().filter(|(i, _)| !is_used(*i));
    let predictions = predictions.map(|(i, prediction)| {
        let detection = &prediction.detection;
        format!("d{i} {} {:.3} at {:.1} m", detection.class, detection.score, detection.box3d.depth_m())
    });
    for (heading, names) in [
        ("labels that do not count", labels.collect::<Vec<_>>()),
        ("detections of none of these", predictions.collect()),
    ] {
        if !names.is_empty() {
            let _ = writeln!(html, "<p>{heading}: {}</p>", escaped(&names.join(", ")));
        }
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

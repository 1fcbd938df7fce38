//! `farsight experiment plot`: what the arms are worth against the time that they take, SVG.

use std::fmt::Write;
use std::path::PathBuf;

use anyhow::{Result, ensure};
use clap::Args;
use farsight_files::write_atomically;

use super::results_file;
use crate::commands::Outcome;
use crate::experiment::plan::Work;
use crate::experiment::times::Times;
use crate::experiment::{Experiment, Metric, Results};
use crate::outputs;
use crate::printer::Printer;

/// Arguments of `farsight experiment plot`.
#[derive(Debug, Args)]
#[command(after_help = "farsight experiment plot configs/experiments/table1.toml --out docs/table1.svg")]
pub(crate) struct PlotArgs {
    /// The plan, TOML
    #[arg(value_name = "FILE")]
    plan: PathBuf,
    /// File of the results, JSON [default: docs/results/NAME.json]
    #[arg(long, value_name = "FILE")]
    results: Option<PathBuf>,
    /// File of the times, JSON, by `farsight experiment time` [default: docs/results/NAME-times.json]
    #[arg(long, value_name = "FILE")]
    times: Option<PathBuf>,
    /// Whose times [default: the last engine of the times]
    #[arg(long, value_name = "ENGINE")]
    engine: Option<String>,
    /// One panel for each of these figures
    #[arg(long, value_name = "METRICS", value_delimiter = ',', default_values = ["ap3d_05", "mae"])]
    metrics: Vec<Metric>,
    /// The picture to write
    #[arg(long, value_name = "FILE.svg")]
    out: PathBuf,
}

/// Sizes, units of the picture: of a panel's plot, of what is left of it and below it, of what is above and beside it.
const PLOT: [f64; 2] = [560.0, 240.0];
const LEFT: f64 = 70.0;
const BELOW: f64 = 56.0;
const ABOVE: f64 = 34.0;
const RIGHT: f64 = 260.0;

/// Colours of what is trained and of what is not.
const TRAINED: &str = "#2f6db3";
const RANGER: &str = "#b3661a";

/// A mark in a panel.
struct Point {
    title: String,
    ms: f64,
    value: f64,
    color: &'static str,
}

/// Runs the command.
pub(crate) fn run(args: &PlotArgs, printer: &mut Printer) -> Result<Outcome> {
    let plan = Experiment::read(&args.plan)?;
    let results_path = args.results.clone().unwrap_or_else(|| results_file(&plan));
    let times_path = args.times.clone().unwrap_or_else(|| format!("docs/results/{}-times.json", plan.name).into());
    outputs::check_kind(&args.out, "png", "a name ending in .svg")?;
    let (results, times) = (Results::read(&results_path)?, Times::read(&times_path)?);
    let engines = times.engines();
    let engine = args.engine.as_deref().or(engines.last().copied()).unwrap_or_default();
    ensure!(
        engines.contains(&engine),
        "{}: no times of \"{engine}\"; expected one of {}",
        times_path.display(),
        engines.join(", ")
    );
    let panels: Vec<(Metric, Vec<Point>)> =
        args.metrics.iter().map(|&metric| (metric, points(&plan, &results, &times, engine, metric))).collect();
    ensure!(panels.iter().any(|(_, points)| !points.is_empty()), "no arm has both results and times");
    let drawn = svg(&panels, engine, times.cores);
    write_atomically(&args.out, |file| file.write_all(drawn.as_bytes()))?;
    printer.line(&args.out.display().to_string());
    Ok(Outcome::Done)
}

/// The arms that have both; a ranger takes as long as the detector whose boxes it has.
fn points(plan: &Experiment, results: &Results, times: &Times, engine: &str, metric: Metric) -> Vec<Point> {
    let mut points = Vec::new();
    let mut seen: Vec<String> = Vec::new();
    for cell in plan.cells() {
        if seen.contains(&cell.arm) {
            continue;
        }
        seen.push(cell.arm.clone());
        let values = results.values(&cell.arm, metric);
        let (timed, color) = match plan.work(&cell) {
            Work::Ranging { of, .. } => (of.arm, RANGER),
            _ => (cell.arm.clone(), TRAINED),
        };
        if let (Some(ms), false) = (times.of(&timed, engine), values.is_empty()) {
            let value = values.iter().sum::<f64>() / values.len() as f64;
            points.push(Point { title: plan.title(&cell.arm).to_owned(), ms, value, color });
        }
    }
    points
}

fn svg(panels: &[(Metric, Vec<Point>)], engine: &str, cores: usize) -> String {
    let panel_height = ABOVE + PLOT[1] + BELOW;
    let (width, height) = (LEFT + PLOT[0] + RIGHT, panel_height * panels.len() as f64);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {width} {height}\" font-family=\"Helvetica, Arial, sans-serif\" font-size=\"12\">\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n"
    );
    for (place, (metric, points)) in panels.iter().enumerate() {
        let top = panel_height * place as f64 + ABOVE;
        panel(&mut out, top, *metric, points, &format!("milliseconds an image, {engine}, {cores} cores"));
    }
    out.push_str("</svg>\n");
    out
}

/// A panel whose plot begins `top` below the picture's upper edge.
fn panel(out: &mut String, top: f64, metric: Metric, points: &[Point], x_title: &str) {
    let [width, height] = PLOT;
    let end = |value: fn(&Point) -> f64| axis_end(points.iter().map(value).fold(0.0, f64::max));
    let [x_end, y_end] = [end(|point| point.ms), end(|point| point.value)];
    let x = |ms: f64| LEFT + width * ms / x_end;
    let y = |value: f64| top + height * (1.0 - value / y_end);
    let (right, bottom) = (LEFT + width, top + height);
    let unit = if metric.is_error() { ", metres" } else { "" };
    text(out, [LEFT, top - 12.0], "start\" font-weight=\"bold", &format!("{}{unit}", metric.title()));
    text(
        out,
        [right, top - 12.0],
        "end\" fill=\"#555",
        "blue: detectors; brown: a detector's boxes with other distances",
    );
    for step in 0..=5 {
        let [at_x, at_y] = [x_end, y_end].map(|end| end * f64::from(step) / 5.0);
        line(out, [[LEFT, y(at_y)], [right, y(at_y)]], "#e1e1e1");
        text(out, [LEFT - 8.0, y(at_y) + 4.0], "end", &number(at_y));
        text(out, [x(at_x), bottom + 18.0], "middle", &number(at_x));
    }
    line(out, [[LEFT, bottom], [right, bottom]], "#555");
    text(out, [LEFT + width / 2.0, bottom + 38.0], "middle", x_title);
    // Names from above, each at least a line below the last, tied to their marks.
    let mut order: Vec<&Point> = points.iter().collect();
    order.sort_by(|a, b| b.value.total_cmp(&a.value));
    let mut next = f64::NEG_INFINITY;
    let room = |rest: usize| bottom - 14.0 * rest as f64;
    for (place, point) in order.iter().enumerate() {
        let name_y = y(point.value).max(next).min(room(order.len() - place - 1));
        next = name_y + 14.0;
        line(out, [[x(point.ms), y(point.value)], [right + 8.0, name_y]], "#c8c8c8");
        text(out, [right + 12.0, name_y + 4.0], "start", &point.title);
    }
    for Point { ms, value, color, .. } in points {
        let _ = writeln!(out, "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"5\" fill=\"{color}\"/>", x(*ms), y(*value));
    }
}

/// The first round number beyond `most` whose fifths are round, too.
fn axis_end(most: f64) -> f64 {
    let most = most.max(1e-6) * 1.02;
    let power = 10_f64.powf(most.log10().floor());
    let step = [1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 7.5, 10.0].into_iter().find(|step| step * power >= most);
    step.unwrap_or(10.0) * power
}

fn number(value: f64) -> String {
    let text = format!("{value:.2}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

fn line(out: &mut String, [[x1, y1], [x2, y2]]: [[f64; 2]; 2], color: &str) {
    let _ = writeln!(out, "<line x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\" stroke=\"{color}\"/>");
}

fn text(out: &mut String, [x, y]: [f64; 2], anchor: &str, words: &str) {
    let words = words.replace('&', "&amp;").replace('<', "&lt;");
    let _ = writeln!(out, "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{words}</text>");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_end_at_round_numbers_beyond_the_most() {
        for (most, end) in [(0.9, 1.0), (1.0, 1.5), (13.6, 15.0), (49.0, 50.0), (98.5, 150.0), (0.0, 1.5e-6)] {
            assert!((axis_end(most) - end).abs() < 1e-9 * end.max(1.0), "{most}: {}", axis_end(most));
        }
    }

    #[test]
    fn every_mark_has_its_name_and_names_do_not_meet() {
        let titles: Vec<String> = (0..8).map(|at| format!("arm {at} & <co>")).collect();
        let points: Vec<Point> =
            titles.into_iter().map(|title| Point { title, ms: 10.0, value: 1.0, color: TRAINED }).collect();
        let drawn = svg(&[(Metric::Mae, points)], "rten", 2);
        assert_eq!(drawn.matches("<circle").count(), 8);
        let names = drawn.lines().filter(|line| line.contains("arm "));
        let at = |line: &str| line.split("y=\"").nth(1).and_then(|rest| rest.split('"').next()?.parse::<f64>().ok());
        let mut places: Vec<f64> = names.filter_map(at).collect();
        assert_eq!(places.len(), 8);
        places.sort_by(f64::total_cmp);
        assert!(places.windows(2).all(|pair| pair[1] - pair[0] > 13.9), "{places:?}");
        assert!(drawn.contains("arm 0 &amp; &lt;co>"));
    }
}

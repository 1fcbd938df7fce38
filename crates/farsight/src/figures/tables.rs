//! Markdown tables of figures.

use std::collections::BTreeMap;

use anyhow::{Context, Result, bail, ensure};

use crate::layout::table;
use crate::printer::grouped;

use super::{AveragePrecision, ClassFigures, ErrorBars, Errors, Figures, Operating, SetFigures};

/// The columns of the table `found`.
const FOUND_HEADING: [&str; 9] = [
    "data",
    "found",
    "false alarms an image, at score",
    "MAE",
    "mean error",
    "relative error",
    "mean relative error",
    "within the error bar",
    "nearest missed at 0.5",
];

/// What may stand in the mark of a table.
struct Options<'a> {
    sets: Vec<&'a SetFigures>,
    classes: Vec<&'a str>,
    scores: Vec<f64>,
    /// Most false alarms a frame of the table `found`.
    false_alarms: f64,
}

/// The rows of the table that `options` ask for.
pub(super) fn rows(figures: &Figures, mut options: BTreeMap<&str, &str>) -> Result<Vec<String>> {
    let table = options.remove("table").context("expected table=NAME")?;
    let options = Options::new(figures, options)?;
    match table {
        "summary" => summary(&options),
        "operating" => operating(&options),
        "found" => Ok(found_at(&options)),
        "distance" => distance(&options),
        "error-bars" => error_bars(&options),
        "ap" => Ok(average_precision(&options)),
        "baselines" => baselines(&options),
        "sources" => Ok(sources(&options)),
        other => {
            bail!(
                "no table \"{other}\"; expected summary, operating, found, distance, error-bars, ap, baselines or sources"
            )
        }
    }
}

impl<'a> Options<'a> {
    fn new(figures: &'a Figures, mut options: BTreeMap<&str, &'a str>) -> Result<Self> {
        let mut list = |name| options.remove(name).map(|text| text.split(',').collect::<Vec<_>>());
        let sets = match list("sets") {
            None => figures.sets.iter().collect(),
            Some(names) => {
                let set = |name| figures.set(name).with_context(|| format!("no figures on a data set \"{name}\""));
                names.into_iter().map(set).collect::<Result<_>>()?
            }
        };
        let classes = list("classes").unwrap_or_else(|| vec!["car"]);
        let score = |text: &str| text.parse().with_context(|| format!("\"{text}\"; expected a score such as 0.5"));
        let scores = list("scores").unwrap_or_else(|| vec!["0.5"]).into_iter().map(score).collect::<Result<_>>()?;
        let false_alarms = list("false-alarms").and_then(|texts| texts.first()?.parse().ok()).unwrap_or(0.3);
        ensure!(
            options.is_empty(),
            "unknown {:?}; expected table, sets, classes, scores or false-alarms",
            options.keys()
        );
        Ok(Self { sets, classes, scores, false_alarms })
    }

    /// Every set with every class that is asked for and has objects there.
    fn each(&self) -> Vec<(&'a SetFigures, &'a str, &'a ClassFigures)> {
        let classes = |set: &&'a SetFigures| {
            let set = *set;
            self.classes
                .iter()
                .filter_map(move |&class| Some((set, class, set.classes.get(class)?)))
                .collect::<Vec<_>>()
        };
        self.sets.iter().flat_map(classes).collect()
    }

    /// What a row calls a class of a set: the set alone where there is one class.
    fn title(&self, set: &SetFigures, class: &str) -> String {
        if self.classes.len() == 1 { set.title.clone() } else { format!("{}: {class}s", set.title) }
    }
}

/// One row a data set: what a user sees at one score, and AP.
fn summary(options: &Options) -> Result<Vec<String>> {
    let score = *options.scores.first().context("expected a score")?;
    let rows = options.each().into_iter().map(|(set, class, figures)| {
        let point = at(figures, score)?;
        let within = figures.error_bars.map_or_else(dash, |bars| percent(bars.within_1_sigma));
        let moderate = |values: Option<[f64; 3]>| values.map_or_else(dash, |[_, moderate, _]| format!("{moderate:.1}"));
        Ok(vec![
            options.title(set, class),
            found(point.found, point.objects),
            format!("{:.2}", point.false_alarms_per_frame),
            metres(point.mae_m),
            fine_percent(point.relative_median),
            within,
            format!("{} / {}", moderate(figures.ap.image), moderate(figures.ap.box3d_loose)),
        ])
    });
    let heading = [
        "data",
        "found",
        "false alarms an image",
        "distance MAE",
        "relative error, median",
        "within the error bar",
        "AP 2D / 3D at 0.5",
    ];
    Ok(table(&heading, &rows.collect::<Result<Vec<_>>>()?))
}

/// What is found at most so many false alarms, and how far off that is.
fn found_at(options: &Options) -> Vec<String> {
    let rows = options.each().into_iter().map(|(set, class, figures)| {
        let Errors { relative, signed_relative, bias_m, mae_m, .. } = figures.all_scores;
        let point = at_false_alarms(figures, options.false_alarms);
        let usual = at(figures, 0.5).ok();
        vec![
            options.title(set, class),
            point.map_or_else(dash, |point| found(point.found, point.objects)),
            point.map_or_else(dash, |point| format!("{:.2} at {:.2}", point.false_alarms_per_frame, point.score)),
            metres(mae_m),
            signed_metres(bias_m),
            fine_percent(relative),
            signed_relative.map_or_else(dash, |share| format!("{:+.1}%", 100.0 * share)),
            figures.error_bars.map_or_else(dash, |bars| percent(bars.within_1_sigma)),
            usual
                .filter(|point| point.frames_with_objects > 0)
                .map_or_else(dash, |point| format!("{} of {}", point.nearest_missed, point.frames_with_objects)),
        ]
    });
    table(&FOUND_HEADING, &rows.collect::<Vec<_>>())
}

fn operating(options: &Options) -> Result<Vec<String>> {
    let mut rows = Vec::new();
    for (set, class, figures) in options.each() {
        for (i, &score) in options.scores.iter().enumerate() {
            let point = at(figures, score)?;
            rows.push(vec![
                if i == 0 { options.title(set, class) } else { String::new() },
                format!("{score:.2}"),
                found(point.found, point.objects),
                format!("{:.2}", point.false_alarms_per_frame),
                metres(point.mae_m),
                fine_percent(point.relative_median),
            ]);
        }
    }
    let heading = ["data", "score from", "found", "false alarms an image", "MAE", "relative error, median"];
    Ok(table(&heading, &rows))
}

/// One row a data set and a column a range of distances: what is found there, and the mean absolute error.
fn distance(options: &Options) -> Result<Vec<String>> {
    let each = options.each();
    let has_objects = |metres: &str| {
        let mut rows = each.iter().flat_map(|(_, _, figures)| &figures.by_distance);
        rows.any(|row| row.metres == metres && row.errors.objects > 0)
    };
    let (_, _, first) = each.first().context("no data set has objects of these classes")?;
    let bins: Vec<&str> = first.by_distance.iter().map(|row| row.metres.as_str()).filter(|m| has_objects(m)).collect();
    let mut rows = Vec::new();
    for (set, class, figures) in &each {
        let cell = |bin: &&str| {
            let row = figures.by_distance.iter().find(|row| row.metres == **bin);
            let Errors { objects, found, mae_m, .. } = row.with_context(|| format!("{}: no {bin} m", set.name))?.errors;
            Ok(if objects > 0 {
                format!("{} of {}, {}", grouped(found), grouped(objects), metres(mae_m))
            } else {
                dash()
            })
        };
        let cells = bins.iter().map(cell).collect::<Result<Vec<_>>>()?;
        rows.push(std::iter::once(options.title(set, class)).chain(cells).collect());
    }
    let heading = std::iter::once("data".to_owned()).chain(bins.iter().map(|bin| format!("{bin} m")));
    Ok(table(&heading.collect::<Vec<_>>(), &rows))
}

fn error_bars(options: &Options) -> Result<Vec<String>> {
    let rows = options.each().into_iter().map(|(set, class, figures)| {
        let bars = figures.error_bars.with_context(|| format!("{}: no error bars of {class}s", set.name))?;
        Ok(vec![
            options.title(set, class),
            grouped(bars.count),
            signed_metres(figures.all_scores.bias_m),
            metres(Some(bars.mean_sigma_m)),
        ]
        .into_iter()
        .chain(within_intervals(&bars))
        .collect())
    });
    let heading = ["data", "with an error bar", "mean error", "mean error bar", "in 50%", "in 68%", "in 90% interval"];
    Ok(table(&heading, &rows.collect::<Result<Vec<_>>>()?))
}

/// The share of distances in each interval with what it can tell, where that was measured.
fn within_intervals(bars: &ErrorBars) -> [String; 3] {
    let cell = |[share, low, high]: [f64; 3]| format!("{} [{:.0}, {:.0}]", percent(share), 100.0 * low, 100.0 * high);
    bars.within_intervals.map_or_else(|| [dash(), percent(bars.within_1_sigma), dash()], |shares| shares.map(cell))
}

fn average_precision(options: &Options) -> Vec<String> {
    let mut rows = Vec::new();
    for (set, class, figures) in options.each() {
        let counts = figures.ap.objects.map(grouped).join(" / ");
        let title = format!("{} ({counts} objects)", options.title(set, class));
        let by_place = figures.ap_by_place.as_ref().map(|ap| ("by place scores".to_owned(), ap));
        for (title, ap) in [(title, &figures.ap)].into_iter().chain(by_place) {
            let AveragePrecision { image, orientation, bev_strict, bev_loose, box3d_strict, box3d_loose, .. } = *ap;
            let [image, orientation, bev, bev_loose, box3d, box3d_loose] =
                [image, orientation, bev_strict, bev_loose, box3d_strict, box3d_loose].map(levels);
            rows.push(vec![title, image, orientation, bev, box3d, bev_loose, box3d_loose]);
        }
    }
    let heading = ["data", "2D", "AOS", "bird's-eye", "3D", "bird's-eye, loose", "3D, loose"];
    table(&heading, &rows)
}

fn baselines(options: &Options) -> Result<Vec<String>> {
    let mut rows = Vec::new();
    for (set, class, figures) in options.each() {
        let told = |errors: &Errors| format!("{} ({})", metres(errors.mae_m), fine_percent(errors.relative));
        let baseline = |name: &str| {
            let errors = figures.baselines.get(name);
            errors.map(told).with_context(|| format!("{}: no baseline {name}", set.name))
        };
        rows.push(vec![
            options.title(set, class),
            found(figures.all_scores.found, figures.all_scores.objects),
            told(&figures.all_scores),
            baseline("similar_triangles")?,
            baseline("inverse_perspective")?,
        ]);
    }
    Ok(table(&["data", "found", "network", "similar triangles", "inverse perspective"], &rows))
}

fn sources(options: &Options) -> Vec<String> {
    let rows = options.sets.iter().map(|set| {
        let super::Source { command, program, engine, weights_sha256, date } = &set.source;
        let weights = weights_sha256.get(..8).unwrap_or(weights_sha256);
        let by = format!("{program}, {engine}, weights {weights}, {date}");
        vec![set.title.clone(), set.frames.to_string(), by, format!("`{command}`")]
    });
    table(&["data", "images", "measured by", "the same command"], &rows.collect::<Vec<_>>())
}

fn at(figures: &ClassFigures, score: f64) -> Result<&Operating> {
    let point = figures.operating.iter().find(|point| (point.score - score).abs() < 1e-6);
    point.with_context(|| format!("no figures at a score of {score}; expected a multiple of 0.05 below 1"))
}

fn found(found: usize, objects: usize) -> String {
    format!("{} of {} ({})", grouped(found), grouped(objects), percent(found as f64 / objects.max(1) as f64))
}

/// The lowest score with at most so many false alarms a frame; none when there are more at any score.
fn at_false_alarms(figures: &ClassFigures, most: f64) -> Option<&Operating> {
    figures.operating.iter().find(|point| point.false_alarms_per_frame <= most)
}

fn percent(share: f64) -> String {
    format!("{:.0}%", 100.0 * share)
}

fn fine_percent(share: Option<f64>) -> String {
    share.map_or_else(dash, |share| format!("{:.1}%", 100.0 * share))
}

fn metres(metres: Option<f64>) -> String {
    metres.map_or_else(dash, |metres| format!("{metres:.2} m"))
}

fn signed_metres(metres: Option<f64>) -> String {
    metres.map_or_else(dash, |metres| format!("{metres:+.2} m"))
}

fn levels(values: Option<[f64; 3]>) -> String {
    values.map_or_else(dash, |values| values.map(|value| format!("{value:.1}")).join(" / "))
}

fn dash() -> String {
    "-".to_owned()
}

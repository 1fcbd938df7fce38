//! `farsight eval`: KITTI AP and ranging errors of result files.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::{Args, ValueEnum};
use farsight_core::{Detection, Label};
use farsight_data::kitti::{Calibration, read_split};
use farsight_data::read_image;
use farsight_eval::ap::{Metric, OverlapSet};
use farsight_eval::explain::{Explanation, View, explain};
use farsight_eval::page::{Page, ShownFrame, worst_frames};
use farsight_eval::ranging::{Bootstrap, MATCH_IOU, RangingComparison, RangingOptions};
use farsight_eval::{Evaluation, Findings, Frame, FrameFiles, Report, text};
use farsight_viz::{DrawOptions, Scene, annotate};
use image::RgbImage;
use serde::Serialize;

use super::Outcome;
use crate::printer::Printer;

/// Arguments of `farsight eval`.
#[derive(Debug, Args)]
pub(crate) struct EvalArgs {
    /// Folder of label files (KITTI's `training/label_2`)
    #[arg(long, value_name = "DIR")]
    labels: PathBuf,
    /// Folder of result files, one a frame, 16 columns (a 17th is taken for the error bar of the distance, metres)
    #[arg(long, value_name = "DIR")]
    results: PathBuf,
    /// Frames to evaluate, one id a line [default: all that have a result file]
    #[arg(long, value_name = "FILE")]
    split: Option<PathBuf>,
    /// Write all figures as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write a page with curves and the worst frames
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// Images to draw the worst frames on (KITTI's `training/image_2`, with `calib` beside it)
    #[arg(long, value_name = "DIR", requires = "report")]
    images: Option<PathBuf>,
    /// Other results to compare distances with, frame by frame
    #[arg(long, value_name = "DIR")]
    against: Option<PathBuf>,
    /// Tell what became of each object and detection of this frame
    #[arg(long, value_name = "FRAME")]
    explain: Option<String>,
    /// What --explain measures overlaps on
    #[arg(long, value_enum, default_value_t = MetricName::ThreeD, requires = "explain")]
    metric: MetricName,
    /// Leave detections with a lower score out of the ranging errors and of --explain (AP looks at all scores)
    #[arg(long, value_name = "SCORE")]
    min_score: Option<f64>,
    /// Smallest 2D overlap at which a detection counts as having found an object, in the ranging errors
    #[arg(long, value_name = "IOU", default_value_t = MATCH_IOU)]
    ranging_overlap: f64,
    /// Take everything odd about the files for an error
    #[arg(long)]
    strict: bool,
    /// How often frames are drawn anew for the intervals; 0 leaves them out
    #[arg(long, value_name = "N", default_value_t = Bootstrap::default().resamples)]
    resamples: usize,
    /// Seed of the intervals
    #[arg(long, value_name = "S", default_value_t = Bootstrap::default().seed)]
    seed: u64,
}

/// A metric as it is written on the command line.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum MetricName {
    /// Boxes in the image
    #[value(name = "2d")]
    TwoD,
    /// Footprints seen from above
    #[value(name = "bev")]
    Bev,
    /// Boxes in space
    #[value(name = "3d")]
    ThreeD,
}

/// What goes into the JSON file: the report, and what was asked for besides.
#[derive(Debug, Serialize)]
struct Answer<'a> {
    #[serde(flatten)]
    report: BTreeMap<String, serde_json::Value>,
    findings: &'a Findings,
    #[serde(skip_serializing_if = "Option::is_none")]
    against: Option<&'a RangingComparison>,
}

/// Runs the command.
pub(crate) fn run(args: &EvalArgs, printer: &mut Printer) -> Result<Outcome> {
    let files = open(args, &args.results)?;
    if let Some(id) = &args.explain {
        return explain_frame(args, &files, id, printer);
    }
    let options = args.ranging_options();
    let (evaluation, findings) = files.evaluate(&options)?;
    if args.strict && !findings.is_empty() {
        tell_strictly(&findings, printer);
        return Ok(Outcome::Told);
    }
    for finding in findings.iter() {
        printer.warning(&finding.to_string());
    }
    let report = evaluation.report();
    for line in text::lines(&report) {
        printer.line(&line);
    }
    for note in text::notes(&report) {
        printer.note(&note);
    }
    let comparison = args.against.as_ref().map(|against| compare(args, against, &evaluation, &files)).transpose()?;
    if let Some(comparison) = &comparison {
        printer.line("");
        for line in text::comparison_lines(comparison) {
            printer.line(&line);
        }
    }
    if let Some(path) = &args.json {
        write_json(path, &report, &findings, comparison.as_ref())?;
    }
    if let Some(folder) = &args.report {
        let page = write_page(args, folder, &files, &evaluation, &report, &findings, comparison.as_ref())?;
        printer.status(&format!("report: {}", page.display()));
    }
    Ok(Outcome::Done)
}

impl EvalArgs {
    fn ranging_options(&self) -> RangingOptions {
        let bootstrap = (self.resamples > 0).then_some(Bootstrap { resamples: self.resamples, seed: self.seed });
        RangingOptions { min_score: self.min_score, min_iou: self.ranging_overlap, bootstrap }
    }
}

fn open(args: &EvalArgs, results: &Path) -> Result<FrameFiles> {
    let split = args.split.as_deref().map(read_split).transpose()?;
    Ok(FrameFiles::open(&args.labels, results, split)?)
}

fn tell_strictly(findings: &Findings, printer: &mut Printer) {
    for finding in findings.iter() {
        for place in &finding.places {
            printer.error(&format!("{place} ({})", finding.kind));
        }
        let more = finding.count - finding.places.len();
        if more > 0 {
            printer.error(&format!("{more} more: {}", finding.kind));
        }
    }
}

fn compare(args: &EvalArgs, against: &Path, ours: &Evaluation, files: &FrameFiles) -> Result<RangingComparison> {
    // The same frames for both, or the differences would be of the frames.
    let others = FrameFiles::open(&args.labels, against, Some(files.ids().to_vec()))?;
    let (theirs, _) = others.evaluate(&RangingOptions { bootstrap: None, ..args.ranging_options() })?;
    let bootstrap = Bootstrap { resamples: args.resamples, seed: args.seed };
    RangingComparison::new(ours.targets(), theirs.targets(), ours.frames(), &bootstrap)
        .with_context(|| format!("{}: the labels changed while they were read", args.labels.display()))
}

fn write_json(path: &Path, report: &Report, findings: &Findings, against: Option<&RangingComparison>) -> Result<()> {
    let serde_json::Value::Object(report) = serde_json::to_value(report)? else {
        bail!("the report is no JSON object");
    };
    let answer = Answer { report: report.into_iter().collect(), findings, against };
    let mut text = serde_json::to_string_pretty(&answer)?;
    text.push('\n');
    fs::write(path, text).with_context(|| format!("{}: cannot be written", path.display()))
}

fn write_page(
    args: &EvalArgs,
    folder: &Path,
    files: &FrameFiles,
    evaluation: &Evaluation,
    report: &Report,
    findings: &Findings,
    comparison: Option<&RangingComparison>,
) -> Result<PathBuf> {
    let worst = worst_frames(evaluation.targets(), files.ids());
    let shown = worst.into_iter().map(|worst| {
        let (frame, _) = files.read(&worst.id)?;
        let image = args.images.as_ref().map(|images| drawn(images, &frame)).transpose()?;
        Ok(ShownFrame { worst, frame, image })
    });
    let worst = shown.collect::<Result<Vec<_>>>()?;
    let title = format!("{} against {}", args.results.display(), args.labels.display());
    Ok(Page { title: &title, report, findings, comparison, worst: &worst }.write(folder)?)
}

/// The frame's image with its detections and labels.
fn drawn(images: &Path, frame: &Frame) -> Result<RgbImage> {
    let id = &frame.id;
    let found = ["png", "jpg", "jpeg"].map(|extension| images.join(format!("{id}.{extension}")));
    let path = found.iter().find(|path| path.is_file());
    let path = path.with_context(|| format!("{}: no image of frame {id}; expected {id}.png", images.display()))?;
    let image = read_image(path)?;
    let calibration = images.parent().unwrap_or(images).join("calib").join(format!("{id}.txt"));
    let camera = Calibration::read(&calibration)?.camera();
    let detections: Vec<_> = frame.claims.iter().map(|claim| claim.detection.clone()).collect();
    Ok(annotate(
        &image,
        &Scene { camera: &camera, detections: &detections, truth: &frame.labels },
        &DrawOptions::default(),
    ))
}

fn explain_frame(args: &EvalArgs, files: &FrameFiles, id: &str, printer: &mut Printer) -> Result<Outcome> {
    if !files.ids().iter().any(|known| known == id) {
        bail!(
            "frame {id} is not evaluated; expected one of {} ... {}",
            files.ids()[0],
            files.ids()[files.ids().len() - 1]
        );
    }
    let (frame, findings) = files.read(id)?;
    for finding in findings.iter() {
        printer.warning(&finding.to_string());
    }
    let metric = match args.metric {
        MetricName::TwoD => Metric::Image,
        MetricName::Bev => Metric::Bev,
        MetricName::ThreeD => Metric::Space,
    };
    let view = View { metric, overlaps: OverlapSet::Strict, min_score: args.min_score };
    for line in explanation_lines(&frame, &explain(&frame, &view)) {
        printer.line(&line);
    }
    Ok(Outcome::Done)
}

fn explanation_lines(frame: &Frame, explanation: &Explanation) -> Vec<String> {
    let row = |name: &str, what: &str, fates: [String; 3]| {
        let [easy, moderate, hard] = fates;
        format!("{name:<5}{what:<36}{easy:<32}{moderate:<32}{hard}").trim_end().to_owned()
    };
    let heading = |what: &str| row("", what, ["easy", "moderate", "hard"].map(str::to_owned));
    let mut lines = vec![heading("ground truth")];
    for (i, (label, fates)) in frame.labels.iter().zip(&explanation.objects).enumerate() {
        let Label { class, box2d, box3d, .. } = label;
        let what = format!("{class} {:.1} px, z {:.1} m", box2d.height(), box3d.depth_m());
        lines.push(row(&format!("g{i}"), &what, fates.map(|fate| fate.to_string())));
    }
    lines.push(heading("detections"));
    for (i, (claim, fates)) in frame.claims.iter().zip(&explanation.claims).enumerate() {
        let Detection { class, score, box2d, box3d, .. } = &claim.detection;
        let what = format!("{class} {score:.3}, {:.1} px, z {:.1} m", box2d.height(), box3d.depth_m());
        lines.push(row(&format!("d{i}"), &what, fates.map(|fate| fate.to_string())));
    }
    lines
}

//! `farsight eval`: KITTI AP and ranging errors of result files.

mod explained;
mod geometric_baselines;
mod modelled;
mod oracle;
mod part;
mod pictured;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::{Args, ValueEnum};
use farsight_core::depth_fusion::NORMAL_INTERVAL_SIGMAS;
use farsight_eval::ap::Metric;
use farsight_eval::compare::Comparison;
use farsight_eval::oracle::OracleRow;
use farsight_eval::page::Page;
use farsight_eval::ranging::{MATCH_IOU, RangingOptions};
use farsight_eval::{Bootstrap, Evaluation, Findings, FrameFiles, LabelSource, Report, Scores, text};
use farsight_files::write_quickly;
use serde::Serialize;

use super::Outcome;
use crate::outputs;
use crate::pipeline_args::{PipelineArgs, overlap_from_text};
use crate::printer::{Printer, counted};
use crate::rangers::CAMERA_HEIGHT_M;
use crate::shard::ShardArgs;
pub(super) use geometric_baselines::evaluations as baseline_evaluations;
use modelled::Files;
pub(crate) use modelled::MIN_SCORE;
pub(super) use modelled::write_results_of;
pub(super) use part::merged;

/// Frames drawn anew more often than this make no interval better, and each draw takes memory.
const MAX_RESAMPLES: usize = 100_000;

/// Arguments of `farsight eval`.
#[derive(Debug, Args)]
#[command(
    after_help = "Memory: about 6 kB a frame is kept. Rules, protocol and how to read the report: docs/evaluation.md"
)]
#[allow(clippy::struct_excessive_bools, reason = "each is an option of the command line")]
pub(crate) struct EvalArgs {
    /// Folder of label files (KITTI's `training/label_2`)
    #[arg(long, value_name = "DIR", required_unless_present = "data", conflicts_with = "data")]
    labels: Option<PathBuf>,
    /// Folder of result files, one a frame, 16 columns (a 17th is taken for the error bar of the distance, metres);
    /// with --data, where the model's results are kept
    #[arg(long, value_name = "DIR", required_unless_present = "data")]
    results: Option<PathBuf>,
    /// Data in KITTI's layout to run a model on first
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    #[command(flatten)]
    pipeline: PipelineArgs,
    /// FILE with the frames to evaluate, one id a line, or with --data a name in its `ImageSets`
    /// [default: all that have a result file; with --data, all that have an image]
    #[arg(long, value_name = "FILE")]
    split: Option<PathBuf>,
    /// Write all figures as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write a page with curves and the worst frames; with --against and --images, scenes with both results, too
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// Images to draw the worst frames on (KITTI's `training/image_2`, with `calib` beside it)
    #[arg(long, value_name = "DIR", requires = "report")]
    images: Option<PathBuf>,
    /// Other results to compare AP and distances with, frame by frame
    #[arg(long, value_name = "DIR")]
    against: Option<PathBuf>,
    /// Tell what became of each object and detection of this frame, instead of evaluating
    #[arg(long, value_name = "FRAME", conflicts_with_all = ["json", "report", "against"])]
    explain: Option<String>,
    /// What --explain measures overlaps on
    #[arg(long, value_enum, default_value_t = MetricName::ThreeD, requires = "explain")]
    metric: MetricName,
    /// Let --explain ask for the loose overlaps from above and in space: 0.5 for cars, 0.25 for others
    #[arg(long, requires = "explain")]
    loose: bool,
    /// Tell also what the same detections would give with the distances of geometric baselines: from the height of the
    /// 2D box, from its bottom edge, and by GS3D's guidance
    #[arg(long, alias = "classic", conflicts_with = "explain")]
    geometric_baselines: bool,
    /// Tell also what AP would be if this part of each detection that matches an object in the image were true; with
    /// several, each alone and all together
    #[arg(long, value_enum, value_name = "PART", value_delimiter = ',', conflicts_with = "explain")]
    oracle: Vec<oracle::PartName>,
    /// Folder of calibration files, for --geometric-baselines [default: `calib` beside the labels]
    #[arg(long, value_name = "DIR", requires = "geometric_baselines")]
    calib: Option<PathBuf>,
    /// Height of the camera above the ground, metres, for --geometric-baselines
    #[arg(long, value_name = "METRES", requires = "geometric_baselines", default_value_t = CAMERA_HEIGHT_M, value_parser = height_from_text, allow_negative_numbers = true)]
    camera_height: f64,
    /// What is taken for the scores, in everything that goes by them
    #[arg(long, value_enum, default_value_t = ScoresName::AsGiven)]
    scores: ScoresName,
    /// Leave detections with a lower score out of the ranging errors and of --explain (AP looks at all scores in the
    /// files); with --data, out of the results altogether, which are then those of `farsight range`
    /// [default with --data: 0.05 for the results]
    #[arg(long, value_name = "SCORE", value_parser = score_from_text, allow_negative_numbers = true)]
    min_score: Option<f64>,
    /// Smallest 2D overlap at which a detection counts as having found an object, in the ranging errors
    #[arg(long, value_name = "IOU", default_value_t = MATCH_IOU, value_parser = overlap_from_text, allow_negative_numbers = true)]
    ranging_overlap: f64,
    /// Take everything odd about the files for an error: each is told with file and line, nothing is evaluated, exit
    /// status 1
    #[arg(long)]
    strict: bool,
    /// Count cars, vans, trucks and trams as one class, reported as cars
    #[arg(long)]
    vehicles: bool,
    /// How often frames are drawn anew for the intervals; 0 leaves them out
    #[arg(long, value_name = "N", default_value_t = Bootstrap::default().resamples, value_parser = resamples_from_text, allow_negative_numbers = true)]
    resamples: usize,
    /// Seed of the intervals
    #[arg(long, value_name = "S", default_value_t = Bootstrap::default().seed)]
    seed: u64,
    // Last, because its help heading would go on to what follows.
    #[command(flatten)]
    shard: ShardArgs,
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

/// [`Scores`] as they are written on the command line.
#[derive(Debug, Clone, Copy, PartialEq, ValueEnum)]
enum ScoresName {
    /// What the result files say
    AsGiven,
    /// That, times the probability by the error bar (17th column) that the distance is right to an overlap of 0.7:
    /// raises AP in space
    Place,
}

/// What goes into the JSON file: the report, and what was asked for besides.
#[derive(Debug, Serialize)]
struct Answer<'a> {
    #[serde(flatten)]
    report: BTreeMap<String, serde_json::Value>,
    scores: Scores,
    findings: &'a Findings,
    #[serde(skip_serializing_if = "Option::is_none")]
    against: Option<&'a Comparison>,
    #[serde(skip_serializing_if = "<[OracleRow]>::is_empty")]
    oracle: &'a [OracleRow],
}

/// Runs the command.
pub(crate) fn run(args: &EvalArgs, printer: &mut Printer) -> Result<Outcome> {
    if args.shard.asked().is_some() {
        return part::run(args, printer);
    }
    args.check_outputs()?;
    let source = Files::new(args, printer)?;
    judge(args, source, printer)
}

/// Judges results that are there.
fn judge(args: &EvalArgs, mut source: Files, printer: &mut Printer) -> Result<Outcome> {
    let files =
        FrameFiles::open(source.labels.clone(), &source.results, source.ids.take())?.with_scores(args.scores.scores());
    let files = if source.by_model { files.with_any_classes() } else { files };
    let files = if args.vehicles { files.with_vehicles_as_cars() } else { files };
    if let Some(id) = &args.explain {
        return explained::run(args, &files, id, printer);
    }
    if let Some(images) = args.images.as_ref().filter(|images| !images.is_dir()) {
        bail!("{}: no such folder; expected a folder of images such as 000007.png", images.display());
    }
    let options = args.ranging_options(source.interval_sigmas);
    let (evaluation, mut findings) = files.evaluate(&options)?;
    let others = args.against.as_deref().map(|against| other_results(against, &files, &options)).transpose()?;
    if let Some((_, _, found)) = &others {
        findings.append(found.clone());
    }
    if tell(&findings, args, printer) == Outcome::Told {
        return Ok(Outcome::Told);
    }
    let report = evaluation.report();
    let comparison =
        others.as_ref().map(|(_, theirs, _)| compare(args, &source.labels, theirs, &evaluation)).transpose()?;
    print(args, &report, comparison.as_ref(), printer);
    let oracle = oracle::rows(args, &files, &evaluation, &source.labels)?;
    for line in text::oracle_lines(&oracle) {
        printer.line(&line);
    }
    if args.geometric_baselines {
        geometric_baselines::run(args, &source, &files, printer)?;
    }
    if let Some(path) = &args.json {
        let (scores, against) = (args.scores.scores(), comparison.as_ref());
        write_json(path, &report, |report| Answer { report, scores, findings: &findings, against, oracle: &oracle })?;
    }
    let mut outcome = Outcome::Done;
    if let Some(folder) = &args.report {
        let (worst, mut unseen) = pictured::worst(args, &files, &evaluation)?;
        let scenes = match (&others, &args.images) {
            (Some((their_files, theirs, _)), Some(images)) => {
                pictured::scenes(images, [(&files, &evaluation), (their_files, theirs)], &mut unseen)?
            }
            _ => Vec::new(),
        };
        let (ours, theirs) = (args.title(), args.against.as_deref().unwrap_or(Path::new("")).display().to_string());
        let title = format!("{ours} against {}", source.labels);
        let page = Page {
            title: &title,
            report: &report,
            findings: &findings,
            comparison: comparison.as_ref(),
            oracle: &oracle,
            worst: &worst,
            scenes: &scenes,
            names: [&ours, &theirs],
        };
        let page = page.write(folder)?;
        printer.status(&format!("report: {}", page.display()));
        outcome = tell(&unseen.findings, args, printer);
    }
    if source.failed > 0 {
        printer.error(&format!("{} failed, see above; not in these figures", counted(source.failed, "frame")));
        outcome = Outcome::Told;
    }
    Ok(outcome)
}

/// Prints what was found out, for people to read.
fn print(args: &EvalArgs, report: &Report, comparison: Option<&Comparison>, printer: &mut Printer) {
    for line in text::lines(report) {
        printer.line(&line);
    }
    for note in text::notes(report) {
        printer.note(&note);
    }
    if args.scores == ScoresName::Place {
        printer.note("place scores: the chance that the distance is right is part of every score here");
    }
    let Some(comparison) = comparison else { return };
    printer.line("");
    for line in text::comparison_lines(comparison) {
        printer.line(&line);
    }
}

impl EvalArgs {
    /// Hours of evaluation must not be lost for want of a folder.
    fn check_outputs(&self) -> Result<()> {
        if let Some(json) = &self.json {
            outputs::check_json(json, self.pipeline.files())?;
        }
        self.report.as_deref().map_or(Ok(()), outputs::make_folder)
    }

    /// Whether anything is asked of a model that looks at images.
    fn names_what_looks(&self) -> bool {
        self.pipeline != PipelineArgs::default()
    }

    /// What is being judged.
    fn title(&self) -> String {
        let model = || self.pipeline.source().name().display().to_string();
        let judged = self.results.as_ref().map_or_else(model, |results| results.display().to_string());
        if self.scores == ScoresName::Place { format!("{judged} (place scores)") } else { judged }
    }

    fn bootstrap(&self) -> Bootstrap {
        Bootstrap { resamples: self.resamples, seed: self.seed }
    }

    fn ranging_options(&self, interval_sigmas: Option<[f64; 2]>) -> RangingOptions {
        let bootstrap = (self.resamples > 0).then(|| self.bootstrap());
        let interval_sigmas = interval_sigmas.unwrap_or(NORMAL_INTERVAL_SIGMAS);
        RangingOptions { min_score: self.min_score, min_iou: self.ranging_overlap, bootstrap, interval_sigmas }
    }
}

impl MetricName {
    fn metric(self) -> Metric {
        match self {
            Self::TwoD => Metric::Image,
            Self::Bev => Metric::Bev,
            Self::ThreeD => Metric::Box3d,
        }
    }
}

impl ScoresName {
    fn scores(self) -> Scores {
        match self {
            Self::AsGiven => Scores::AsGiven,
            Self::Place => Scores::Place,
        }
    }
}

/// Any score: those of others need not be probabilities.
fn score_from_text(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|score: &f64| score.is_finite()).ok_or_else(|| "expected a finite number".to_owned())
}

fn height_from_text(text: &str) -> Result<f64, String> {
    let height_m = text.parse().ok().filter(|height_m: &f64| height_m.is_finite() && *height_m > 0.0);
    height_m.ok_or_else(|| "expected a positive number of metres".to_owned())
}

fn resamples_from_text(text: &str) -> Result<usize, String> {
    let resamples = text.parse().ok().filter(|resamples| *resamples <= MAX_RESAMPLES);
    resamples.ok_or_else(|| format!("expected a number from 0 to {MAX_RESAMPLES}"))
}

/// Tells what is odd: a warning a kind, or with `--strict` an error a place, which is an outcome of its own.
fn tell(findings: &Findings, args: &EvalArgs, printer: &mut Printer) -> Outcome {
    if args.strict {
        tell_strictly(findings, printer);
        return if findings.is_empty() { Outcome::Done } else { Outcome::Told };
    }
    for finding in findings.iter() {
        printer.warning(&finding.to_string());
    }
    Outcome::Done
}

fn tell_strictly(findings: &Findings, printer: &mut Printer) {
    for finding in findings.iter() {
        if finding.is_of_files {
            printer.error(&finding.to_string());
            continue;
        }
        for place in &finding.places {
            printer.error(&format!("{place} ({})", finding.kind));
        }
        let more = finding.count - finding.places.len();
        if more > 0 {
            printer.error(&format!("{more} more: {}", finding.kind));
        }
    }
}

/// The same frames with other results.
fn other_results(
    against: &Path,
    files: &FrameFiles,
    options: &RangingOptions,
) -> Result<(FrameFiles, Evaluation, Findings)> {
    // The same frames for both, or the differences would be of the frames.
    let files = files.with_results(against)?;
    let (evaluation, findings) = files.evaluate(&RangingOptions { bootstrap: None, ..options.clone() })?;
    Ok((files, evaluation, findings))
}

fn compare(args: &EvalArgs, labels: &LabelSource, theirs: &Evaluation, ours: &Evaluation) -> Result<Comparison> {
    ours.compared_with(theirs, &args.bootstrap())
        .with_context(|| format!("{labels}: the labels changed while they were read"))
}

fn write_json<'a>(
    path: &Path,
    report: &Report,
    answer: impl FnOnce(BTreeMap<String, serde_json::Value>) -> Answer<'a>,
) -> Result<()> {
    let serde_json::Value::Object(report) = serde_json::to_value(report)? else {
        bail!("the report is no JSON object");
    };
    let mut text = serde_json::to_string_pretty(&answer(report.into_iter().collect()))?;
    text.push('\n');
    Ok(write_quickly(path, |file| file.write_all(text.as_bytes()))?)
}

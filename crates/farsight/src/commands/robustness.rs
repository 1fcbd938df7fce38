//! `farsight robustness`: what is left of a model's figures when images get worse.

mod conditions;
mod plot;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use clap::Args;
use farsight::Pipeline;
use farsight_data::{CorruptedDataset, Dataset};
use farsight_eval::ranging::{Group, RangingMetric, RangingOptions};
use farsight_eval::{Difficulty, EvaluatedClass, FrameFiles, LabelSource};
use farsight_files::{MeasuredTable, Scratch, write_atomically};
use serde::Serialize;

use super::Outcome;
use super::eval::write_results_of;
use crate::layout::laid_out;
use crate::outputs;
use crate::pipeline_args::{self, PipelineArgs};
use crate::printer::{Printer, counted};
use conditions::{Condition, Weather};

/// Arguments of `farsight robustness`.
#[derive(Debug, Args)]
#[command(after_help = "\
Figures are of cars of KITTI's Moderate difficulty with a score from 0.5: the share that is found, the mean absolute
error of their distance, their mean error bar, and the shares of distances in their 68 and 90% intervals. Corruptions are those of ImageNet-C. Weather needs --twins, whose scenes are rendered anew.
farsight robustness --data KITTI --split val --json worse.json --plot worse.png
farsight robustness --twins KITTI --frames 100 --weather rain,fog,dusk,night --json weather.json")]
pub(crate) struct RobustnessArgs {
    /// Labelled images that are made worse
    #[arg(long, value_name = "DIR", required_unless_present = "twins")]
    data: Option<PathBuf>,
    /// A split of them: a name in `ImageSets`, or a file
    #[arg(long, value_name = "NAME|FILE", requires = "data")]
    split: Option<PathBuf>,
    /// Labels and cameras in KITTI's layout, whose twins are rendered in each weather
    #[arg(long, value_name = "DIR", conflicts_with = "data")]
    twins: Option<PathBuf>,
    /// So many of the twins
    #[arg(long, value_name = "N", requires = "twins", default_value_t = 100, value_parser = frames)]
    frames: usize,
    /// Seed of the worlds around the twins
    #[arg(long, value_name = "S", requires = "twins", default_value_t = 0)]
    seed: u64,
    /// Corruptions, by their names in ImageNet-C [default: all]
    #[arg(long, help = format!("Corruptions, of: {} [default: all]", farsight_data::Corruption::ALL.map(farsight_data::Corruption::name).join(", ")), value_name = "NAMES", value_delimiter = ',', value_parser = conditions::corruption)]
    corruptions: Vec<farsight_data::Corruption>,
    /// Weather and light of the twins, of: rain, fog, dusk, night [default: all with --twins]
    #[arg(long, value_name = "NAMES", value_delimiter = ',', requires = "twins", conflicts_with = "data", value_enum)]
    weather: Vec<Weather>,
    /// Severities
    #[arg(long, value_name = "N,N", value_delimiter = ',', default_values_t = [1, 2, 3, 4, 5], value_parser = clap::value_parser!(u8).range(1..=5))]
    severities: Vec<u8>,
    /// Write the figures, JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write the figures as a table to FILE (JSON), for documents to quote (`farsight measure --docs`)
    #[arg(long, value_name = "FILE")]
    table: Option<PathBuf>,
    /// Draw the share found against the severity, PNG
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    #[command(flatten)]
    pipeline: PipelineArgs,
}

fn frames(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|frames| *frames > 0).ok_or_else(|| "expected a whole number, at least 1".to_owned())
}

/// What counts has at least this score.
const MIN_SCORE: f64 = 0.5;

/// Lists in the file have a line for each entry.
const OPEN_LEVELS: usize = 2;

/// The figures of one condition.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Row {
    condition: String,
    /// 0 for images as they are.
    severity: u8,
    objects: usize,
    found: usize,
    /// Mean absolute error of the distance of those found, metres.
    mae_m: Option<f64>,
    /// None of a model without error bars, or where nothing is found.
    error_bars: Option<ErrorBars>,
}

/// Whether the error bars of those found grow with their errors.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
struct ErrorBars {
    /// Their mean, metres.
    mean_sigma_m: f64,
    /// The share of distances that are in their 68% interval.
    within_68: f64,
    /// The same for 90%.
    within_90: f64,
}

impl Row {
    /// Share of the cars that is found.
    fn share(&self) -> f64 {
        self.found as f64 / self.objects.max(1) as f64
    }

    /// The mean absolute error, in words.
    fn mae(&self) -> String {
        self.mae_m.map_or_else(|| "-".to_owned(), |mae| format!("{mae:.2} m"))
    }

    /// The shares in the error bars, in words.
    fn within(&self) -> String {
        let shares = |bars: ErrorBars| format!("{:.0} / {:.0}%", 100.0 * bars.within_68, 100.0 * bars.within_90);
        self.error_bars.map_or_else(|| "-".to_owned(), shares)
    }
}

/// Runs the command.
pub(crate) fn run(args: &RobustnessArgs, printer: &mut Printer) -> Result<Outcome> {
    let builder = args.pipeline.builder(printer)?.min_score(MIN_SCORE);
    let pipeline = pipeline_args::open_and_tell(&builder, printer)?;
    for file in args.json.iter().chain(&args.table) {
        outputs::check_json(file, args.pipeline.files())?;
    }
    let scratch = Scratch::temporary_folder().context("no folder for the results")?;
    let (clear, conditions) = conditions::all(args, scratch.path(), printer)?;
    let whole = measured("as it is", 0, &pipeline, &clear, scratch.path(), printer)?;
    ensure!(whole.objects > 0, "{}: no car of Moderate difficulty", clear.name());
    printer.line("condition         severity   found    share      MAE  error bar  in 68 / in 90%");
    tell(&whole, printer);
    let mut rows = vec![whole];
    for condition in &conditions {
        for &severity in &args.severities {
            let dataset: Arc<dyn Dataset> = match condition {
                Condition::Corruption(corruption) => {
                    Arc::new(CorruptedDataset::new(Arc::clone(&clear), *corruption, severity))
                }
                Condition::Weather(weather) => conditions::rendered(args, *weather, severity, scratch.path(), printer)?,
            };
            let row = measured(condition.name(), severity, &pipeline, &dataset, scratch.path(), printer)?;
            tell(&row, printer);
            rows.push(row);
        }
    }
    if let Some(file) = &args.json {
        let text = laid_out(&serde_json::json!({ "rows": rows }), OPEN_LEVELS);
        write_atomically(file, |out| out.write_all(text.as_bytes()))?;
    }
    if let Some(file) = &args.table {
        table(args, &rows).write(file)?;
    }
    if let Some(file) = &args.plot {
        plot::write(file, &rows)?;
    }
    Ok(Outcome::Done)
}

/// A row for each condition, a column for each severity.
fn table(args: &RobustnessArgs, rows: &[Row]) -> MeasuredTable {
    let severities = args.severities.iter().map(|severity| format!("severity {severity}"));
    let columns: Vec<String> = std::iter::once("condition".to_owned()).chain(severities).collect();
    let data = if args.twins.is_some() { "--twins KITTI" } else { "--data KITTI" };
    let severities: Vec<String> = args.severities.iter().map(u8::to_string).collect();
    let command = format!("farsight robustness {data} --severities {}", severities.join(","));
    let mut table = MeasuredTable { columns, ..MeasuredTable::new(&command, ["condition"]) };
    let cell = |row: &Row| format!("{:.0}%, {}, {}", 100.0 * row.share(), row.mae(), row.within());
    let (whole, worse) = rows.split_at(1);
    table.rows = whole
        .iter()
        .map(|row| [vec![row.condition.clone()], vec![cell(row); args.severities.len()]].concat())
        .chain(worse.chunks(args.severities.len()).map(|rows| {
            let condition = rows.iter().map(|row| row.condition.replace('_', " ")).take(1);
            condition.chain(rows.iter().map(cell)).collect()
        }))
        .collect();
    table
}

fn tell(row: &Row, printer: &mut Printer) {
    let found = format!("{}/{}", row.found, row.objects);
    let (share, mae, within) = (100.0 * row.share(), row.mae(), row.within());
    let bar = row.error_bars.map_or_else(|| "-".to_owned(), |bars| format!("{:.2} m", bars.mean_sigma_m));
    printer
        .line(&format!("{:<18}{:>8}{found:>8}{share:>8.1}%{mae:>9}{bar:>11}{within:>15}", row.condition, row.severity));
}

/// What `pipeline` makes of a data set; its results go to a folder of their own in `scratch`.
fn measured(
    condition: &str,
    severity: u8,
    pipeline: &Pipeline,
    dataset: &Arc<dyn Dataset>,
    scratch: &Path,
    printer: &mut Printer,
) -> Result<Row> {
    let results = Scratch::folder(&scratch.join("results")).context("no folder for the results")?;
    let ids = write_results_of(pipeline, &**dataset, 0..dataset.len(), results.path(), printer)?;
    let failed = dataset.len() - ids.len();
    ensure!(failed == 0, "{}: {} failed", dataset.name(), counted(failed, "frame"));
    let interval_sigmas = pipeline.interval_sigmas();
    let options = RangingOptions { bootstrap: None, interval_sigmas, ..RangingOptions::default() };
    let files = FrameFiles::open(LabelSource::from(dataset), results.path(), Some(ids))?.with_any_classes();
    let (evaluation, _) = files.evaluate(&options)?;
    let report = evaluation.report();
    let cars = report.ranging.group(EvaluatedClass::Car, Group::Level(Difficulty::Moderate));
    let errors = cars.map(|group| &group.whole);
    let bars = cars.and_then(|group| group.calibration.as_ref()?.rows.first());
    Ok(Row {
        condition: condition.to_owned(),
        severity,
        objects: errors.map_or(0, |errors| errors.objects),
        found: errors.map_or(0, |errors| errors.found),
        mae_m: errors.and_then(|errors| errors.metrics.get(RangingMetric::MaeZ)),
        error_bars: bars.map(|row| ErrorBars {
            mean_sigma_m: row.mean_sigma_m,
            within_68: row.within_68.share,
            within_90: row.within_90.share,
        }),
    })
}

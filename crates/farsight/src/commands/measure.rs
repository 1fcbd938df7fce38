//! `farsight measure`: the figures of a model on several data sets, and the documents that quote them.

mod sets;
mod summary;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use clap::Args;
use farsight::Pipeline;
use farsight_data::open_labelled;
use farsight_eval::ranging::RangingOptions;
use farsight_eval::{FrameFiles, LabelSource, Scores};
use farsight_files::{Scratch, today};

use super::Outcome;
use super::eval::{MIN_SCORE, baseline_evaluations, write_results_of};
use crate::figures::{Figures, SetFigures, Source, documents};
use crate::outputs;
use crate::pipeline_args::{self, EngineArgs, PipelineArgs};
use crate::printer::{Printer, counted};
use crate::rangers::CAMERA_HEIGHT_M;
use sets::{MeasuredSet, Overrides, Sets};
use summary::{class_figures, has_error_bars, with_baseline, without_distances};

/// Arguments of `farsight measure`.
#[derive(Debug, Args)]
#[command(after_help = "\
Figures on a data set whose folder is not named stay as they are in the file.
farsight measure --folder kitti=KITTI --folder twins=TWINS     measures anew
farsight measure --docs README.md models/*.md docs/*.md        puts the figures into documents, between their marks")]
pub(crate) struct MeasureArgs {
    /// The data sets, TOML
    #[arg(long, value_name = "FILE", default_value = "configs/measure.toml")]
    config: PathBuf,
    /// Where the data of a name in the config are, in KITTI's layout
    #[arg(long = "folder", value_name = "NAME=DIR", value_parser = folder, required_unless_present = "docs")]
    folders: Vec<(String, PathBuf)>,
    /// The file of figures (JSON)
    #[arg(long, value_name = "FILE", default_value = "docs/results/farsight-w.json")]
    out: PathBuf,
    /// The model to measure [default: the one that comes with the program]
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    #[command(flatten)]
    engine: EngineArgs,
    /// Documents whose blocks of figures are to be renewed
    #[arg(long, value_name = "FILE", num_args = 1..)]
    docs: Vec<PathBuf>,
}

fn folder(text: &str) -> Result<(String, PathBuf), String> {
    let parts = text.split_once('=').filter(|(name, folder)| !name.is_empty() && !folder.is_empty());
    parts.map(|(name, folder)| (name.to_owned(), folder.into())).ok_or_else(|| "expected NAME=DIR".to_owned())
}

/// Runs the command.
pub(crate) fn run(args: &MeasureArgs, printer: &mut Printer) -> Result<Outcome> {
    let mut outcome = Outcome::Done;
    if !args.folders.is_empty() {
        outcome = measure(args, printer)?;
    }
    for document in &args.docs {
        if documents::renew(document)? {
            printer.line(&format!("{}: renewed", document.display()));
        }
    }
    Ok(outcome)
}

fn measure(args: &MeasureArgs, printer: &mut Printer) -> Result<Outcome> {
    let Sets { sets } = Sets::read(&args.config)?;
    for (name, _) in &args.folders {
        let is_known = sets.iter().any(|set| set.folder == *name);
        ensure!(is_known, "{}: no data set is in a folder \"{name}\"", args.config.display());
    }
    outputs::check_json(&args.out, args.model.as_deref())?;
    let known = if args.out.exists() { Figures::read(&args.out)? } else { Figures::default() };
    let mut figures = Figures::default();
    let mut outcome = Outcome::Done;
    for set in &sets {
        let folder = args.folders.iter().find(|(name, _)| *name == set.folder);
        let Some((_, folder)) = folder else {
            let kept = known.set(&set.name).cloned();
            figures.sets.extend(kept.map(|kept| SetFigures { title: set.title.clone(), ..kept }));
            continue;
        };
        let answer = measured(args, set, folder, printer);
        if answer.as_ref().is_err_and(knows_no_regions) {
            printer.note(&format!("{}: left out, as the model's refiner knows no regions", set.name));
            continue;
        }
        let (measured, failed) = answer.with_context(|| set.name.clone())?;
        if failed > 0 {
            printer.error(&format!("{}: {} failed, not in these figures", set.name, counted(failed, "frame")));
            outcome = Outcome::Told;
        }
        figures.sets.push(measured);
        // Hours of measuring are not lost when a later data set fails.
        let unmeasured = known.sets.iter().filter(|set| figures.set(&set.name).is_none()).cloned();
        Figures { sets: figures.sets.iter().cloned().chain(unmeasured).collect() }.write(&args.out)?;
    }
    figures.write(&args.out)?;
    printer.line(&format!("{}: {}", args.out.display(), counted(figures.sets.len(), "data set")));
    Ok(outcome)
}

/// The figures on one data set, and how many of its frames failed.
fn measured(
    args: &MeasureArgs,
    set: &MeasuredSet,
    folder: &Path,
    printer: &mut Printer,
) -> Result<(SetFigures, usize)> {
    let beside = args.config.parent().unwrap_or(Path::new(""));
    let split = set.split_in(beside);
    let dataset = open_labelled(folder, split.as_deref())?;
    let pipeline = open_pipeline(args, set, dataset.len(), printer)?;
    let results = Scratch::temporary_folder().context("no folder for the results")?;
    let ids = write_results_of(&pipeline, &*dataset, 0..dataset.len(), results.path(), printer)?;
    let failed = dataset.len() - ids.len();
    ensure!(!ids.is_empty(), "nothing was measured: {} failed", counted(failed, "frame"));

    let files = FrameFiles::open(LabelSource::from(&dataset), results.path(), Some(ids.clone()))?.with_any_classes();
    let files = if set.vehicles { files.with_vehicles_as_cars() } else { files };
    let interval_sigmas = pipeline.interval_sigmas();
    let options = RangingOptions { bootstrap: None, interval_sigmas, ..RangingOptions::default() };
    let (as_given, _) = files.evaluate(&options)?;
    let report = as_given.report();
    let by_place =
        || Ok::<_, anyhow::Error>(files.clone().with_scores(Scores::Place).evaluate(&options)?.0.report().ap);
    let by_place = has_error_bars(&report).then(by_place).transpose()?;
    let mut classes = class_figures(&report, by_place.as_ref());
    let indices: BTreeMap<String, usize> = dataset.ids().into_iter().zip(0..).collect();
    let camera = |id: &str| Ok(dataset.camera(indices[id])?);
    for (ranger, evaluation) in baseline_evaluations(&camera, &files, CAMERA_HEIGHT_M, &options)? {
        with_baseline(&mut classes, ranger.word(), &evaluation.report().ranging);
    }
    if set.vehicles
        && let Some(figures) = classes.remove("car")
    {
        classes = BTreeMap::from([("vehicle".to_owned(), figures)]);
    }
    if set.boxes_only {
        classes.values_mut().for_each(without_distances);
    }
    let source = Source {
        command: set.eval_command(beside, args)?,
        program: concat!("farsight ", env!("CARGO_PKG_VERSION")).to_owned(),
        engine: pipeline.engine().to_owned(),
        weights_sha256: pipeline.info().weights_sha256.clone().unwrap_or_else(|| "unknown".to_owned()),
        date: today(),
    };
    printer.status(&format!("{}: {} looked at", set.name, counted(ids.len(), "frame")));
    let figures = SetFigures { name: set.name.clone(), title: set.title.clone(), frames: ids.len(), source, classes };
    Ok((figures, failed))
}

/// The pipeline as `farsight eval` opens it.
fn open_pipeline(args: &MeasureArgs, set: &MeasuredSet, images: usize, printer: &mut Printer) -> Result<Pipeline> {
    let Overrides { model, precision, second_stage, effort, road } = set.overrides()?;
    let (model, mut engine) = (model.or_else(|| args.model.clone()), args.engine.clone());
    engine.precision = precision.unwrap_or(engine.precision);
    let pipeline = PipelineArgs { model, engine, second_stage, effort, road, ..PipelineArgs::default() };
    pipeline_args::open(&pipeline.builder(printer)?.min_score(MIN_SCORE).images(images))
}

/// Whether the data set is said to be from a region, and the model has none.
fn knows_no_regions(error: &anyhow::Error) -> bool {
    matches!(error.downcast_ref(), Some(farsight::Error::NoRegions { .. }))
}

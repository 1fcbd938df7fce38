//! `farsight eval --model`: the model's own result files, then evaluated like any others.

use std::collections::BTreeMap;
use std::fs;
use std::ops::{ControlFlow, Range};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};
use farsight::object::detections;
use farsight::{Detection, Pipeline, View};
use farsight_core::Camera;
use farsight_data::kitti::{Calibration, read_split, write_results};
use farsight_data::{Dataset, open_labelled};
use farsight_eval::LabelSource;
use farsight_files::Scratch;

use super::EvalArgs;
use crate::outputs;
use crate::pipeline_args;
use crate::printer::{Printer, counted, progress_bar};
use crate::side_by_side::in_order;

/// Detections below this score are noise, and AP needs those above it however low: the curve ends where they do.
pub(crate) const MIN_SCORE: f64 = 0.05;

/// Frames that failed are told one by one up to this number, and the rest in one line: a folder without its images has
/// thousands.
const TOLD_FAILURES: usize = 5;

/// Where the cameras of the frames are.
enum Cameras {
    /// Calibration files in a folder.
    Folder(PathBuf),
    /// The data set has them; numbers of its frames by their names.
    Dataset(Arc<dyn Dataset>, BTreeMap<String, usize>),
}

/// Where the files to evaluate are.
pub(super) struct Files {
    pub(super) labels: LabelSource,
    /// Where the cameras are.
    cameras: Cameras,
    pub(super) results: PathBuf,
    pub(super) ids: Option<Vec<String>>,
    /// Whether a model has made the results just now.
    pub(super) by_model: bool,
    /// Half the widths of the model's 50 and 90% intervals, error bars, where it is known.
    pub(super) interval_sigmas: Option<[f64; 2]>,
    /// Frames that the model could not look at; they are not among the ids.
    pub(super) failed: usize,
    /// Removed when the evaluation is over.
    _folder: Option<Scratch>,
}

impl Files {
    /// The folders that the user named, or those of a data set and of the results that the model has for it now.
    pub(super) fn new(args: &EvalArgs, printer: &mut Printer) -> Result<Self> {
        match (&args.labels, &args.results, &args.data) {
            (Some(labels), Some(results), None) => {
                ensure!(
                    !args.names_what_looks(),
                    "--model, --engine and what belongs to them, --refiner, --plates, --above-road and --max-overlap are for a model that looks at images first; expected --data"
                );
                let ids = args.split.as_deref().map(split_of_files).transpose()?;
                Ok(Self {
                    labels: labels.into(),
                    cameras: Cameras::Folder(args.calib.clone().unwrap_or_else(|| labels.with_file_name("calib"))),
                    results: results.clone(),
                    ids,
                    by_model: false,
                    interval_sigmas: None,
                    failed: 0,
                    _folder: None,
                })
            }
            (None, results, Some(data)) => modelled(args, results.as_deref(), data, printer),
            _ => bail!("expected --labels and --results, or --data (and --model)"),
        }
    }

    /// The camera of the frame called `id`.
    pub(super) fn camera(&self, id: &str) -> Result<Camera> {
        match &self.cameras {
            Cameras::Folder(folder) => Ok(Calibration::read(&folder.join(format!("{id}.txt")))?.camera()),
            Cameras::Dataset(dataset, indices) => {
                let index = indices.get(id).with_context(|| format!("{}: no frame {id}", dataset.name()))?;
                Ok(dataset.camera(*index)?)
            }
        }
    }
}

/// Ids from a file; names of splits need a data set that has them.
fn split_of_files(split: &Path) -> Result<Vec<String>> {
    ensure!(split.is_file(), "{}: no such file; a bare name such as val is for --data", split.display());
    Ok(read_split(split)?)
}

fn modelled(args: &EvalArgs, results: Option<&Path>, data: &Path, printer: &mut Printer) -> Result<Files> {
    let dataset = open_labelled(data, args.split.as_deref())?;
    let (results, folder) = if let Some(kept) = results {
        outputs::check_results(kept, &dataset.ids(), &dataset.folders())?;
        outputs::make_folder(kept)?;
        (kept.to_owned(), None)
    } else {
        let folder = Scratch::temporary_folder().context("no folder for the results; name one with --results")?;
        (folder.path().to_owned(), Some(folder))
    };
    let pipeline = open(args, dataset.len(), printer)?;
    let ids = write_results_of(&pipeline, &*dataset, 0..dataset.len(), &results, printer)?;
    let failed = dataset.len() - ids.len();
    ensure!(!ids.is_empty(), "nothing was evaluated: {} failed", counted(failed, "frame"));
    printer.status(&format!("{} looked at by {}", counted(ids.len(), "frame"), pipeline.engine()));
    let sigmas = Some(pipeline.interval_sigmas());
    Ok(Files { _folder: folder, ..looked_at_already(args, dataset, results, ids, sigmas) })
}

/// What looks at so many images.
pub(super) fn open(args: &EvalArgs, images: usize, printer: &mut Printer) -> Result<Pipeline> {
    let min_score = args.min_score.unwrap_or(MIN_SCORE);
    let builder = args.pipeline.builder(printer)?.min_score(min_score).images(images);
    pipeline_args::open_and_tell(&builder, printer)
}

/// The results of the frames `ids` of a data set by a model with these intervals; the others failed.
pub(super) fn looked_at_already(
    args: &EvalArgs,
    dataset: Arc<dyn Dataset>,
    results: PathBuf,
    ids: Vec<String>,
    interval_sigmas: Option<[f64; 2]>,
) -> Files {
    let labels = LabelSource::from(&dataset);
    let failed = dataset.len() - ids.len();
    let cameras = if let Some(folder) = &args.calib {
        Cameras::Folder(folder.clone())
    } else {
        let indices = dataset.ids().into_iter().zip(0..).collect();
        Cameras::Dataset(dataset, indices)
    };
    Files { labels, cameras, results, ids: Some(ids), by_model: true, interval_sigmas, failed, _folder: None }
}

/// Writes a result file for each frame of `block` of `dataset` to the folder `results`. Frames that fail are told and
/// are not among the ids that it returns.
pub(in crate::commands) fn write_results_of(
    pipeline: &Pipeline,
    dataset: &dyn Dataset,
    block: Range<usize>,
    results: &Path,
    printer: &mut Printer,
) -> Result<Vec<String>> {
    let bar = progress_bar(block.len());
    let (mut done, mut failed, mut unwritten) = (Vec::new(), 0, 0);
    let frames = dataset.ids().into_iter().enumerate().filter(|(index, _)| block.contains(index));
    let look = |(index, id): (usize, String)| (id, looked_at(pipeline, dataset, index));
    in_order(frames, pipeline.side_by_side(), look, |(id, looked)| {
        let path = results.join(format!("{id}.txt"));
        match looked {
            Ok(detections) => match write_results(&path, &detections) {
                Ok(()) => done.push(id.clone()),
                Err(error) => {
                    unwritten += 1;
                    if unwritten <= TOLD_FAILURES {
                        bar.suspend(|| printer.error(&error.to_string()));
                    }
                }
            },
            Err(error) => {
                failed += 1;
                if failed <= TOLD_FAILURES {
                    bar.suspend(|| printer.failure(&error));
                }
                // What an earlier run found in it must not be taken for an answer of this one.
                if path.exists() {
                    fs::remove_file(&path).with_context(|| format!("{}: cannot be removed", path.display()))?;
                }
            }
        }
        bar.inc(1);
        anyhow::Ok(ControlFlow::Continue(()))
    })?;
    bar.finish_and_clear();
    if failed > TOLD_FAILURES {
        printer.error(&format!("{} failed", counted(failed - TOLD_FAILURES, "more frame")));
    }
    ensure!(unwritten == 0, "{} could not be written", counted(unwritten, "result file"));
    Ok(done)
}

fn looked_at(pipeline: &Pipeline, dataset: &dyn Dataset, index: usize) -> Result<Vec<Detection>> {
    let looked = pipeline.detect_view(&dataset.image(index)?, &View::of_frame(dataset, index)?);
    let (objects, _) = looked.with_context(|| dataset.origin(index))?;
    Ok(detections(&objects))
}

//! `farsight export --half --cascade-on`: below which scores a further iteration of a refiner does not pay.

use std::path::Path;

use anyhow::{Result, bail, ensure};
use farsight::detector::open_detector;
use farsight::second_stage::refiner;
use farsight::{Camera, EngineOptions, ModelSource};
use farsight_core::detection::DecodeOptions;
use farsight_core::score::MIN_PEAK;
use farsight_methods::Detector;
use farsight_methods::refiner::{Cascade, RefinerModel, ScoreTrace};
use image::RgbImage;

use super::fit::detected;
use super::ranges::Images;
use super::{ExportArgs, Outcome};
use crate::printer::{Printer, counted, progress_bar};

/// Why there is no cascade.
const TOO_FEW: &str = "too few detections with high scores to fit below which scores iterations do not pay";

/// Fits the cascade of `model` to the images in `folder`, and writes it with that; nothing else changes.
pub(super) fn run(mut model: RefinerModel, args: &ExportArgs, folder: &Path, printer: &mut Printer) -> Result<Outcome> {
    let is_changed = args.fit_on.is_some() || args.average_with.is_some() || args.input.is_some();
    ensure!(
        !is_changed && args.focal_range.is_none() && !args.tells_facts(),
        "--cascade-on changes nothing else of the model; expected --half, --detector and --out alone beside it"
    );
    let engine = args.int8.engine.options()?;
    let mut detector = open_detector(&ModelSource::from_word(&args.detector), &engine)?;
    let images = Images::find(folder)?;
    let cascade = fitted(&model, &mut *detector, &engine, images.len(), printer, |index| images.read(index))?;
    let Some(cascade) = cascade else { bail!("{}: {TOO_FEW}", folder.display()) };
    model.config.cascade = cascade;
    model.write_half(&args.out)?;
    printer.line(&format!("{}: half-precision numbers", args.out.display()));
    Ok(Outcome::Done)
}

/// The cascade of `model` behind `detector`, fitted on `count` images; `read` gives each with its camera. None where
/// too few detections have high scores.
pub(super) fn fitted(
    model: &RefinerModel,
    detector: &mut dyn Detector,
    engine: &EngineOptions,
    count: usize,
    printer: &mut Printer,
    mut read: impl FnMut(usize) -> Result<(RgbImage, Camera)>,
) -> Result<Option<Cascade>> {
    let mut refiner = refiner(model, engine)?;
    let options = DecodeOptions { min_score: Some(MIN_PEAK), ..DecodeOptions::default() };
    let bar = progress_bar(count);
    let mut traces: Vec<ScoreTrace> = Vec::new();
    for index in 0..count {
        let (image, camera) = read(index)?;
        let first = detected(detector, &options, &image, &camera)?;
        traces.extend(refiner.score_traces(&image, &camera, &first)?);
        bar.inc(1);
    }
    bar.finish_and_clear();
    let Some(cascade) = Cascade::fit(&traces) else {
        return Ok(None);
    };
    for sought in Cascade::SOUGHT {
        let [first, second, third] = cascade.least(sought);
        printer.status(&format!(
            "for a score of {sought}: iterations from a score of {first:.2}, {second:.2} and {third:.2} on"
        ));
    }
    printer.status(&format!("fitted on {} in {}", counted(traces.len(), "detection"), counted(count, "image")));
    Ok(Some(cascade))
}

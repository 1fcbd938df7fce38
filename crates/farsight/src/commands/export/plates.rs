//! `farsight export` of a plate reader: how its readings and what the shipped model and its refiner say go together,
//! fitted on labelled frames.

use std::path::Path;

use anyhow::{Context, Result};
use farsight::object::detections;
use farsight::second_stage::plate_reader;
use farsight::{EngineOptions, ModelSource, Pipeline, Road, StageSource};
use farsight_core::MeasuredDepth;
use farsight_core::depth_fusion::DepthPair;
use farsight_core::score::MIN_PEAK;
use farsight_data::{Dataset, open_labelled};
use farsight_eval::Frame;
use farsight_eval::ranging::Target;
use farsight_methods::plate_reader::PlateReader;
use farsight_methods::plate_reader::PlateReaderModel;

use super::fit::{fitted_depths, is_plain, told};
use super::{ExportArgs, Outcome};
use crate::printer::{Printer, progress_bar};

/// Fits the plate reader to `data` and writes it.
pub(super) fn run(
    mut model: PlateReaderModel,
    args: &ExportArgs,
    data: &Path,
    printer: &mut Printer,
) -> Result<Outcome> {
    let pairs = depth_pairs(&model, &args.detector, data)?;
    model.config.depths =
        fitted_depths(&pairs, "plate reader", false, printer).with_context(|| data.display().to_string())?;
    model.write_half(&args.out)?;
    printer.line(&format!("{}: half-precision numbers", args.out.display()));
    Ok(Outcome::Done)
}

/// What is known and what is read of the Moderate vehicles that the shipped model finds in all frames of `data`.
fn depth_pairs(model: &PlateReaderModel, detector: &Path, data: &Path) -> Result<Vec<DepthPair>> {
    let dataset = open_labelled(data, None)?;
    // What is known before a plate is read; every detection counts, two in one place, too.
    let builder =
        Pipeline::builder().model(ModelSource::from_word(detector)).plates(StageSource::Off).road(Road::Ignored);
    let pipeline = builder.min_score(MIN_PEAK).max_overlap(1.0).open()?;
    let mut reader = plate_reader(model, &EngineOptions::default())?;
    let bar = progress_bar(dataset.len());
    let mut pairs = Vec::new();
    for index in 0..dataset.len() {
        pairs.extend(pairs_of_frame(&pipeline, &mut reader, &*dataset, index)?);
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(pairs)
}

fn pairs_of_frame(
    pipeline: &Pipeline,
    reader: &mut PlateReader,
    dataset: &dyn Dataset,
    index: usize,
) -> Result<Vec<DepthPair>> {
    let (camera, image) = (dataset.camera(index)?, dataset.image(index)?);
    let known = detections(&pipeline.detect(&image, &camera).with_context(|| dataset.origin(index))?);
    let readings = reader.read_plates(&image, &camera, &known)?;
    let frame = Frame::new(String::new(), dataset.labels(index)?, known);
    let pair = |(place, target): (usize, Option<Target>)| {
        let target = target.filter(is_plain)?;
        let first = MeasuredDepth::of(&frame.predictions[place].detection)?;
        Some(DepthPair { true_m: target.depth_m, first, second: readings[place]? })
    };
    Ok(told(&frame).filter_map(pair).collect())
}

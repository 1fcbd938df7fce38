//! What a model in training is worth on held-out frames: a detector alone, a second stage behind the shipped detector.

use std::path::Path;

use anyhow::{Context, Result};
use farsight_core::detection::DecodeOptions;
use farsight_data::open_labelled;
use farsight_eval::ap::{Metric, OverlapSet};
use farsight_eval::ranging::{Group, RangingMetric, RangingOptions};
use farsight_eval::{Difficulty, EvaluatedClass, Evaluation, Frame};
use farsight_methods::plate_reader::PlateReaderModel;
use farsight_methods::refiner::RefinerModel;
use farsight_train::config::ValidateConfig;

use super::eval::MIN_SCORE;
use crate::engines::{EngineArgs, open_detector, open_shipped, plate_reader, refiner, shipped_refiner};
use crate::pipeline::Pipeline;

/// AP and distance errors of Moderate cars, by name.
pub(super) fn validated(model: &Path, config: &ValidateConfig) -> Result<Vec<(String, f64)>> {
    let dataset = open_labelled(&config.root, Some(&config.split))?;
    let count = if config.limit == 0 { dataset.len() } else { config.limit.min(dataset.len()) };
    let mut pipeline = pipeline_of(model)?;
    let mut evaluation = Evaluation::new(RangingOptions { bootstrap: None, ..RangingOptions::default() });
    for index in 0..count {
        let found = pipeline.detect(&dataset.image(index)?, &dataset.camera(index)?);
        let found = found.with_context(|| dataset.origin(index))?;
        evaluation.add(&Frame::new(dataset.id(index), dataset.labels(index)?, found));
    }
    let report = evaluation.report();
    let ap = |set, metric| {
        let ap = report.ap.ap(set, metric, EvaluatedClass::Car);
        ap.map_or(0.0, |ap| ap.r40[Difficulty::Moderate as usize])
    };
    let group = report.ranging.group(EvaluatedClass::Car, Group::Level(Difficulty::Moderate));
    let cars = &group.context("no car in the labels of these frames")?.whole;
    let mut measured = vec![
        ("ap3d".to_owned(), ap(OverlapSet::Strict, Metric::Box3d)),
        ("ap3d_05".to_owned(), ap(OverlapSet::Loose, Metric::Box3d)),
        ("ap2d".to_owned(), ap(OverlapSet::Strict, Metric::Image)),
        ("found".to_owned(), cars.found as f64 / cars.objects.max(1) as f64),
    ];
    measured.extend(cars.metrics.get(RangingMetric::MaeZ).map(|mae_m| ("mae_m".to_owned(), mae_m)));
    Ok(measured)
}

/// The model in the file `model` with what it needs in front of it, and nothing behind it.
fn pipeline_of(model: &Path) -> Result<Pipeline> {
    let args = EngineArgs::default();
    let options = DecodeOptions { min_score: Some(MIN_SCORE), ..DecodeOptions::default() };
    let shipped_detector = || anyhow::Ok(Pipeline::new(Box::new(open_shipped()?), options));
    if RefinerModel::is_one(model) {
        return Ok(shipped_detector()?.with_refiner(refiner(&args, RefinerModel::read(model)?)?));
    }
    if PlateReaderModel::is_one(model) {
        let refined = shipped_detector()?.with_refiner(shipped_refiner(&args)?);
        return Ok(refined.with_plate_reader(plate_reader(&args, PlateReaderModel::read(model)?)?));
    }
    let (detector, _) = open_detector(&args, Some(model))?;
    Ok(Pipeline::new(Box::new(detector), options))
}

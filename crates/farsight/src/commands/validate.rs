//! What a model in training is worth on held-out frames: a detector alone, a second stage behind the shipped detector.

use std::path::Path;

use anyhow::{Context, Result};
use farsight::object::detections;
use farsight::shipped::Family;
use farsight::{ModelSource, Pipeline, Road, StageSource};
use farsight_data::open_labelled;
use farsight_eval::ap::{Metric, OverlapSet};
use farsight_eval::ranging::{Group, RangingMetric, RangingOptions};
use farsight_eval::{Difficulty, EvaluatedClass, Evaluation, Frame};
use farsight_methods::plate_reader::PlateReaderModel;
use farsight_methods::refiner::RefinerModel;
use farsight_train::config::ValidateConfig;

use super::eval::MIN_SCORE;

/// AP and distance errors of Moderate cars, by name.
pub(super) fn validated(model: &Path, config: &ValidateConfig) -> Result<Vec<(String, f64)>> {
    let dataset = open_labelled(&config.root, Some(&config.split))?;
    let count = if config.limit == 0 { dataset.len() } else { config.limit.min(dataset.len()) };
    let pipeline = pipeline_of(model)?;
    let mut evaluation = Evaluation::new(RangingOptions { bootstrap: None, ..RangingOptions::default() });
    for index in 0..count {
        let found = pipeline.detect(&dataset.image(index)?, &dataset.camera(index)?);
        let found = detections(&found.with_context(|| dataset.origin(index))?);
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
    let file = model.to_owned();
    let builder = Pipeline::builder().road(Road::Ignored).min_score(MIN_SCORE);
    let builder = if RefinerModel::is_one(model) {
        builder.refiner(StageSource::File(file)).plates(StageSource::Off)
    } else if PlateReaderModel::is_one(model) {
        builder.model(ModelSource::Shipped(Family::FarsightS)).plates(StageSource::File(file))
    } else {
        builder.model(ModelSource::File(file)).refiner(StageSource::Off).plates(StageSource::Off)
    };
    Ok(builder.open()?)
}

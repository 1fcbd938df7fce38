//! What a model in training is worth: its detector alone looks at held-out frames.

use std::path::Path;

use anyhow::{Context, Result};
use farsight::object::detections;
use farsight::{ModelSource, Pipeline, Road, StageSource};
use farsight_data::open_labelled;
use farsight_eval::ap::{Metric, OverlapSet};
use farsight_eval::ranging::{Group, RangingMetric, RangingOptions};
use farsight_eval::{Difficulty, EvaluatedClass, Evaluation, Frame};
use farsight_train::config::ValidateConfig;

use super::eval::MIN_SCORE;

/// AP and distance errors of Moderate cars, by name.
pub(super) fn validated(model: &Path, config: &ValidateConfig) -> Result<Vec<(String, f64)>> {
    let dataset = open_labelled(&config.root, Some(&config.split))?;
    let count = if config.limit == 0 { dataset.len() } else { config.limit.min(dataset.len()) };
    // The detector alone.
    let builder = Pipeline::builder().model(ModelSource::File(model.to_owned()));
    let builder = builder.refiner(StageSource::Off).plates(StageSource::Off).road(Road::Ignored);
    let pipeline = builder.min_score(MIN_SCORE).open()?;
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

//! `farsight export` of a camera estimator: how far off it is, fitted on frames whose cameras are known.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use farsight::EngineOptions;
use farsight::second_stage::camera_estimator;
use farsight_core::statistics::{quantile, sorted};
use farsight_data::open_labelled;
use farsight_methods::camera_estimator::CameraEstimatorModel;

use super::{ExportArgs, Outcome};
use crate::printer::{Printer, progress_bar};

/// Fewer frames say little about errors.
const MIN_FRAMES: usize = 20;

/// So many of the true values lie within one error bar.
const SHARE: f64 = 0.68;

/// Photographs are unlike rendered scenes: errors on those of the four cameras of `docs/cameras.md` are about so many
/// times as large.
const IN_PHOTOGRAPHS: f64 = 2.0;

/// Fits the error bar of the focal length on `data`, and writes the model.
pub(super) fn run(
    mut model: CameraEstimatorModel,
    args: &ExportArgs,
    data: &Path,
    printer: &mut Printer,
) -> Result<Outcome> {
    model.config.error_scale = 1.0;
    let dataset = open_labelled(data, None)?;
    let frames = dataset.len();
    ensure!(frames >= MIN_FRAMES, "{}: {frames} frames; expected at least {MIN_FRAMES}", data.display());
    let mut estimator = camera_estimator(&model, &EngineOptions::default())?;
    let bar = progress_bar(frames);
    // How far off each is, and that in error bars.
    let (mut errors, mut ratios) = (Vec::new(), Vec::new());
    for index in 0..frames {
        let (camera, image) = (dataset.camera(index)?, dataset.image(index)?);
        let estimate = estimator.look(&image).with_context(|| dataset.origin(index))?;
        let error = (estimate.focal_px / camera.focal_x()).ln().abs();
        errors.push(error);
        ratios.push(error / estimate.focal_log_sigma);
        bar.inc(1);
    }
    bar.finish_and_clear();
    let rendered_scale = quantile(&sorted(ratios), SHARE);
    model.config.error_scale = IN_PHOTOGRAPHS * rendered_scale;
    model.write_half(&args.out)?;
    printer.line(&format!(
        "focal length {:.1}% off in the median; error bars {rendered_scale:.2} times what the network says, and \
         {IN_PHOTOGRAPHS} times that for photographs",
        100.0 * quantile(&sorted(errors), 0.5)
    ));
    printer.line(&format!("{}: half-precision numbers", args.out.display()));
    Ok(Outcome::Done)
}

//! `farsight export` of a refiner: how its second look and the first look of the shipped model go together, fitted on labelled frames.

use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use farsight_core::detection::DecodeOptions;
use farsight_core::refine::{LooksExample, TwoLooks};
use farsight_core::score::{LEAST_EXAMPLES, LEAST_PEAK};
use farsight_data::{KittiDataset, read_image};
use farsight_eval::{Difficulty, Frame};
use farsight_infer::{Detector, Refiner};
use farsight_net::refiner::RefinerModel;
use indicatif::ProgressBar;

use super::fit::told;
use super::{ExportArgs, Outcome};
use crate::engines::{EngineArgs, open_detector};
use crate::printer::Printer;

/// Fits the refiner and writes it.
pub(super) fn run(args: &ExportArgs, printer: &mut Printer) -> Result<Outcome> {
    let (Some(data), true) = (&args.fit_on, args.half) else {
        bail!("{}: a refiner; expected --half and --fit-on DIR beside it", args.model.display());
    };
    ensure!(
        args.input.is_none() && args.focal_range.is_none(),
        "{}: a refiner; --input and --focal-range are of detectors",
        args.model.display()
    );
    let mut model = RefinerModel::read(&args.model)?;
    let examples = examples(&model, data)?;
    let Some(looks) = TwoLooks::fit(&examples) else {
        bail!("{}: {} objects found; expected at least {LEAST_EXAMPLES}", data.display(), examples.len());
    };
    printer.status(&format!(
        "fitted on {} objects: second look's distances times {:.3}, its error bars times {:.2}; errors correlated by {:.2}, error bars of both times {:.2}",
        examples.len(),
        looks.depth_factor,
        looks.error_factor,
        looks.correlation,
        looks.joint_error_factor
    ));
    model.config.looks = looks;
    model.write(&args.out)?;
    printer.line(&format!("{}: half-precision numbers", args.out.display()));
    Ok(Outcome::Done)
}

/// What both looks say of the Moderate objects of all frames that the shipped model finds.
fn examples(model: &RefinerModel, data: &Path) -> Result<Vec<LooksExample>> {
    let dataset = KittiDataset::open(data, None)?;
    let options = DecodeOptions { min_score: Some(LEAST_PEAK), ..DecodeOptions::default() };
    let mut detector = open_detector(&EngineArgs::default(), None, options)?;
    let has_error_bars = detector.spec().codec.depth.error.is_some();
    ensure!(has_error_bars, "the first look has no error bars; expected a model after `farsight export --fit-on`");
    let mut refiner = Refiner::new(model, None)?;
    let bar = ProgressBar::new(dataset.len() as u64);
    let mut examples = Vec::new();
    for index in 0..dataset.len() {
        examples.extend(examples_in_frame(&mut detector, &mut refiner, &dataset, index)?);
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(examples)
}

fn examples_in_frame(
    detector: &mut Detector,
    refiner: &mut Refiner,
    dataset: &KittiDataset,
    index: usize,
) -> Result<Vec<LooksExample>> {
    let (path, camera) = (dataset.image_path(index), dataset.load_camera(index)?);
    let image = read_image(&path)?;
    let detections = detector.detect(&image, &camera).with_context(|| path.display().to_string())?;
    let frame = Frame::new(String::new(), dataset.load_labels(index)?, detections);
    let plain = told(&frame).filter_map(|(detection, target)| {
        let target = target?;
        let is_plain = target.difficulty.is_some_and(|difficulty| difficulty <= Difficulty::Moderate);
        is_plain.then(|| (detection.clone(), target.depth_m))
    });
    let (detections, depths): (Vec<_>, Vec<f64>) = plain.unzip();
    let looks = refiner.second_looks(&image, &camera, &detections)?;
    let seen = detections.iter().zip(depths).zip(looks);
    let example = seen.filter_map(|((detection, true_m), look)| {
        let first = [detection.box3d.depth_m(), detection.range_sigma_m?];
        let second = look?;
        Some(LooksExample { true_m, first, second: [second.box3d.depth_m(), second.depth_sigma] })
    });
    Ok(example.collect())
}

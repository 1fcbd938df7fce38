//! `farsight export --scores-from`: scores that are probabilities, fitted on labelled frames.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result, bail};
use farsight_core::detection::DecodeOptions;
use farsight_core::score::{LEAST_EXAMPLES, LEAST_PEAK, ScoreCalibration, ScoreExample};
use farsight_core::{Detection, ObjectClass};
use farsight_data::{KittiDataset, read_image};
use farsight_eval::ranging::{RangingOptions, matched};
use farsight_eval::{Difficulty, Frame};
use farsight_infer::Detector;
use farsight_net::model::Model;
use farsight_net::onnx::{OnnxModel, Target};
use indicatif::ProgressBar;

use crate::engines::{EngineArgs, detector_of};
use crate::printer::Printer;

/// Examples of each class.
type Examples = BTreeMap<ObjectClass, Vec<ScoreExample>>;

/// Fits the scores of `model` on all frames of `data`: a class with enough examples on its own ones, the others on those of all.
pub(super) fn calibrate(model: &mut Model, source: &Path, data: &Path, printer: &mut Printer) -> Result<()> {
    for class in &mut model.config.classes {
        class.score = None;
    }
    let file = OnnxModel::from_model(model, Target::Portable, source)?;
    let options = DecodeOptions { min_score: Some(LEAST_PEAK), ..DecodeOptions::default() };
    let mut detector = detector_of(&EngineArgs::default(), file, source, options)?;
    let examples = examples(&mut detector, &KittiDataset::open(data, None)?)?;

    let all: Vec<ScoreExample> = examples.values().flatten().copied().collect();
    let Some(of_all) = ScoreCalibration::fit(&all) else {
        let right = all.iter().filter(|example| example.is_right).count();
        let wrong = all.len() - right;
        let found = format!("{right} right and {wrong} wrong detections");
        bail!("{}: {found}; expected at least {LEAST_EXAMPLES} of each to fit scores on", data.display());
    };
    for class in &mut model.config.classes {
        let own = examples.get(&class.class).and_then(|examples| ScoreCalibration::fit(examples));
        let of = if own.is_some() { "its own detections" } else { "the detections of all classes" };
        printer.status(&format!("scores of {}: fitted on {of}", class.class));
        class.score = Some(own.unwrap_or(of_all));
    }
    Ok(())
}

fn examples(detector: &mut Detector, dataset: &KittiDataset) -> Result<Examples> {
    let mut examples = Examples::new();
    let bar = ProgressBar::new(dataset.len() as u64);
    for index in 0..dataset.len() {
        let (path, camera) = (dataset.image_path(index), dataset.load_camera(index)?);
        let image = read_image(&path)?;
        let image_size = [image.width() as usize, image.height() as usize];
        let input_scale = detector.spec().input_for(image_size, &camera).size[0] as f64 / image_size[0] as f64;
        let detections = detector.detect(&image, &camera).with_context(|| path.display().to_string())?;
        let frame = Frame::new(String::new(), dataset.load_labels(index)?, detections);
        for (detection, is_right) in judged(&frame) {
            let height_px = detection.box2d.height() * input_scale;
            let example = ScoreExample { peak: detection.score, height_px, is_right };
            examples.entry(detection.class.clone()).or_default().push(example);
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(examples)
}

/// The detections of which the labels say whether they are right: too low ones and those that are excused are left out.
fn judged(frame: &Frame) -> impl Iterator<Item = (&Detection, bool)> {
    let (targets, false_alarms) = matched(frame, 0, &RangingOptions::default());
    let right = targets.into_iter().filter_map(|target| Some((target.found?.claim, true)));
    let wrong = false_alarms.into_iter().map(|alarm| (alarm.claim, false));
    let told = right.chain(wrong).map(|(claim, is_right)| (&frame.claims[claim as usize].detection, is_right));
    told.filter(|(detection, _)| !Difficulty::Moderate.ignores_detection(&detection.box2d))
}

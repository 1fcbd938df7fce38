//! `farsight export --fit-on`: distances that are right in the median and have error bars, and scores that are
//! probabilities; fitted on labelled frames.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result, bail};
use farsight::EngineOptions;
use farsight::detector::smoke_detector;
use farsight_core::depth_fusion::DepthPair;
use farsight_core::detection::DecodeOptions;
use farsight_core::range_error::DepthExample;
use farsight_core::score::{MIN_EXAMPLES, MIN_PEAK, ScoreExample};
use farsight_core::{Camera, DepthFusion, Detection, ObjectClass, RangeError, ScoreCalibration};
use farsight_data::{Dataset, open_labelled};
use farsight_eval::ranging::{RangingOptions, Target, match_frame};
use farsight_eval::{Difficulty, Frame};
use farsight_methods::smoke::SmokeModel;
use farsight_methods::smoke::{DetectorFile, SmokeDetector};
use farsight_methods::{DetectError, Detector};
use image::RgbImage;

use crate::printer::{Printer, progress_bar};

/// A detection of which the labels say whether it is right.
struct Judged {
    class: ObjectClass,
    /// Height of its box, pixels of the network's input.
    height_px: f64,
    /// Its virtual depth and its score.
    found_m: f64,
    score: f64,
    /// Whether the image's border cuts its box.
    is_cut: bool,
    /// The virtual depth of what it found; none of a false alarm.
    true_m: Option<f64>,
    /// Whether that is one of the Moderate objects, which show enough of themselves to be ranged.
    is_plain: bool,
}

impl Judged {
    fn depth_example(&self) -> Option<DepthExample> {
        Some(DepthExample { found_m: self.found_m, true_m: self.true_m?, score: self.score, is_cut: self.is_cut })
    }

    fn score_example(&self) -> ScoreExample {
        ScoreExample { peak: self.score, height_px: self.height_px, is_right: self.true_m.is_some() }
    }
}

/// Fits `model` to the frames of `data`, those of `split` if one is named: first its distances, because they change the
/// boxes, then its scores and, knowing those, its error bars.
pub(in crate::commands) fn fit(
    model: &mut SmokeModel,
    source: &Path,
    data: &Path,
    split: Option<&Path>,
    printer: &mut Printer,
) -> Result<()> {
    for class in &mut model.config.classes {
        class.score = None;
    }
    model.config.depth.error = None;
    let dataset = open_labelled(data, split)?;
    let first = judged_by_model(model, source, &*dataset)?;
    fit_distances(model, &first, printer).with_context(|| data.display().to_string())?;
    let mut second = judged_by_model(model, source, &*dataset)?;
    fit_scores(model, &second, printer).with_context(|| data.display().to_string())?;
    for judged in &mut second {
        judged.score = probability(model, judged);
    }
    model.config.depth.error = RangeError::fit(&depth_examples(&second));
    let bars = if model.config.depth.error.is_some() { "fitted" } else { "none: too few objects found" };
    printer.status(&format!("error bars: {bars}"));
    Ok(())
}

fn depth_examples<'a>(judged: impl IntoIterator<Item = &'a Judged>) -> Vec<DepthExample> {
    judged.into_iter().filter_map(Judged::depth_example).collect()
}

fn fit_distances(model: &mut SmokeModel, judged: &[Judged], printer: &mut Printer) -> Result<()> {
    let examples = depth_examples(judged.iter().filter(|judged| judged.is_plain));
    let old = model.config.depth;
    let Some(new) = old.refitted(&examples) else {
        bail!("{} objects found; expected at least {MIN_EXAMPLES}, near and far, to fit distances on", examples.len());
    };
    let slope = new.std_m / old.std_m;
    let offset_m = new.mean_m - slope * old.mean_m;
    printer.status(&format!("distances: times {slope:.3}, {offset_m:+.2} m, fitted on {} objects", examples.len()));
    model.config.depth = new;
    Ok(())
}

/// A class with enough examples gets the fit of its own ones, the others that of all.
fn fit_scores(model: &mut SmokeModel, judged: &[Judged], printer: &mut Printer) -> Result<()> {
    let mut examples: BTreeMap<&ObjectClass, Vec<ScoreExample>> = BTreeMap::new();
    for judged in judged {
        examples.entry(&judged.class).or_default().push(judged.score_example());
    }
    let all: Vec<ScoreExample> = examples.values().flatten().copied().collect();
    let Some(of_all) = ScoreCalibration::fit(&all) else {
        let right = all.iter().filter(|example| example.is_right).count();
        let wrong = all.len() - right;
        bail!("{right} right and {wrong} wrong detections; expected at least {MIN_EXAMPLES} of each to fit scores on");
    };
    for class in &mut model.config.classes {
        let own = examples.get(&class.class).and_then(|examples| ScoreCalibration::fit(examples));
        let of = if own.is_some() { "its own detections" } else { "the detections of all classes" };
        printer.status(&format!("scores of {}: fitted on {of}", class.class));
        class.score = Some(own.unwrap_or(of_all));
    }
    Ok(())
}

/// The fitted score of a detection whose score is still its peak.
fn probability(model: &SmokeModel, judged: &Judged) -> f64 {
    let class = model.config.classes.iter().find(|class| class.class == judged.class);
    let calibration = class.and_then(|class| class.score);
    calibration.map_or(judged.score, |calibration| calibration.probability(judged.score, judged.height_px))
}

/// What `model` finds in all frames of `dataset`, but for what the labels do not judge.
fn judged_by_model(model: &SmokeModel, source: &Path, dataset: &dyn Dataset) -> Result<Vec<Judged>> {
    let file = DetectorFile::from_model(model, farsight_onnx::Target::Portable, source)?;
    let options = DecodeOptions { min_score: Some(MIN_PEAK), ..DecodeOptions::default() };
    let mut detector = smoke_detector(&EngineOptions::default(), file, source)?;
    let mut found = Vec::new();
    let bar = progress_bar(dataset.len());
    for index in 0..dataset.len() {
        found.extend(judged_in_frame(&mut detector, &options, dataset, index)?);
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok(found)
}

fn judged_in_frame(
    detector: &mut SmokeDetector,
    options: &DecodeOptions,
    dataset: &dyn Dataset,
    index: usize,
) -> Result<Vec<Judged>> {
    let (camera, image) = (dataset.camera(index)?, dataset.image(index)?);
    let view = detector.input().view([image.width() as usize, image.height() as usize], &camera);
    let detections = detected(detector, options, &image, &camera).with_context(|| dataset.origin(index))?;
    let frame = Frame::new(String::new(), dataset.labels(index)?, detections);
    let reference = &detector.post_processor().codec().depth;
    let judged = |(place, target): (usize, Option<Target>)| {
        let detection = &frame.predictions[place].detection;
        Judged {
            class: detection.class.clone(),
            height_px: view.input_height_px(&detection.box2d),
            found_m: view.virtual_depth_m(reference, detection.box3d.depth_m()),
            score: detection.score,
            is_cut: view.cuts(&detection.box2d),
            true_m: target.as_ref().map(|target| view.virtual_depth_m(reference, target.depth_m)),
            is_plain: target.as_ref().is_some_and(is_plain),
        }
    };
    Ok(told(&frame).map(judged).collect())
}

/// What a detector finds in one image, with nothing to follow.
pub(super) fn detected(
    detector: &mut dyn Detector,
    options: &DecodeOptions,
    image: &RgbImage,
    camera: &Camera,
) -> Result<Vec<Detection>, DetectError> {
    let (mut found, _) = detector.detect_batch(&[(image, camera)], options)?;
    Ok(found.pop().unwrap_or_default())
}

/// How the depths of two measurements go together; `second` is what messages call the one that is corrected.
pub(super) fn fitted_depths(
    pairs: &[DepthPair],
    second: &str,
    is_second_alone: bool,
    printer: &mut Printer,
) -> Result<DepthFusion> {
    let Some(depths) = DepthFusion::fit(pairs, is_second_alone) else {
        bail!("{} objects found; expected at least {MIN_EXAMPLES}", pairs.len());
    };
    printer.status(&format!(
        "fitted on {} objects: {second}'s distances times {:.3}, its error bars times {:.2}; errors correlated by {:.2}, \
         error bars of both times {:.2} and to the power of {:.1}{}",
        pairs.len(),
        depths.depth_factor,
        depths.error_factor,
        depths.correlation,
        depths.joint_error_factor,
        depths.joint_error_power,
        if depths.is_second_alone { "; the detector's distances have no say" } else { "" }
    ));
    Ok(depths)
}

/// Whether it shows enough of itself to be ranged: one of the Moderate objects.
pub(super) fn is_plain(target: &Target) -> bool {
    target.difficulty.is_some_and(|difficulty| difficulty <= Difficulty::Moderate)
}

/// The detections of which the labels say whether they are right, by their places in the frame, with what they found:
/// too low ones and those that are excused are left out.
pub(super) fn told(frame: &Frame) -> impl Iterator<Item = (usize, Option<Target>)> {
    let (targets, false_alarms) = match_frame(frame, 0, &RangingOptions::default());
    let right = targets.into_iter().filter_map(|target| Some((target.found?.prediction as usize, Some(target))));
    let wrong = false_alarms.into_iter().map(|alarm| (alarm.prediction as usize, None));
    let is_high = |place: usize| !Difficulty::Moderate.ignores_detection(&frame.predictions[place].detection.box2d);
    right.chain(wrong).filter(move |(place, _)| is_high(*place))
}

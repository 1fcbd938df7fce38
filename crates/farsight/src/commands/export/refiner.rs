//! `farsight export` of a refiner: how it and the shipped detector go together, fitted on labelled frames.

use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use farsight::detector::open_detector;
use farsight::second_stage::refiner;
use farsight::{EngineOptions, ModelSource};
use farsight_core::depth_fusion::DepthPair;
use farsight_core::detection::DecodeOptions;
use farsight_core::score::{LEAST_EXAMPLES, LEAST_PEAK};
use farsight_core::{Camera, Detection, Label, MeasuredDepth, ObjectClass};
use farsight_data::{Dataset, open_labelled};
use farsight_eval::Frame;
use farsight_eval::ranging::Target;
use farsight_methods::Detector;
use farsight_methods::refiner::Refiner;
use farsight_methods::refiner::RefinerModel;
use farsight_methods::refiner::geometry::{FusedScoreExample, FusedScores, Refinement, StageFusion};

use super::fit::{detected, fitted_depths, is_plain, told};
use super::{ExportArgs, Outcome};
use crate::printer::{Printer, progress_bar};

/// Fits the refiner to `data` and writes it.
pub(super) fn run(mut model: RefinerModel, args: &ExportArgs, data: &Path, printer: &mut Printer) -> Result<Outcome> {
    let (seen, classes) = two_stage_frames(&model, &args.detector, data)?;
    let pairs: Vec<DepthPair> = seen.iter().flat_map(TwoStageFrame::depth_pairs).collect();
    let depths = fitted_depths(&pairs, "refiner", printer).with_context(|| data.display().to_string())?;
    model.config.fusion = StageFusion { depths, ..StageFusion::default() };
    let scores = fitted_scores(&model.config.fusion, &seen, &classes, printer);
    model.config.fusion.scores = scores.with_context(|| data.display().to_string())?;
    model.write_half(&args.out)?;
    printer.line(&format!("{}: half-precision numbers", args.out.display()));
    Ok(Outcome::Done)
}

fn fitted_scores(
    fusion: &StageFusion,
    seen: &[TwoStageFrame],
    classes: &[ObjectClass],
    printer: &mut Printer,
) -> Result<FusedScores> {
    let examples: Vec<FusedScoreExample> = seen.iter().flat_map(|frame| frame.score_examples(fusion)).collect();
    let right = examples.iter().filter(|example| example.is_right).count();
    let wrong = examples.len() - right;
    let Some(scores) = FusedScores::fit(&examples, classes) else {
        bail!(
            "{right} right and {wrong} wrong detections; expected at least {LEAST_EXAMPLES} of each to fit scores on"
        );
    };
    printer.status(&format!("scores: fitted on {right} right and {wrong} wrong detections"));
    Ok(scores)
}

/// A frame with the answers of both stages.
struct TwoStageFrame {
    camera: Camera,
    image_size: [usize; 2],
    labels: Vec<Label>,
    first: Vec<Detection>,
    second: Vec<Option<Refinement>>,
}

impl TwoStageFrame {
    /// What both stages say of the Moderate objects that the first one finds.
    fn depth_pairs(&self) -> Vec<DepthPair> {
        let example = |(place, target): (usize, Option<Target>)| {
            let target = target.filter(is_plain)?;
            let first = MeasuredDepth::of(&self.first[place])?;
            Some(DepthPair { true_m: target.depth_m, first, second: self.second[place].as_ref()?.depth() })
        };
        told(&self.judged_by(&self.first)).filter_map(example).collect()
    }

    /// What speaks for each detection after both stages, and whether it is right where they place it.
    fn score_examples(&self, fusion: &StageFusion) -> Vec<FusedScoreExample> {
        let both = self.first.iter().zip(&self.second);
        let joined: Vec<Detection> =
            both.map(|(first, second)| fusion.fused(first, second.as_ref(), &self.camera, self.image_size)).collect();
        let example = |(place, target): (usize, Option<Target>)| {
            let (first, second) = (&self.first[place], self.second[place].as_ref()?);
            Some(FusedScoreExample {
                class: first.class.clone(),
                evidence: fusion.evidence(first, second, &self.camera, self.image_size),
                is_right: target.is_some(),
            })
        };
        told(&self.judged_by(&joined)).filter_map(example).collect()
    }

    fn judged_by(&self, detections: &[Detection]) -> Frame {
        Frame::new(String::new(), self.labels.clone(), detections.to_vec())
    }
}

/// All frames of `data` as the detector and the refiner see them, and the detector's classes.
fn two_stage_frames(
    model: &RefinerModel,
    detector: &Path,
    data: &Path,
) -> Result<(Vec<TwoStageFrame>, Vec<ObjectClass>)> {
    let dataset = open_labelled(data, None)?;
    let options = DecodeOptions { min_score: Some(LEAST_PEAK), ..DecodeOptions::default() };
    let engine = EngineOptions::default();
    let mut detector = open_detector(&ModelSource::from_word(detector), &engine)?;
    ensure!(
        detector.has_error_bars(),
        "the detector has no error bars; expected a model after `farsight export --fit-on`"
    );
    let classes = detector.classes().iter().map(|class| class.class.clone()).collect();
    let mut refiner = refiner(model, &engine)?;
    let bar = progress_bar(dataset.len());
    let mut seen = Vec::with_capacity(dataset.len());
    for index in 0..dataset.len() {
        seen.push(two_stage_frame(&mut *detector, &options, &mut refiner, &*dataset, index)?);
        bar.inc(1);
    }
    bar.finish_and_clear();
    Ok((seen, classes))
}

fn two_stage_frame(
    detector: &mut dyn Detector,
    options: &DecodeOptions,
    refiner: &mut Refiner,
    dataset: &dyn Dataset,
    index: usize,
) -> Result<TwoStageFrame> {
    let (camera, image) = (dataset.camera(index)?, dataset.image(index)?);
    let first = detected(detector, options, &image, &camera).with_context(|| dataset.origin(index))?;
    let second = refiner.refinements(&image, &camera, &first)?;
    let image_size = [image.width(), image.height()].map(|side| side as usize);
    Ok(TwoStageFrame { camera, image_size, labels: dataset.labels(index)?, first, second })
}

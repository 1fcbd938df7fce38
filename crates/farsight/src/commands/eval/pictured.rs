//! The frames of a report, with what was found and what is there drawn on their images.

use std::collections::BTreeSet;
use std::path::Path;

use anyhow::{Context, Result};
use farsight_core::Detection;
use farsight_data::kitti::Calibration;
use farsight_data::{image_named, read_image};
use farsight_eval::page::{FrameErrors, SHOWN_SCORE, ShownFrame, ShownScene, chosen_scenes, frame_of, worst_frames};
use farsight_eval::{Evaluation, Findings, Frame, FrameFiles};
use farsight_viz::{DrawOptions, Names, Scene, annotate_named};
use image::RgbImage;

use super::EvalArgs;

/// Detections drawn on an image; with more, nobody could tell them apart.
const DRAWN: usize = 30;

/// Frames that have no picture although images were given, each told once however often the page has it.
#[derive(Debug, Default)]
pub(super) struct Unseen {
    frames: BTreeSet<String>,
    pub(super) findings: Findings,
}

/// The worst frames, and those of them that have no picture.
pub(super) fn worst(args: &EvalArgs, files: &FrameFiles, evaluation: &Evaluation) -> Result<(Vec<ShownFrame>, Unseen)> {
    let mut unseen = Unseen::default();
    let mut shown = Vec::new();
    for worst in worst_frames(evaluation.targets(), files.ids()) {
        let (frame, _) = files.read(&worst.id)?;
        let image = args.images.as_deref().and_then(|images| seen(images, &frame, &worst, None, &mut unseen));
        shown.push(ShownFrame { worst, frame, image });
    }
    Ok((shown, unseen))
}

/// Scenes chosen by their labels, as two results have them: ours and those that they are compared with.
pub(super) fn scenes(
    images: &Path,
    results: [(&FrameFiles, &Evaluation); 2],
    unseen: &mut Unseen,
) -> Result<Vec<ShownScene>> {
    let mut shown = Vec::new();
    for scene in chosen_scenes(results[0].1.targets()) {
        let mut sides = Vec::new();
        for (files, evaluation) in results {
            let of_result = frame_of(evaluation.targets(), files.ids(), scene.frame).context("no such frame")?;
            let (frame, _) = files.read(&of_result.id)?;
            let image = seen(images, &frame, &of_result, Some(SHOWN_SCORE), unseen);
            sides.push((of_result, image));
        }
        let [(ours, our_image), (theirs, their_image)] =
            <[_; 2]>::try_from(sides).ok().context("two results have two sides")?;
        shown.push(ShownScene { scene, results: [ours, theirs], images: [our_image, their_image] });
    }
    Ok(shown)
}

/// What [`drawn`] draws; none where it cannot be drawn: a page without one picture is better than no page.
fn seen(
    images: &Path,
    frame: &Frame,
    worst: &FrameErrors,
    least_score: Option<f64>,
    unseen: &mut Unseen,
) -> Option<RgbImage> {
    let drawn = drawn(images, frame, worst, least_score);
    if let Err(why) = &drawn
        && unseen.frames.insert(frame.id.clone())
    {
        unseen.findings.add("frames on the page without a picture", || format!("{why:#}"));
    }
    drawn.ok()
}

/// The frame's image with its detections and labels, named as `--explain` names them.
fn drawn(images: &Path, frame: &Frame, worst: &FrameErrors, least_score: Option<f64>) -> Result<RgbImage> {
    let id = &frame.id;
    let path = image_named(images, id);
    let path = path.with_context(|| format!("{}: no image of frame {id}; expected {id}.png", images.display()))?;
    let image = read_image(&path)?;
    let calibration = images.parent().unwrap_or(images).join("calib").join(format!("{id}.txt"));
    let camera = Calibration::read(&calibration)?.camera();

    let shown = drawn_predictions(frame, worst, least_score);
    let detections: Vec<_> = shown.iter().map(|&prediction| frame.predictions[prediction].detection.clone()).collect();
    let prediction_names: Vec<_> = shown.iter().map(|prediction| format!("d{prediction}")).collect();
    let label_names: Vec<_> = (0..frame.labels.len()).map(|label| format!("g{label}")).collect();
    let scene = Scene { camera: &camera, detections: &detections, truth: &frame.labels };
    let names = Names { detections: &prediction_names, truth: &label_names };
    Ok(annotate_named(&image, &scene, &DrawOptions::default(), &names))
}

/// Positions of the detections to draw: those that found an object, then the best scored others from `least_score` on,
/// at most [`DRAWN`].
fn drawn_predictions(frame: &Frame, worst: &FrameErrors, least_score: Option<f64>) -> Vec<usize> {
    let has_found = |prediction: usize| {
        worst.targets.iter().filter_map(|target| target.found).any(|found| found.prediction as usize == prediction)
    };
    let score = |prediction: usize| {
        let Detection { score, .. } = frame.predictions[prediction].detection;
        score
    };
    let is_drawn = |prediction: &usize| {
        has_found(*prediction) || least_score.is_none_or(|least_score| score(*prediction) >= least_score)
    };
    let mut predictions: Vec<_> = (0..frame.predictions.len()).filter(is_drawn).collect();
    predictions.sort_by(|&a, &b| has_found(b).cmp(&has_found(a)).then(score(b).total_cmp(&score(a))));
    predictions.truncate(DRAWN);
    predictions
}

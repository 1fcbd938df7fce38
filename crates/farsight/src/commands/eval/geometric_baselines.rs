//! `farsight eval --geometric-baselines`: the same detections with the distances that they would have without a
//! network.

use anyhow::Result;
use farsight_core::geometric_baseline::{depth_from_ground, depth_from_height};
use farsight_core::{Camera, Detection};
use farsight_eval::ranging::RangingOptions;
use farsight_eval::{EvaluatedClass, Evaluation, Frame, FrameFiles, text};
use farsight_synth::sizes::SizeStatistics;

use super::{EvalArgs, Files};
use crate::printer::Printer;

/// Height of KITTI's camera above the road, metres (Geiger et al. 2013).
pub(in crate::commands) const CAMERA_HEIGHT_M: f64 = 1.65;

/// Depth of a detection by its 2D box; `None` when the box says nothing.
type Ranger<'a> = &'a dyn Fn(&Detection, &Camera) -> Option<f64>;

/// Camera of a frame by its id.
type CameraOf<'a> = &'a dyn Fn(&str) -> Result<Camera>;

/// Prints the errors of the two geometric baselines on the detections of `files`. Detections that a ranger can say
/// nothing about count as not found.
pub(super) fn run(args: &EvalArgs, source: &Files, files: &FrameFiles, printer: &mut Printer) -> Result<()> {
    let options = RangingOptions { bootstrap: None, ..args.ranging_options() };
    for (_, what, evaluation) in evaluations(&|id| source.camera(id), files, args.camera_height, &options)? {
        printer.line("");
        printer.heading(&format!("the same detections, ranged by {what}"));
        for line in text::moderate_lines(&evaluation.report().ranging, EvaluatedClass::Car) {
            printer.line(&line);
        }
    }
    Ok(())
}

/// Name and description of each geometric baseline, and the detections of `files` with its distances. The camera is so
/// high above the ground.
pub(in crate::commands) fn evaluations(
    camera: CameraOf,
    files: &FrameFiles,
    camera_height_m: f64,
    options: &RangingOptions,
) -> Result<[(&'static str, &'static str, Evaluation); 2]> {
    let by_height = |detection: &Detection, camera: &Camera| {
        let sizes = SizeStatistics::of(&detection.class);
        depth_from_height(&detection.box2d, camera, sizes.height.mean, sizes.length.mean / 2.0)
    };
    let by_ground = |detection: &Detection, camera: &Camera| {
        let sizes = SizeStatistics::of(&detection.class);
        depth_from_ground(&detection.box2d, camera, camera_height_m, sizes.length.mean / 2.0)
    };
    Ok([
        (
            "similar_triangles",
            "similar triangles: mean height of the class over the height of the 2D box",
            evaluated(camera, files, options, &by_height)?,
        ),
        (
            "inverse_perspective",
            "inverse perspective: the bottom edge of the 2D box on flat ground",
            evaluated(camera, files, options, &by_ground)?,
        ),
    ])
}

fn evaluated(camera: CameraOf, files: &FrameFiles, options: &RangingOptions, ranger: Ranger) -> Result<Evaluation> {
    let mut evaluation = Evaluation::new(options.clone());
    for id in files.ids() {
        let camera = camera(id)?;
        let (Frame { id, labels, predictions }, _) = files.read(id)?;
        let moved = predictions.into_iter().filter_map(|prediction| moved(prediction.detection, &camera, ranger));
        evaluation.add(&Frame::new(id, labels, moved.collect()));
    }
    Ok(evaluation)
}

/// The detection at the ranger's depth, its centre on the same ray.
fn moved(mut detection: Detection, camera: &Camera, ranger: Ranger) -> Option<Detection> {
    let depth_m = ranger(&detection, camera)?;
    let pixel = camera.pixel_from_point(detection.box3d.center())?;
    let [x, y, z] = camera.point_from_pixel(pixel, depth_m);
    detection.box3d.location = [x, y + detection.box3d.dimensions.height / 2.0, z];
    detection.range_sigma_m = None;
    Some(detection)
}

//! `farsight eval --classic`: the same detections with the distances that they would have without a network.

use anyhow::Result;
use farsight_core::geometric_baseline::{depth_from_ground, depth_from_height};
use farsight_core::{Camera, Detection};
use farsight_eval::ranging::RangingOptions;
use farsight_eval::{EvaluatedClass, Evaluation, Frame, FrameFiles, text};
use farsight_synth::sizes::SizeStatistics;

use super::{EvalArgs, Files};
use crate::printer::Printer;

/// Height of KITTI's camera above the road, metres (Geiger et al. 2013).
pub(super) const CAMERA_HEIGHT_M: f64 = 1.65;

/// Depth of a detection by its 2D box; `None` when the box says nothing.
type Ranger<'a> = &'a dyn Fn(&Detection, &Camera) -> Option<f64>;

/// Prints the errors of the two classic rangers on the detections of `files`. Detections that a ranger can say nothing about count as not found.
pub(super) fn run(args: &EvalArgs, source: &Files, files: &FrameFiles, printer: &mut Printer) -> Result<()> {
    let camera_height_m = args.camera_height;
    let by_height = |detection: &Detection, camera: &Camera| {
        let sizes = SizeStatistics::of(&detection.class);
        depth_from_height(&detection.box2d, camera, sizes.height.mean, sizes.length.mean / 2.0)
    };
    let by_ground = |detection: &Detection, camera: &Camera| {
        let sizes = SizeStatistics::of(&detection.class);
        depth_from_ground(&detection.box2d, camera, camera_height_m, sizes.length.mean / 2.0)
    };
    let rangers: [(&str, Ranger); 2] = [
        ("similar triangles: mean height of the class over the height of the 2D box", &by_height),
        ("inverse perspective: the bottom edge of the 2D box on flat ground", &by_ground),
    ];
    for (name, ranger) in rangers {
        let report = evaluated(args, source, files, ranger)?.report();
        printer.line("");
        printer.heading(&format!("the same detections, ranged by {name}"));
        for line in text::moderate_lines(&report.ranging, EvaluatedClass::Car) {
            printer.line(&line);
        }
    }
    Ok(())
}

fn evaluated(args: &EvalArgs, source: &Files, files: &FrameFiles, ranger: Ranger) -> Result<Evaluation> {
    let mut evaluation = Evaluation::new(RangingOptions { bootstrap: None, ..args.ranging_options() });
    for id in files.ids() {
        let camera = source.camera(id)?;
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

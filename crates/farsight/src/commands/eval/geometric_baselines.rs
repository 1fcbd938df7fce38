//! `farsight eval --geometric-baselines`: the same detections with the distances that they would have without a
//! network.

use anyhow::Result;
use farsight_core::Camera;
use farsight_eval::ranging::RangingOptions;
use farsight_eval::{EvaluatedClass, Evaluation, Frame, FrameFiles, text};

use super::{EvalArgs, Files};
use crate::printer::Printer;
use crate::rangers::{Ranger, RangerName};

/// Camera of a frame by its id.
type CameraOf<'a> = &'a dyn Fn(&str) -> Result<Camera>;

/// Prints the errors of the geometric baselines on the detections of `files`. Detections that a ranger can say nothing
/// about count as not found.
pub(super) fn run(args: &EvalArgs, source: &Files, files: &FrameFiles, printer: &mut Printer) -> Result<()> {
    let options = RangingOptions { bootstrap: None, ..args.ranging_options(None) };
    for (name, evaluation) in evaluations(&|id| source.camera(id), files, args.camera_height, &options)? {
        printer.line("");
        printer.heading(&format!("the same detections, ranged by {}", name.description()));
        for line in text::moderate_lines(&evaluation.report().ranging, EvaluatedClass::Car) {
            printer.line(&line);
        }
    }
    Ok(())
}

/// Each geometric baseline, and the detections of `files` with its distances. The camera is so high above the ground.
pub(in crate::commands) fn evaluations(
    camera: CameraOf,
    files: &FrameFiles,
    camera_height_m: f64,
    options: &RangingOptions,
) -> Result<Vec<(RangerName, Evaluation)>> {
    let rangers = RangerName::ALL.map(|name| Ranger::geometric(name, camera_height_m).map(|ranger| (name, ranger)));
    let evaluated = |(name, ranger): (RangerName, Ranger)| {
        let mut evaluation = Evaluation::new(options.clone());
        for id in files.ids() {
            let camera = camera(id)?;
            let (Frame { id, labels, predictions }, _) = files.read(id)?;
            let detections = predictions.into_iter().map(|prediction| prediction.detection).collect();
            evaluation.add(&Frame::new(id, labels, ranger.ranged(detections, &camera)));
        }
        Ok((name, evaluation))
    };
    rangers.into_iter().flatten().map(evaluated).collect()
}

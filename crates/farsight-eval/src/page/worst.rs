//! The objects of a frame by their errors of distance, and the frames with the largest.

use crate::ranging::Target;

/// Frames shown on the page.
const SHOWN: usize = 20;

/// A frame and the objects in it, the worst first.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameErrors {
    /// Position of the frame in the set.
    pub frame: usize,
    /// Its name.
    pub id: String,
    /// Its objects of evaluated classes: found ones by error, largest first, then the missed ones.
    pub targets: Vec<Target>,
}

impl FrameErrors {
    /// The largest absolute error of z, metres.
    pub fn worst_error_m(&self) -> f64 {
        self.targets.first().map_or(0.0, error_m)
    }
}

/// The twenty frames with the largest error of z of an object that counts at some difficulty; `ids` are the names of
/// all frames.
pub fn worst_frames(targets: &[Target], ids: &[String]) -> Vec<FrameErrors> {
    let frames = targets.chunk_by(|a, b| a.frame == b.frame).filter_map(|of_frame| by_error(of_frame, ids));
    let mut frames: Vec<_> = frames.filter(|frame| frame.worst_error_m() > 0.0).collect();
    frames.sort_by(|a, b| b.worst_error_m().total_cmp(&a.worst_error_m()));
    frames.truncate(SHOWN);
    frames
}

/// The frame at this position with its objects by error; none without any object.
pub fn frame_of(targets: &[Target], ids: &[String], frame: usize) -> Option<FrameErrors> {
    by_error(targets.chunk_by(|a, b| a.frame == b.frame).find(|targets| targets[0].frame as usize == frame)?, ids)
}

fn by_error(of_frame: &[Target], ids: &[String]) -> Option<FrameErrors> {
    let frame = of_frame.first()?.frame as usize;
    let mut targets: Vec<_> = of_frame.iter().filter(|target| target.difficulty.is_some()).cloned().collect();
    targets.sort_by(|a, b| error_m(b).total_cmp(&error_m(a)));
    Some(FrameErrors { frame, id: ids.get(frame)?.clone(), targets })
}

/// The absolute error of z, metres; -1 for an object that was missed, so that it comes last.
fn error_m(target: &Target) -> f64 {
    target.found.map_or(-1.0, |found| (found.depth_m - target.depth_m).abs())
}

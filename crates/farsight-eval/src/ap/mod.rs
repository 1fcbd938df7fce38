//! Average precision, equal to the official KITTI devkit (spec kitti-eval.md; differences: the evaluation rows of
//! `PARITY.md`).
//!
//! A frame is reduced once, for each class, to objects, the detections that may match them, and their overlaps. Each
//! overlap is computed once, and only where two boxes can touch. All curves are made from that afterwards. The devkit
//! computes every overlap anew for each of up to 41 score thresholds, three difficulties and two passes.
//!
//! The outcomes of a curve are kept by frame ([`CurveOutcomes`]), so frames can be drawn at random for intervals.

mod accumulator;
mod class_frame;
mod curve;
mod intervals;
mod matching;
mod metric;
mod outcomes;
mod report;
mod scores;
mod thresholds;

pub use accumulator::ApAccumulator;
pub use class_frame::{ClassFrame, FrameLabel, FrameObject, FramePrediction};
pub use curve::{Curve, RECALL_POINTS, ScoreThreshold};
pub use intervals::{ApIntervals, ApSample};
pub use metric::{CurveSpec, Metric, OverlapSet, Overlaps};
pub use outcomes::CurveOutcomes;
pub use report::{ApReport, ApTable, ApValues};
pub use scores::ScoreRange;

pub(crate) use matching::{MatchOutcome, Matching, outcomes};

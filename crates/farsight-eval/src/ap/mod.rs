//! Average precision, equal to the official KITTI devkit (spec kitti-eval.md; differences: the evaluation rows of `PARITY.md`).
//!
//! A frame is boiled down once to a scene: objects, detections that may meet them, and their overlaps, each computed once and only
//! where two boxes can touch. All curves are drawn from the scenes afterwards. The devkit computes every overlap anew for each of up to 41
//! score limits, three difficulties and two passes.

mod curve;
mod matching;
mod metric;
mod report;
mod scene;
mod scores;
mod set;

pub use curve::{Curve, Limit, RECALL_POINTS};
pub use metric::{Metric, OverlapSet, Overlaps};
pub use report::{ApReport, ApTable, ApValues};
pub use scene::{Scene, SceneClaim, SceneLabel, SceneObject};
pub use set::SceneSet;

pub(crate) use matching::{Fate, Matching, fates};

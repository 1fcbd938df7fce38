//! Errors of distance, by a protocol that is fixed so that figures can be audited (spec msfe-dgh.md, section 4).
//!
//! Per frame and class, detections take turns by score, highest first; each takes the free ground truth of its class
//! with the largest 2D overlap, if that is at least [`MATCH_IOU`]. Errors are detection minus truth, of z and of the
//! distance over the ground. Beside every error stands the share of objects that were found: a detector that keeps
//! silent about hard objects has small errors and a small share.
//!
//! ```
//! use farsight_eval::{Frame, ranging::{RangingReport, RangingOptions, targets}};
//! # let frames: Vec<Frame> = vec![];
//! let options = RangingOptions::default();
//! let found: Vec<_> = frames.iter().zip(0..).flat_map(|(frame, index)| targets(frame, index, &options)).collect();
//! let report = RangingReport::new(&found, frames.len(), &options);
//! ```

mod calibration;
mod compare;
mod matching;
mod metrics;
mod operating;
mod options;
mod report;
mod slices;
mod tally;

pub use calibration::{Calibration, CoveragePoint, CoverageRow, Share};
pub use compare::{ComparisonRow, Difference, RangingComparison};
pub(crate) use compare::{PairedTallies, same_objects};
pub use matching::{FalseAlarm, Measurement, Target, match_frame, targets};
pub use metrics::{RangingMetric, RangingMetrics};
pub(crate) use operating::AlarmLimit;
pub use operating::{OperatingPoint, OperatingPoints};
pub use options::{MATCH_IOU, RangingOptions};
pub use report::{ClassRanging, FIXED_RECALL, FixedRecall, GroupRanging, Named, RangingReport, SliceErrors};
pub use slices::{Group, Slice};

//! The KITTI evaluation and ranging errors.
//!
//! Nothing here needs the disk: a trainer hands in [`Frame`]s as they come and asks for the report.
//!
//! | module | question |
//! |---|---|
//! | [`ap`] | how good is the detector by KITTI's average precision? |
//! | [`explain`] | what became of each object and detection of one frame? |
//! | [`ranging`] | how far off are the distances, and of how many objects? |

pub mod ap;
pub mod class;
pub mod difficulty;
pub mod evaluation;
pub mod explain;
pub mod files;
pub mod findings;
pub mod frame;
#[cfg(feature = "page")]
pub mod page;
pub mod ranging;
pub mod text;

pub use class::EvaluatedClass;
pub use difficulty::Difficulty;
pub use evaluation::{Evaluation, Report};
pub use files::{FilesError, FrameFiles};
pub use findings::{Finding, Findings};
pub use frame::{Claim, Frame};

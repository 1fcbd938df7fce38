//! The KITTI evaluation and ranging errors.
//!
//! Nothing here needs the disk: a trainer hands in [`Frame`]s as they come and asks for the report.
//!
//! | module | question |
//! |---|---|
//! | [`ap`] | how good is the detector by KITTI's average precision? |
//! | [`ranging`] | how far off are the distances, and of how many objects? |

pub mod ap;
pub mod class;
pub mod difficulty;
pub mod frame;
pub mod ranging;

pub use class::EvaluatedClass;
pub use difficulty::Difficulty;
pub use frame::{Claim, Frame};

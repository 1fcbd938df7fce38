//! What was found, as recordings that other programs play: MCAP for Foxglove and ROS 2 ([`McapRecording`]), and rerun's
//! own (`RerunRecording`, with the feature `rerun`).
//!
//! A recording is a list of [`RecordedFrame`]s. Frames of reference, as all messages name them:
//!
//! | frame | what it is |
//! |---|---|
//! | `camera_link` | where the camera looks: x forward, y left, z up (REP 103) |
//! | `camera` | Farsight's camera coordinates, in which boxes are: x right, y down, z forward |
//! | `camera_optical` | the image's own: `camera`, turned and moved as the projection `K [R | t]` says |
//!
//! The last two are the same for most cameras. KITTI's differ by 6 cm, and cameras that look down by a rotation.

mod boxes;
mod cdr;
mod detection3d;
mod error;
mod geometry;
mod mcap_file;
mod recorded_frame;
mod rerun_file;

pub use error::RecordingError;
pub use mcap_file::McapRecording;
pub use recorded_frame::{RecordedFrame, RecordedObject};
pub use rerun_file::RerunRecording;

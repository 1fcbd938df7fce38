//! How good the tracks of sequences are: [`crate::tracking`]'s metrics in the image and in space, and the errors of
//! distance, speed and time to collision with the coverage of their error bars.
//!
//! Objects of one class that are Moderate by KITTI's rules count. Tracks that lie on an object of another class, on one
//! that is harder to see, or in a `DontCare` region are left out, as in KITTI's tracking benchmark.
//!
//! | module | what it is for |
//! |---|---|
//! | `labels` | label files of KITTI's tracking benchmark, and the velocities of rendered sequences |
//! | `sequence` | who is whom in each frame |
//! | `errors` | errors and coverage |
//! | `lifetimes` | how soon objects are told of, and for how long |
//! | `report` | several sequences together, and against others |
//! | `text`, `page` | the report for people; the course of each track |

mod errors;
mod labels;
mod lifetimes;
mod page;
mod report;
mod sequence;
mod text;

use farsight_core::{Box2d, Box3d, Label, ObjectClass};

pub use errors::{Errors, Sample, TTC_BINS, TtcBin};
pub use labels::{MAX_FRAMES, TrackLabelError, read_sequence};
pub use lifetimes::{Lifetime, Lifetimes};
pub use page::page;
pub use report::{Difference, Figures, TracksReport, differences};
pub use sequence::{JudgedSequence, judge};
pub use text::{differences_text, rows, text};

/// What is true of a frame.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct GroundTruthFrame {
    /// Who is there.
    pub tracks: Vec<GroundTruthTrack>,
    /// Regions without labels.
    pub dont_care: Vec<Box2d>,
}

/// Somebody who is there.
#[derive(Debug, Clone, PartialEq)]
pub struct GroundTruthTrack {
    /// Its identity.
    pub id: u64,
    /// Its label.
    pub label: Label,
    /// Relative to the camera, to the right, down and ahead, m/s; where it is known.
    pub velocity_mps: Option<[f64; 3]>,
    /// Over the ground, m/s; where it is known.
    pub speed_mps: Option<f64>,
}

/// What is told of a frame.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PredictedFrame {
    /// Its time, seconds.
    pub time_s: f64,
    /// The tracks.
    pub tracks: Vec<PredictedTrack>,
}

/// A track that is told of.
#[derive(Debug, Clone, PartialEq)]
pub struct PredictedTrack {
    /// Its identity.
    pub id: u64,
    /// Its class.
    pub class: ObjectClass,
    /// In the image, pixels.
    pub box2d: Box2d,
    /// In space.
    pub box3d: Box3d,
    /// Standard deviation of its depth, metres.
    pub range_sigma_m: Option<f64>,
    /// Closing speed and its standard deviation, m/s; where it is told.
    pub closing_mps: Option<[f64; 2]>,
    /// Time to collision, seconds; where it is told.
    pub ttc_s: Option<f64>,
    /// It lies between these with 90%; the second is none where it may never be.
    pub ttc_interval_s: Option<(f64, Option<f64>)>,
    /// Speed over the ground and its standard deviation, m/s; where it is told.
    pub speed_mps: Option<[f64; 2]>,
}

//! Frames that cannot be taken.

use thiserror::Error;

/// Why a frame was refused. The tracks are as they were before.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum TrackError {
    /// A time that is no number.
    #[error("a frame at {time_s} s; expected a finite number of seconds")]
    Time {
        /// Its time, seconds.
        time_s: f64,
    },
    /// A frame that is not after the last one: out of order, or there twice.
    #[error("a frame at {time_s} s after one at {last_s} s; expected a later time")]
    NotAfter {
        /// Its time, seconds.
        time_s: f64,
        /// Time of the last frame, seconds.
        last_s: f64,
    },
    /// A frame without pixels.
    #[error("a frame of {} x {} pixels; expected some", size[0], size[1])]
    Size {
        /// Width and height, pixels.
        size: [usize; 2],
    },
    /// A detection that is nowhere.
    #[error("detection {place} has {what} {value}; expected a {expected}")]
    Detection {
        /// Its place in the frame, from 0.
        place: usize,
        /// Which of its numbers.
        what: &'static str,
        /// The number.
        value: f64,
        /// What was expected of it.
        expected: &'static str,
    },
}

//! Tracks of vehicles and people through video: identity, distance, speed and time to collision, each with its error
//! bar.
//!
//! [`Tracker::update`] takes the detections of one frame and answers the tracks at its time. No file is read here, and
//! no picture is looked at.
//!
//! Frames of reference are KITTI's: x right, y down, z forward, metres; an object stands at the centre of its bottom
//! face. Velocities are relative to the camera and in its axes.
//!
//! # Method
//! The error of one image's distance is mostly a wrong size, and it stays: the next image has the same. Such an error
//! is a factor on distance and speed, and leaves their ratio alone. So the filter keeps logarithms: of the depth of the
//! nearest face, and of its rate of change `k`, from which time to collision is `-1 / k`. Two measurements speak of
//! them: the distance of each image, with a factor that drifts slowly, and the height of the box in the image, which
//! tells changes of distance much better than distance. The height's own errors are correlated in time and modelled so.
//!
//! Objects move in two ways that take turns, evenly and with a foot on a pedal: an interacting multiple model
//! (`modes`). Where the camera's own motion is known, what probably stands still is told as if it did, and its distance
//! follows from how fast it comes nearer. The filter goes on without that assumption.

mod acceleration;
mod assignment;
mod association;
mod error;
mod filter;
mod modes;
mod options;
mod state;
mod track;
mod tracker;

pub use assignment::assigned;
pub use error::TrackError;
pub use options::{Motion, Noise, TrackerOptions};
pub use track::{Acceleration, Closing, EgoMotion, Track, Velocity};
pub use tracker::{Frame, Tracker};

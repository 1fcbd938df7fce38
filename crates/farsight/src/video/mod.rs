//! Vehicles through a video: what `farsight track` does with each frame.
//!
//! ```no_run
//! use farsight::video::{DEFAULT_LOW_SCORE, VideoOptions, VideoSource, VideoTracker};
//!
//! // A film, an address or a camera device, which the user's ffmpeg reads; or a folder of images with frames a second.
//! let source = VideoSource::open("film.mp4", None)?;
//! // Detections of low scores continue tracks, so the pipeline is to tell them.
//! let pipeline = farsight::Pipeline::builder().low_score(DEFAULT_LOW_SCORE).open()?;
//! let mut tracker = VideoTracker::new(pipeline, farsight::CameraSource::FieldOfView(65.0));
//! for frame in source.frames(&VideoOptions::default())? {
//!     let followed = tracker.update(&frame?)?;
//!     for track in &followed.record.tracks {
//!         println!("{} {} {:.1} m, closing {:?} m/s", track.id, track.class, track.range_m, track.closing_mps);
//!     }
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Who has frames already makes [`VideoFrame`]s of them and needs no source. Who has detections already hands them to
//! [`VideoTracker::update_with`]. Who has several cores looks at neighbouring frames side by side with the
//! [`FrameDetector`] of the tracker, and hands that what it finds, in order.

pub mod ego;
mod ego_height;
mod error;
pub mod events;
mod ffmpeg;
mod frame_detector;
mod live;
mod scene_cut;
mod source;
mod stream;
mod tracker;
mod visual_ego;

pub use ego::{EgoError, EgoFile};
pub use ego_height::EgoHeight;
pub use error::VideoError;
pub use events::{Event, EventFinder, EventKind};
pub use ffmpeg::{Decoded, FrameStream, unstarted};
pub use frame_detector::FrameDetector;
pub use source::{VideoFrame, VideoFrames, VideoOptions, VideoSource, is_video};
pub use tracker::{DEFAULT_LOW_SCORE, FrameWarning, TrackingResult, VideoTracker, low_score};

//! Why there is no frame, or nothing is known of one.

use std::io;
use std::path::PathBuf;

use farsight_core::camera::CameraError;
use farsight_data::{IMAGE_FORMATS, ImageError};
use farsight_methods::DetectError;
use farsight_track::TrackError;
use thiserror::Error;

use crate::camera_source::CameraSourceError;

/// A video that cannot be read or followed. Only what concerns a single frame leaves others to come.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum VideoError {
    /// There is no ffmpeg.
    #[error(
        "{}: no such program; videos need ffmpeg: install it (apt install ffmpeg, brew install ffmpeg), \
         name it with --ffmpeg FILE, or give the frames as images",
        .0.display()
    )]
    NoFfmpeg(PathBuf),
    /// ffmpeg does not start.
    #[error("{}: cannot be started: {source}", ffmpeg.display())]
    Ffmpeg {
        /// The program.
        ffmpeg: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// ffmpeg finds no frames in it, or ended with an error.
    #[error("{}: cannot be read as a video: {told}", path.display())]
    NoVideo {
        /// The file, address or device.
        path: PathBuf,
        /// What ffmpeg says.
        told: String,
    },
    /// All frames were read, and ffmpeg complained of some.
    #[error("{}: damaged: {told}", path.display())]
    Damaged {
        /// The file, address or device.
        path: PathBuf,
        /// What ffmpeg says.
        told: String,
    },
    /// The video ends within a frame.
    #[error("{place}: broke off: {told}")]
    BrokeOff {
        /// The video and the frame.
        place: String,
        /// What ffmpeg or the system says.
        told: String,
    },
    /// Nothing came of a live stream for a while.
    #[error("{}: no frame for {waited_s} s", path.display())]
    Stalled {
        /// The address or device.
        path: PathBuf,
        /// How long it was waited for, seconds.
        waited_s: f64,
    },
    /// A frame that is too large to be looked at.
    #[error("{place}: {}x{} pixels; expected at most {most} (--max-pixels)", size[0], size[1])]
    TooLarge {
        /// The video and the frame.
        place: String,
        /// Width and height, pixels.
        size: [u32; 2],
        /// Most pixels.
        most: u64,
    },
    /// A frame without a time.
    #[error("{place}: has no time")]
    NoTime {
        /// The video and the frame.
        place: String,
    },
    /// Images of which nothing tells the time.
    #[error("{}: images have no times; expected their number in a second", .0.display())]
    NoFps(PathBuf),
    /// A video has times of its own.
    #[error("{}: a video has times of its own; expected no number of frames in a second", .0.display())]
    Fps(PathBuf),
    /// A folder that cannot be read.
    #[error("{}: cannot be listed: {source}", folder.display())]
    Folder {
        /// The folder.
        folder: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// A folder without images.
    #[error("{}: no images in this folder; expected files of {IMAGE_FORMATS}", .0.display())]
    NoImages(PathBuf),
    /// An image that cannot be read.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A frame whose camera is not known.
    #[error(transparent)]
    CameraSource(#[from] CameraSourceError),
    /// Numbers that no camera has.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The pipeline failed.
    #[error("{place}: {source}")]
    Detect {
        /// The frame.
        place: String,
        /// What it says.
        source: Box<DetectError>,
    },
    /// A frame that cannot be followed, as it is not later than the one before.
    #[error("{place}: {source}")]
    Track {
        /// The frame.
        place: String,
        /// What is wrong.
        source: TrackError,
    },
}

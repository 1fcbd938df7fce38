//! Where frames come from: images, or what ffmpeg reads.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use farsight_data::{Exif, ImageLimits, UnsupportedFormat, has_image_extension, load_image};
use image::RgbImage;

use super::error::VideoError;
use super::ffmpeg::Decoded;
use super::live::Live;
use super::stream::Stream;

/// One frame.
#[derive(Debug, Clone, PartialEq)]
pub struct VideoFrame {
    /// From 0; frames that cannot be read count.
    pub number: u64,
    /// Its time, seconds.
    pub time_s: f64,
    /// 8-bit RGB, upright.
    pub image: RgbImage,
    /// The image, or the video.
    pub path: PathBuf,
    /// What an image says of its camera.
    pub exif: Exif,
    is_image: bool,
}

impl VideoFrame {
    /// A frame of the video called `path`; it need not be a file.
    pub fn new(number: u64, time_s: f64, image: RgbImage, path: impl Into<PathBuf>) -> Self {
        Self { number, time_s, image, path: path.into(), exif: Exif::NONE, is_image: false }
    }

    /// What errors call it.
    pub fn place(&self) -> String {
        let Self { number, path, .. } = self;
        if self.is_image { path.display().to_string() } else { format!("{}: frame {number}", path.display()) }
    }
}

/// What there is to read.
#[derive(Debug, Clone, PartialEq)]
pub enum VideoSource {
    /// Images, one a frame.
    Images {
        /// Their files, in order.
        files: Vec<PathBuf>,
        /// Frames a second.
        fps: f64,
    },
    /// A file, an address or a device, which ffmpeg reads.
    Video(PathBuf),
}

/// How a video is read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct VideoOptions {
    /// The ffmpeg program.
    pub ffmpeg: PathBuf,
    /// Only the latest frame waits; those that came in between are left out. Of images none are.
    pub realtime: bool,
    /// A live stream or device that gives no frame for so long is opened again.
    pub patience: Duration,
}

impl Default for VideoOptions {
    fn default() -> Self {
        Self { ffmpeg: "ffmpeg".into(), realtime: false, patience: Duration::from_secs(10) }
    }
}

/// Addresses that ffmpeg reads.
const SCHEMES: [&str; 9] =
    ["rtsp://", "rtsps://", "rtmp://", "http://", "https://", "udp://", "tcp://", "srt://", "rtp://"];

impl VideoSource {
    /// A film, an address or a camera device; or a folder of images in the order of their names, of which `fps` are
    /// taken in a second.
    ///
    /// # Errors
    /// When a folder has no images or cannot be read, or `fps` is missing for one or given for a video.
    pub fn open(path: impl AsRef<Path>, fps: Option<f64>) -> Result<Self, VideoError> {
        let path = path.as_ref();
        if !path.is_dir() {
            return if fps.is_some() { Err(VideoError::Fps(path.into())) } else { Ok(Self::Video(path.into())) };
        }
        let unlisted = |source| VideoError::Folder { folder: path.to_owned(), source };
        let mut files = Vec::new();
        for entry in fs::read_dir(path).map_err(unlisted)? {
            let file = entry.map_err(unlisted)?.path();
            if has_image_extension(&file) && file.is_file() {
                files.push(file);
            }
        }
        files.sort();
        if files.is_empty() {
            return Err(VideoError::NoImages(path.to_owned()));
        }
        Ok(Self::Images { files, fps: fps.ok_or_else(|| VideoError::NoFps(path.to_owned()))? })
    }

    /// The images, if it is such.
    pub fn images(&self) -> &[PathBuf] {
        match self {
            Self::Images { files, .. } => files,
            Self::Video(_) => &[],
        }
    }

    /// The files that are read.
    pub fn files(&self) -> &[PathBuf] {
        match self {
            Self::Images { files, .. } => files,
            Self::Video(video) => std::slice::from_ref(video),
        }
    }

    /// Whether it is a stream or a device, which does not begin anew when it is read again.
    pub fn is_live(&self) -> bool {
        matches!(self, Self::Video(video) if is_live(video))
    }

    /// Begins to read.
    ///
    /// # Errors
    /// When ffmpeg cannot be started.
    pub fn frames(self, options: &VideoOptions) -> Result<VideoFrames, VideoError> {
        let kind = match self {
            Self::Images { files, fps } => Kind::Images { files, fps, next: 0 },
            Self::Video(video) => {
                let patience = is_live(&video).then_some(options.patience);
                let stream = Stream::start(&options.ffmpeg, &video, patience)?;
                if options.realtime { Kind::Live(Live::start(stream)) } else { Kind::Video(Box::new(stream)) }
            }
        };
        Ok(VideoFrames { kind })
    }
}

/// Addresses that do not begin anew when they are opened again.
const LIVE_SCHEMES: [&str; 7] = ["rtsp://", "rtsps://", "rtmp://", "udp://", "tcp://", "srt://", "rtp://"];

fn is_live(input: &Path) -> bool {
    let text = input.to_string_lossy();
    text.starts_with("/dev/video") || LIVE_SCHEMES.iter().any(|scheme| text.starts_with(scheme))
}

/// Whether `input` is something that ffmpeg is to read: by its name, or because it is a file and no image.
pub fn is_video(input: &Path) -> bool {
    let text = input.to_string_lossy();
    SCHEMES.iter().any(|scheme| text.starts_with(scheme))
        || text.starts_with("/dev/video")
        || UnsupportedFormat::from_name(input) == Some(UnsupportedFormat::Video)
        || (input.is_file() && !has_image_extension(input) && UnsupportedFormat::from_name(input).is_none())
}

/// The frames, one after the other. After an error there may be more: only of a film that broke off there are none.
pub struct VideoFrames {
    kind: Kind,
}

enum Kind {
    Images { files: Vec<PathBuf>, fps: f64, next: usize },
    Video(Box<Stream>),
    Live(Live),
}

impl VideoFrames {
    /// How many there are, where that is known.
    pub fn count_known(&self) -> Option<usize> {
        match &self.kind {
            Kind::Images { files, .. } => Some(files.len()),
            Kind::Video(_) | Kind::Live(_) => None,
        }
    }

    /// Frames that were left out to keep up.
    pub fn dropped(&self) -> u64 {
        if let Kind::Live(live) = &self.kind { live.dropped() } else { 0 }
    }

    /// Frames a second, where that is known; of a video from the first frame on.
    pub fn fps(&self) -> Option<f64> {
        match &self.kind {
            Kind::Images { fps, .. } => Some(*fps),
            Kind::Video(stream) => stream.fps(),
            Kind::Live(live) => live.fps(),
        }
    }
}

impl Iterator for VideoFrames {
    type Item = Result<VideoFrame, VideoError>;

    fn next(&mut self) -> Option<Self::Item> {
        match &mut self.kind {
            Kind::Images { files, fps, next } => {
                let path = files.get(*next)?.clone();
                let number = *next as u64;
                *next += 1;
                let time_s = number as f64 / *fps;
                let loaded = load_image(&path, ImageLimits::default()).map_err(VideoError::from);
                Some(loaded.map(|loaded| VideoFrame {
                    number,
                    time_s,
                    image: loaded.pixels,
                    path,
                    exif: loaded.exif,
                    is_image: true,
                }))
            }
            Kind::Video(stream) => Some(stream.next()?.map(|frame| of_video(frame, stream.path()))),
            Kind::Live(live) => Some(live.next()?.map(|frame| of_video(frame, live.path()))),
        }
    }
}

fn of_video((number, time_s, image): Decoded, path: &Path) -> VideoFrame {
    VideoFrame::new(number, time_s, image, path)
}

//! Where frames come from: images, or what ffmpeg reads.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail, ensure};
use farsight::{Exif, ImageLimits, RgbImage, load_image};
use farsight_data::{Foreign, has_image_extension};

use super::ffmpeg::{Decoded, Decoder};
use super::live::Live;
use super::{NO_EXIF, TrackArgs};
use crate::inputs;
use crate::printer::Printer;

/// One frame.
pub(super) struct VideoFrame {
    /// From 0; frames that cannot be read count.
    pub(super) number: u64,
    pub(super) time_s: f64,
    pub(super) image: RgbImage,
    /// The image, or the video.
    pub(super) path: PathBuf,
    pub(super) exif: Exif,
    is_image: bool,
}

impl VideoFrame {
    /// What errors call it.
    pub(super) fn place(&self) -> String {
        let Self { number, path, .. } = self;
        if self.is_image { path.display().to_string() } else { format!("{}: frame {number}", path.display()) }
    }
}

/// What there is to read.
pub(super) enum Source {
    /// Images, in order, and frames a second.
    Images(Vec<PathBuf>, f64),
    /// A file, an address or a device.
    Video(PathBuf),
}

/// Addresses that ffmpeg reads.
const SCHEMES: [&str; 9] =
    ["rtsp://", "rtsps://", "rtmp://", "http://", "https://", "udp://", "tcp://", "srt://", "rtp://"];

impl Source {
    /// What the arguments mean.
    pub(super) fn find(args: &TrackArgs, printer: &mut Printer) -> Result<Self> {
        let videos: Vec<&PathBuf> = args.inputs.iter().filter(|input| is_video(input)).collect();
        if let [video] = videos[..] {
            let is_alone = args.inputs.len() == 1;
            ensure!(is_alone, "{}: a video beside other inputs; expected it alone", video.display());
            ensure!(args.fps.is_none(), "--fps is for images; {} has times of its own", video.display());
            return Ok(Self::Video(video.clone()));
        }
        ensure!(videos.is_empty(), "{}: one of several videos; expected one", videos[0].display());
        ensure!(!args.realtime, "--realtime is for videos; images wait");
        let found = inputs::find(&args.inputs);
        if let Some(problem) = found.problems.first() {
            // A list with holes has wrong times.
            found.problems.iter().skip(1).for_each(|problem| printer.error(problem));
            bail!("{problem}");
        }
        let Some(fps) = args.fps else {
            bail!("images have no times; expected --fps N, their number in a second");
        };
        Ok(Self::Images(found.images, fps))
    }

    /// The images, if it is such.
    pub(super) fn images(&self) -> &[PathBuf] {
        match self {
            Self::Images(images, _) => images,
            Self::Video(_) => &[],
        }
    }

    /// The files that are read.
    pub(super) fn files(&self) -> &[PathBuf] {
        match self {
            Self::Images(images, _) => images,
            Self::Video(video) => std::slice::from_ref(video),
        }
    }

    /// Begins to read.
    pub(super) fn open(self, args: &TrackArgs) -> Result<Frames> {
        Ok(match self {
            Self::Images(images, fps) => Frames::Images { images, fps, next: 0 },
            Self::Video(video) => {
                let decoder = Decoder::start(&args.ffmpeg, &video)?;
                if args.realtime { Frames::Live(Live::start(decoder)) } else { Frames::Video(Box::new(decoder)) }
            }
        })
    }
}

/// Whether ffmpeg is to read it.
fn is_video(input: &Path) -> bool {
    let text = input.to_string_lossy();
    SCHEMES.iter().any(|scheme| text.starts_with(scheme))
        || text.starts_with("/dev/video")
        || Foreign::from_name(input) == Some(Foreign::Video)
        || (input.is_file() && !has_image_extension(input) && Foreign::from_name(input).is_none())
}

/// The frames, one after the other.
pub(super) enum Frames {
    Images { images: Vec<PathBuf>, fps: f64, next: usize },
    Video(Box<Decoder>),
    Live(Live),
}

impl Frames {
    /// How many there are, where that is known.
    pub(super) fn count(&self) -> Option<usize> {
        match self {
            Self::Images { images, .. } => Some(images.len()),
            Self::Video(_) | Self::Live(_) => None,
        }
    }

    /// Frames that were left out to keep up.
    pub(super) fn dropped(&self) -> u64 {
        if let Self::Live(live) = self { live.dropped() } else { 0 }
    }

    /// Frames a second, where that is known.
    pub(super) fn fps(&self) -> Option<f64> {
        match self {
            Self::Images { fps, .. } => Some(*fps),
            Self::Video(decoder) => decoder.fps(),
            Self::Live(live) => live.fps(),
        }
    }

    /// The next frame. After an error there may be more: only of a video that broke off there are none.
    pub(super) fn next(&mut self) -> Option<Result<VideoFrame>> {
        match self {
            Self::Images { images, fps, next } => {
                let path = images.get(*next)?.clone();
                let number = *next as u64;
                *next += 1;
                let time_s = number as f64 / *fps;
                let loaded = load_image(&path, ImageLimits::default()).map_err(anyhow::Error::from);
                Some(loaded.map(|loaded| VideoFrame {
                    number,
                    time_s,
                    image: loaded.pixels,
                    path,
                    exif: loaded.exif,
                    is_image: true,
                }))
            }
            Self::Video(decoder) => Some(decoder.next()?.map(|frame| of_video(frame, decoder.path()))),
            Self::Live(live) => Some(live.next()?.map(|frame| of_video(frame, live.path()))),
        }
    }
}

fn of_video((number, time_s, image): Decoded, path: &Path) -> VideoFrame {
    VideoFrame { number, time_s, image, path: path.to_owned(), exif: NO_EXIF, is_image: false }
}

//! `farsight track`: follows what is in a video.

mod film;
mod part;
mod sinks;
mod table;

use std::iter;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use anyhow::{Error, Result, bail, ensure};
use clap::Args;
use farsight::video::{EgoFile, VideoError, VideoFrame, VideoOptions, VideoSource, VideoTracker, is_video, low_score};
use farsight::{CameraSource, Pipeline, PipelineBuilder, Road, TrackerOptions, View};
use indicatif::ProgressBar;

use super::Outcome;
use crate::camera_args::{ViewArgs, with_hint};
use crate::inputs;
use crate::pipeline_args::{self, PipelineArgs};
use crate::printer::{Printer, counted, progress_bar};
use crate::recording_file::RecordingArgs;
use crate::shard::ShardArgs;
use crate::side_by_side::in_order;
use sinks::Sinks;

/// Arguments of `farsight track`.
#[derive(Debug, Clone, Args)]
pub(crate) struct TrackArgs {
    /// A video file, an address (rtsp, http) or a camera device, read by ffmpeg; or the frames as images: a folder,
    /// files, a pattern such as 'frames/*.png'
    #[arg(required = true, value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    /// Frames a second of a folder or list of images
    #[arg(long, value_name = "N", value_parser = fps, allow_negative_numbers = true)]
    fps: Option<f64>,
    #[command(flatten)]
    pipeline: PipelineArgs,
    /// Write JSON Lines to FILE, one object a frame, as soon as it is done; "-" prints them instead of the table
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write a summary to FILE, one row a track: CSV, or Parquet if it is called .parquet
    #[arg(long, value_name = "FILE")]
    tracks: Option<PathBuf>,
    /// Write what happens ahead to FILE, one JSON object a line: who cuts in, brakes hard, or is about to be reached
    #[arg(long, value_name = "FILE")]
    events: Option<PathBuf>,
    /// Tell times to collision below this, seconds
    #[arg(long, value_name = "S", requires = "events", default_value_t = DEFAULT_TTC_LIMIT_S, value_parser = ttc_limit, allow_negative_numbers = true)]
    ttc_limit: f64,
    /// Write rows in the format of KITTI's tracking benchmark to FILE
    #[arg(long, value_name = "FILE")]
    kitti_tracking: Option<PathBuf>,
    #[command(flatten)]
    recordings: RecordingArgs,
    /// Write annotated frames to the folder DIR (PNG), or a film to FILE (.mp4, .mkv, .mov, .avi, .webm; by ffmpeg)
    #[arg(long, value_name = "DIR|FILE")]
    out: Option<PathBuf>,
    /// ffmpeg's encoder of the film, such as `h264_nvenc` [default: ffmpeg's choice for the kind of file]
    #[arg(long, value_name = "NAME", requires = "out")]
    encoder: Option<String>,
    /// How the camera moves: rows of KITTI's oxts (a file with one row a frame, or a folder with one file a frame),
    /// poses of KITTI's odometry (12 numbers a frame), or CSV with columns `time_s`, `speed_mps` and `yaw_rate` (rad/s,
    /// to the left); of a film or of images its speed also tells the camera's height, unless that is known. Or "auto"
    /// to estimate it from the frames, which needs the camera's height (--above-road METRES, or a calibration with its
    /// road)
    #[arg(long, value_name = "FILE|DIR|auto")]
    ego: Option<PathBuf>,
    /// Look at the latest frame of a video only, and leave out those that came in between
    #[arg(long, conflicts_with = "shard")]
    realtime: bool,
    /// The ffmpeg program
    #[arg(long, value_name = "FILE", default_value = "ffmpeg")]
    ffmpeg: PathBuf,
    /// A detection of this score begins a track; lower ones may continue one
    /// [default: 0.5, or 0.25 where scores are no probabilities]
    #[arg(long, value_name = "SCORE", value_parser = score, allow_negative_numbers = true)]
    min_score: Option<f64>,
    // Last, because their help headings would go on to what follows.
    #[command(flatten)]
    view: ViewArgs,
    #[command(flatten)]
    shard: ShardArgs,
}

/// The default of the score that begins a track, where it must be known before the model is.
const USUAL_MIN_SCORE: f64 = 0.5;

/// Frames a second that a camera can have.
const MIN_FPS: f64 = 0.1;
const MAX_FPS: f64 = 1000.0;

/// Frames a second.
pub(super) fn fps(text: &str) -> Result<f64, String> {
    let value = text.parse().ok().filter(|value| (MIN_FPS..=MAX_FPS).contains(value));
    value.ok_or_else(|| format!("expected a number from {MIN_FPS} to {MAX_FPS}"))
}

/// Below this time to collision drivers are warned, seconds.
const DEFAULT_TTC_LIMIT_S: f64 = 2.0;

fn ttc_limit(text: &str) -> Result<f64, String> {
    let value = text.parse().ok().filter(|value: &f64| *value > 0.0 && *value <= 60.0);
    value.ok_or_else(|| "expected seconds, more than 0 and at most 60".to_owned())
}

fn score(text: &str) -> Result<f64, String> {
    let value = text.parse().ok().filter(|value| *value > 0.0 && *value < 1.0);
    value.ok_or_else(|| "expected more than 0 and less than 1".to_owned())
}

/// Said where ego motion is to be estimated and nothing tells its scale.
const NO_HEIGHT: &str = "--ego auto: pictures have no scale without the camera's height, so speeds are relative; \
                         expected --above-road METRES, or a calibration with its road";

impl TrackArgs {
    fn is_ego_auto(&self) -> bool {
        self.ego.as_deref().is_some_and(|ego| ego == Path::new("auto"))
    }

    /// The file or folder that tells how the camera moves.
    fn ego_file(&self) -> Option<&Path> {
        self.ego.as_deref().filter(|_| !self.is_ego_auto())
    }

    /// What is said of the camera's height, metres.
    fn height_m(&self) -> Option<f64> {
        match self.pipeline.road.above_road() {
            Some(Road::BelowBy(height_m)) => Some(height_m),
            _ => None,
        }
    }
}

/// Runs the command.
pub(crate) fn run(args: &TrackArgs, printer: &mut Printer) -> Result<Outcome> {
    if args.shard.asked().is_some() {
        return part::run(args, printer);
    }
    follow(args, None, printer)
}

/// What looks at the frames: at neighbouring ones side by side, unless each is to be done as soon as it is there.
fn open(args: &TrackArgs, printer: &mut Printer) -> Result<Pipeline> {
    let low = low_score(args.min_score.unwrap_or(USUAL_MIN_SCORE));
    let images = if args.realtime { 1 } else { usize::MAX };
    let builder = args.pipeline.builder(printer)?.low_score(low).images(images);
    let builder = args.min_score.into_iter().fold(builder, PipelineBuilder::min_score);
    pipeline_args::open_and_tell(&builder, printer)
}

/// Follows what is in one video, with a pipeline that is open or opens now.
fn follow(args: &TrackArgs, pipeline: Option<&Pipeline>, printer: &mut Printer) -> Result<Outcome> {
    let source = source(args, printer)?;
    let views = args.view.source(source.images())?;
    let ego = args.ego_file().map(EgoFile::read).transpose()?;
    let (is_auto, height_m) = (args.is_ego_auto(), args.height_m());
    let has_height = height_m.is_some() || matches!(views.cameras(), CameraSource::OverRoad(..));
    let mut sinks = Sinks::check(args, &source)?;
    let pipeline = pipeline.map_or_else(|| open(args, printer), |pipeline| Ok(pipeline.clone()))?;
    let low = low_score(args.min_score.unwrap_or(USUAL_MIN_SCORE));
    let birth_score = args.min_score.unwrap_or_else(|| pipeline.default_min_score());
    let options = TrackerOptions { birth_score, low_score: low.min(birth_score), ..TrackerOptions::default() };
    if is_auto && !has_height {
        printer.note(NO_HEIGHT);
    } else if ego.is_none() && !is_auto {
        printer.note("speeds are relative to the camera; --ego FILE gives those over the ground");
    }
    let tracker = VideoTracker::new(pipeline, views).with_options(options);
    let reading = VideoOptions { ffmpeg: args.ffmpeg.clone(), realtime: args.realtime, ..VideoOptions::default() };
    let mut tracker = match ego {
        Some(ego) => tracker.with_ego_of_film(ego, &source, &reading)?,
        None if is_auto => tracker.with_visual_ego(height_m),
        None => tracker,
    };
    if let Some([height_m, sigma_m]) = tracker.height_m() {
        printer.note(&format!(
            "by its speed the camera is {height_m:.2} ±{sigma_m:.2} m above the road (--above-road tells)"
        ));
    }
    let mut frames = source.frames(&reading)?;
    let bar = frames.count_known().map_or_else(ProgressBar::hidden, progress_bar);
    let (mut done, mut failed, mut with_ego) = (0_u64, 0_u64, 0_u64);
    let detector = tracker.detector().clone();
    // Frames are read one after the other, so that a camera which is estimated is that of the first.
    let taken = iter::from_fn(|| {
        let taken = frames.next()?.and_then(|frame| Ok((detector.view(&frame)?, frame)));
        Some((taken, frames.fps()))
    });
    let look = |(taken, fps): (Result<(View, VideoFrame), VideoError>, _)| {
        let looked = taken.and_then(|(view, frame)| Ok((detector.detect(&frame, &view)?, view, frame)));
        (looked, fps)
    };
    in_order(taken, detector.pipeline().side_by_side(), look, |(looked, fps)| {
        let followed = looked.and_then(|(objects, view, frame)| {
            let followed = tracker.update_with(&frame, view, &objects)?;
            Ok((frame, followed))
        });
        bar.inc(1);
        match followed.map_err(hinted) {
            Ok((frame, followed)) => {
                done += 1;
                with_ego += u64::from(followed.ego.is_some());
                bar.suspend(|| {
                    followed.warnings.iter().for_each(|warning| printer.warning(&warning.to_string()));
                    sinks.add(&frame, &followed, fps, printer)
                })?;
            }
            Err(error) => {
                bar.suspend(|| printer.failure(&error));
                failed += 1;
            }
        }
        let is_in_vain = printer.reader_is_gone() && !sinks.write_files();
        anyhow::Ok(if is_in_vain { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
    })?;
    bar.finish_and_clear();
    ensure!(done > 0, "nothing was done: {} failed", counted(failed as usize, "frame"));
    let tracks = sinks.finish(printer)?;
    if is_auto && has_height {
        printer.note(&format!("ego motion estimated in {with_ego} of {}", counted(done as usize, "frame")));
    }
    pipeline_args::tell_of_camera(detector.pipeline(), printer);
    let dropped = frames.dropped();
    if dropped > 0 {
        printer.note(&format!("{} left out to keep up (--realtime)", counted(dropped as usize, "frame")));
    }
    let failures = if failed > 0 { format!("; {} failed", counted(failed as usize, "frame")) } else { String::new() };
    printer.status(&format!("{} in {}{failures}", counted(tracks, "track"), counted(done as usize, "frame")));
    Ok(if failed > 0 { Outcome::Told } else { Outcome::Done })
}

/// The error with what would help.
fn hinted(error: VideoError) -> Error {
    match error {
        VideoError::CameraSource(error) => with_hint(error),
        error => Error::from(error),
    }
}

/// What the arguments mean.
fn source(args: &TrackArgs, printer: &mut Printer) -> Result<VideoSource> {
    let videos: Vec<&PathBuf> = args.inputs.iter().filter(|input| is_video(input)).collect();
    if let [video] = videos[..] {
        let is_alone = args.inputs.len() == 1;
        ensure!(is_alone, "{}: a video beside other inputs; expected it alone", video.display());
        ensure!(args.fps.is_none(), "--fps is for images; {} has times of its own", video.display());
        return Ok(VideoSource::Video(video.clone()));
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
    Ok(VideoSource::Images { files: found.images, fps })
}

//! `farsight track`: follows what is in a video.

mod ego;
mod ffmpeg;
mod film;
mod live;
mod scene_cut;
mod scratch;
mod sinks;
mod source;

use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use clap::Args;
use farsight::json::FrameRecord;
use farsight::{Camera, CameraSource, Exif, Frame, Pipeline, Tracker, TrackerOptions};
use farsight_core::Detection;
use indicatif::ProgressBar;

use super::Outcome;
use crate::camera_args::{CameraArgs, with_hint};
use crate::pipeline_args::{self, PipelineArgs};
use crate::printer::{Printer, counted, progress_bar};
use ego::EgoFile;
use scene_cut::SceneCut;
use sinks::Sinks;
use source::{Source, VideoFrame};

/// Arguments of `farsight track`.
#[derive(Debug, Args)]
pub(crate) struct TrackArgs {
    /// A video file, an address (rtsp, http) or a camera device, read by ffmpeg; or the frames as images: a folder, files, a pattern such as 'frames/*.png'
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
    /// Write a summary to FILE, one row a track (CSV)
    #[arg(long, value_name = "FILE")]
    tracks: Option<PathBuf>,
    /// Write rows in the format of KITTI's tracking benchmark to FILE
    #[arg(long, value_name = "FILE")]
    kitti_tracking: Option<PathBuf>,
    /// Write a recording for Foxglove and ROS 2 to FILE (MCAP)
    #[arg(long, value_name = "FILE")]
    mcap: Option<PathBuf>,
    /// Write annotated frames to the folder DIR (PNG), or a film to FILE (.mp4, .mkv, .mov, .avi, .webm; by ffmpeg)
    #[arg(long, value_name = "DIR|FILE")]
    out: Option<PathBuf>,
    /// ffmpeg's encoder of the film, such as `h264_nvenc` [default: ffmpeg's choice for the kind of file]
    #[arg(long, value_name = "NAME", requires = "out")]
    encoder: Option<String>,
    /// How the camera moves: rows of KITTI's oxts (a file with one row a frame, or a folder with one file a frame), or CSV with columns `time_s`, `speed_mps` and `yaw_rate` (rad/s, to the left)
    #[arg(long, value_name = "FILE|DIR")]
    ego: Option<PathBuf>,
    /// Look at the latest frame of a video only, and leave out those that came in between
    #[arg(long)]
    realtime: bool,
    /// The ffmpeg program
    #[arg(long, value_name = "FILE", default_value = "ffmpeg")]
    ffmpeg: PathBuf,
    /// A detection of this score begins a track; lower ones may continue one [default: 0.25, or 0.5 for a model whose scores are probabilities]
    #[arg(long, value_name = "SCORE", value_parser = score, allow_negative_numbers = true)]
    min_score: Option<f64>,
    // Last, because its help heading would go on to what follows.
    #[command(flatten)]
    camera: CameraArgs,
}

/// Detections of this share of the score that begins a track may continue one.
const LOW_SHARE: f64 = 0.4;

/// The default of the score that begins a track, where it must be known before the model is.
const USUAL_MIN_SCORE: f64 = 0.5;

/// Frames a second that a camera can have.
const LEAST_FPS: f64 = 0.1;
const MOST_FPS: f64 = 1000.0;

fn fps(text: &str) -> Result<f64, String> {
    let value = text.parse().ok().filter(|value| (LEAST_FPS..=MOST_FPS).contains(value));
    value.ok_or_else(|| format!("expected a number from {LEAST_FPS} to {MOST_FPS}"))
}

fn score(text: &str) -> Result<f64, String> {
    let value = text.parse().ok().filter(|value| *value > 0.0 && *value < 1.0);
    value.ok_or_else(|| "expected more than 0 and less than 1".to_owned())
}

/// Runs the command.
pub(crate) fn run(args: &TrackArgs, printer: &mut Printer) -> Result<Outcome> {
    let source = Source::find(args, printer)?;
    let cameras = args.camera.source(source.images())?;
    let ego = args.ego.as_deref().map(EgoFile::read).transpose()?;
    let mut sinks = Sinks::check(args, &source)?;
    let low = LOW_SHARE * args.min_score.unwrap_or(USUAL_MIN_SCORE);
    let builder = args.pipeline.builder(printer)?.min_score(low);
    let pipeline = pipeline_args::open_and_tell(&builder, printer)?;
    let birth_score = args.min_score.unwrap_or_else(|| pipeline.default_min_score());
    let options = TrackerOptions { birth_score, low_score: low.min(birth_score), ..TrackerOptions::default() };
    if ego.is_none() {
        printer.note("speeds are relative to the camera; --ego FILE gives those over the ground");
    }
    let mut job = Job {
        pipeline: &pipeline,
        cameras: &cameras,
        ego,
        tracker: Tracker::new(options),
        scene_cut: SceneCut::default(),
        image_size: None,
        told_ego: false,
    };
    let mut frames = source.open(args)?;
    let bar = frames.count().map_or_else(ProgressBar::hidden, progress_bar);
    let (mut done, mut failed) = (0_u64, 0_u64);
    while let Some(frame) = frames.next() {
        let looked = frame.and_then(|frame| {
            let (record, told) = job.look(&frame, printer)?;
            Ok((frame, record, told))
        });
        bar.inc(1);
        let fps = frames.fps();
        match looked {
            Ok((frame, record, told)) => {
                done += 1;
                bar.suspend(|| sinks.add(&frame, &record, &told, fps, printer))?;
            }
            Err(error) => {
                bar.suspend(|| printer.failure(&error));
                failed += 1;
            }
        }
        if printer.reader_is_gone() && !sinks.write_files() {
            break;
        }
    }
    bar.finish_and_clear();
    ensure!(done > 0, "nothing was done: {} failed", counted(failed as usize, "frame"));
    let tracks = sinks.finish(printer)?;
    let dropped = frames.dropped();
    if dropped > 0 {
        printer.note(&format!("{} left out to keep up (--realtime)", counted(dropped as usize, "frame")));
    }
    let failures = if failed > 0 { format!("; {} failed", counted(failed as usize, "frame")) } else { String::new() };
    printer.status(&format!("{} in {}{failures}", counted(tracks, "track"), counted(done as usize, "frame")));
    Ok(if failed > 0 { Outcome::Told } else { Outcome::Done })
}

/// What looks at frames.
struct Job<'a> {
    pipeline: &'a Pipeline,
    cameras: &'a CameraSource,
    ego: Option<EgoFile>,
    tracker: Tracker,
    scene_cut: SceneCut,
    image_size: Option<[usize; 2]>,
    told_ego: bool,
}

/// What is told of a frame beside its record.
struct Told {
    camera: Camera,
    /// The tracks as detections.
    detections: Vec<Detection>,
}

impl Job<'_> {
    fn look(&mut self, frame: &VideoFrame, printer: &mut Printer) -> Result<(FrameRecord, Told)> {
        let VideoFrame { number, time_s, image, path, exif, .. } = frame;
        let place = || frame.place();
        let image_size = [image.width(), image.height()].map(|side| side as usize);
        let camera = self.cameras.camera(path, image_size, exif).map_err(with_hint)?;
        if let Some([width, height]) = self.image_size.replace(image_size).filter(|size| *size != image_size) {
            let [new_width, new_height] = image_size;
            let camera = if matches!(self.cameras, CameraSource::Same(_)) { ", with the same calibration" } else { "" };
            printer.warning(&format!(
                "{}: {new_width}x{new_height} pixels after {width}x{height}; all tracks begin anew{camera}",
                place()
            ));
        }
        let looks_cut = self.scene_cut.looks_cut(image);
        let objects = self.pipeline.detect(image, &camera).with_context(place)?;
        let mut detections = farsight::object::detections(&objects);
        // What is all outside the image has no box in it.
        detections.retain(|one| one.box2d.width() > 0.0 && one.box2d.height() > 0.0 && one.box3d.depth_m() > 0.0);
        let seen = Frame { time_s: *time_s, image_size, camera: &camera, detections: &detections, looks_cut };
        let tracks = self.tracker.update(&seen).with_context(place)?;
        let motion = self.ego.as_ref().and_then(|ego| ego.motion(*number, *time_s));
        if self.ego.is_some() && motion.is_none() && !self.told_ego {
            self.told_ego = true;
            printer.warning(&format!("{}: no ego motion at {time_s:.3} s; its speeds are relative only", place()));
        }
        let record = FrameRecord::new(*number, *time_s, &tracks, motion.as_ref());
        let detections = tracks.iter().map(farsight::Track::detection).collect();
        Ok((record, Told { camera, detections }))
    }
}

/// No EXIF data: of frames that ffmpeg took out.
const NO_EXIF: Exif = Exif::NONE;

//! What is written of each frame, and at the end.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use farsight::RgbImage;
use farsight::draw::{draw_tracks, track_words};
use farsight::json::{FrameRecord, TrackRecord};
use farsight::video::{EventFinder, TrackingResult, VideoFrame, VideoSource};
use farsight_core::Detection;
use farsight_data::UnsupportedFormat;
use farsight_data::kitti::text_from_results;
use farsight_files::{Scratch, write_atomically};
use farsight_recordings::{RecordedFrame, RecordedObject};
use farsight_viz::picture_divisor;
use image::codecs::png::PngEncoder;

use super::TrackArgs;
use super::film::{self, Film};
use super::table::{self, Column, Table};
use crate::inputs::identity;
use crate::outputs;
use crate::printer::Printer;
use crate::recording_file::Recordings;

/// The outputs of one call.
pub(super) struct Sinks {
    json: Option<(PathBuf, Option<File>)>,
    prints_json: bool,
    events: Option<(PathBuf, EventFinder, Option<File>)>,
    tracks: Option<PathBuf>,
    /// Rows grow in a scratch file.
    kitti: Option<(PathBuf, Scratch, File)>,
    recordings: Recordings,
    pictures: Option<Pictures>,
    /// By what the pictures' sides are divided, once it was told.
    divisor: Option<u32>,
    summary: BTreeMap<u64, Summary>,
}

enum Pictures {
    Folder(PathBuf),
    Film(Box<Film>),
}

/// What is told of a track at the end.
struct Summary {
    class: String,
    first: (u64, f64),
    last: (u64, f64),
    seen: u64,
    coasting: u64,
    first_range_m: f64,
    least_range_m: f64,
    least_ttc_s: Option<f64>,
    latest: TrackRecord,
}

impl Sinks {
    /// Checks what can be checked before the first frame.
    pub(super) fn check(args: &TrackArgs, source: &VideoSource) -> Result<Self> {
        let TrackArgs { json, events, ttc_limit, tracks, kitti_tracking, out, ffmpeg, encoder, .. } = args;
        let inputs = || {
            let camera = args.view.camera.calib.iter().cloned().chain(args.ego_file().map(Path::to_owned));
            source.files().iter().cloned().chain(camera).chain(args.pipeline.files())
        };
        let prints_json = json.as_deref() == Some(Path::new("-"));
        let json = json.clone().filter(|_| !prints_json);
        if let Some(json) = &json {
            outputs::check_json(json, inputs())?;
        }
        if let Some(events) = events {
            outputs::check_json(events, inputs())?;
        }
        for file in [tracks, kitti_tracking].into_iter().flatten() {
            outputs::check_file(file)?;
            let is_input = file.exists() && inputs().any(|input| identity(&input) == identity(file));
            ensure!(!is_input, "{}: an input; expected another file", file.display());
        }
        let kitti = kitti_tracking.as_ref().map(|path| {
            let (scratch, file) = Scratch::file(path).with_context(|| unwritable(path))?;
            Ok::<_, anyhow::Error>((path.clone(), scratch, file))
        });
        let pictures = out.as_ref().map(|out| {
            if let Some(format) = film::format(out).filter(|_| !out.is_dir()) {
                outputs::check_file(out)?;
                let is_input = inputs().any(|input| identity(&input) == identity(out));
                ensure!(!is_input, "{}: an input; expected another file for the film", out.display());
                return Ok(Pictures::Film(Box::new(Film::new(out, format, ffmpeg, encoder.as_deref()))));
            }
            ensure!(
                UnsupportedFormat::from_name(out).is_none(),
                "{}: no film of this kind is written; expected a folder, or one of .{}",
                out.display(),
                film::FORMATS.map(|(extension, _)| extension).join(", .")
            );
            let folders: Vec<PathBuf> =
                source.files().iter().filter_map(|file| file.parent()).map(Path::to_owned).collect();
            outputs::check_no_input(out, &folders)?;
            outputs::make_folder(out)?;
            Ok::<_, anyhow::Error>(Pictures::Folder(out.clone()))
        });
        let recordings = Recordings::begin(&args.recordings, inputs())?;
        Ok(Self {
            recordings,
            json: json.map(|json| (json, None)),
            prints_json,
            events: events.as_ref().map(|path| (path.clone(), EventFinder::new(*ttc_limit), None)),
            tracks: tracks.clone(),
            kitti: kitti.transpose()?,
            pictures: pictures.transpose()?,
            divisor: None,
            summary: BTreeMap::new(),
        })
    }

    /// Whether anything is left of the work when nobody reads what is printed.
    pub(super) fn write_files(&self) -> bool {
        self.json.is_some()
            || self.events.is_some()
            || self.tracks.is_some()
            || self.kitti.is_some()
            || self.pictures.is_some()
            || !self.recordings.is_empty()
    }

    /// Writes a frame.
    pub(super) fn add(
        &mut self,
        frame: &VideoFrame,
        followed: &TrackingResult,
        fps: Option<f64>,
        printer: &mut Printer,
    ) -> Result<()> {
        let record = &followed.record;
        let line = serde_json::to_string(record)?;
        if self.prints_json {
            printer.line(&line);
            printer.flush();
        }
        if let Some((path, file)) = &mut self.json {
            append(path, file, &(line + "\n"))?;
        }
        if let Some((path, finder, file)) = &mut self.events {
            let events = finder.update(record);
            let lines: Vec<String> = events.iter().map(serde_json::to_string).collect::<Result<_, _>>()?;
            append(path, file, &lines.into_iter().map(|line| line + "\n").collect::<String>())?;
        }
        if let Some((path, _, file)) = &mut self.kitti {
            file.write_all(kitti_rows(record, &followed.detections()).as_bytes()).with_context(|| unwritable(path))?;
        }
        for track in &record.tracks {
            Summary::add(&mut self.summary, record, track);
        }
        if !self.recordings.is_empty() {
            let found = found(followed);
            // Recordings tell of a pinhole.
            let image = followed.view.straightened(&frame.image)?;
            let camera = followed.view.camera();
            let recorded = RecordedFrame { time_s: record.time_s, image: &image, camera, found: &found };
            self.recordings.add(&recorded)?;
        }
        if self.pictures.is_some() && self.divisor.is_none() {
            let divisor = *self.divisor.insert(picture_divisor([frame.image.width(), frame.image.height()]));
            if divisor > 1 {
                printer.note(&format!("large frames, drawn at 1/{divisor} of their size"));
            }
        }
        match &mut self.pictures {
            Some(Pictures::Folder(folder)) => {
                let picture = drawn(frame, followed);
                let target = folder.join(format!("{:06}.png", record.frame));
                write_atomically(&target, |out| {
                    picture.write_with_encoder(PngEncoder::new(out)).map_err(io::Error::other)
                })?;
            }
            Some(Pictures::Film(film)) => film.add(record.time_s, &drawn(frame, followed), fps)?,
            None => {}
        }
        Ok(())
    }

    /// Writes what comes at the end, and returns how many tracks there were.
    pub(super) fn finish(self, printer: &mut Printer) -> Result<usize> {
        let Self { prints_json, tracks, kitti, pictures, recordings, summary, .. } = self;
        recordings.finish()?;
        if !prints_json {
            print_table(&summary, printer);
        }
        if let Some(path) = tracks {
            table::write(&path, &columns(&summary))?;
        }
        if let Some((path, scratch, file)) = kitti {
            drop(file);
            scratch.persist().with_context(|| unwritable(&path))?;
        }
        if let Some(Pictures::Film(film)) = pictures {
            film.finish()?;
        }
        Ok(summary.len())
    }
}

impl Summary {
    fn add(all: &mut BTreeMap<u64, Self>, record: &FrameRecord, track: &TrackRecord) {
        let now = (record.frame, record.time_s);
        let range_m = track.range_m;
        let summary = all.entry(track.id).or_insert_with(|| Self {
            class: track.class.clone(),
            first: now,
            last: now,
            seen: 0,
            coasting: 0,
            first_range_m: range_m,
            least_range_m: range_m,
            least_ttc_s: None,
            latest: track.clone(),
        });
        if track.coasting {
            summary.coasting += 1;
            return;
        }
        summary.seen += 1;
        summary.last = now;
        summary.class.clone_from(&track.class);
        summary.least_range_m = summary.least_range_m.min(range_m);
        let least = [summary.least_ttc_s, track.ttc_s].into_iter().flatten().reduce(f64::min);
        summary.least_ttc_s = least;
        summary.latest = track.clone();
    }
}

fn unwritable(path: &Path) -> String {
    format!("{}: cannot be written", path.display())
}

/// Adds whole lines, in one write so that a reader sees no part of one, to a file that is made by the first.
fn append(path: &Path, file: &mut Option<File>, lines: &str) -> Result<()> {
    let file = match file {
        Some(file) => file,
        None => file.insert(File::create(path).with_context(|| unwritable(path))?),
    };
    file.write_all(lines.as_bytes()).with_context(|| unwritable(path))
}

/// The table of tracks.
fn columns(summary: &BTreeMap<u64, Summary>) -> Table {
    let integers = |of: &dyn Fn(&u64, &Summary) -> u64| {
        Column::Integers(summary.iter().map(|(id, one)| of(id, one) as i64).collect())
    };
    let numbers = |of: &dyn Fn(&Summary) -> Option<f64>| Column::Numbers(summary.values().map(of).collect());
    vec![
        ("id", integers(&|id, _| *id)),
        ("class", Column::Words(summary.values().map(|one| one.class.clone()).collect())),
        ("first_frame", integers(&|_, one| one.first.0)),
        ("last_frame", integers(&|_, one| one.last.0)),
        ("first_s", numbers(&|one| Some(one.first.1))),
        ("last_s", numbers(&|one| Some(one.last.1))),
        ("frames_seen", integers(&|_, one| one.seen)),
        ("frames_coasting", integers(&|_, one| one.coasting)),
        ("height_m", numbers(&|one| Some(one.latest.dimensions_hwl[0]))),
        ("width_m", numbers(&|one| Some(one.latest.dimensions_hwl[1]))),
        ("length_m", numbers(&|one| Some(one.latest.dimensions_hwl[2]))),
        ("first_range_m", numbers(&|one| Some(one.first_range_m))),
        ("last_range_m", numbers(&|one| Some(one.latest.range_m))),
        ("last_range_sigma_m", numbers(&|one| Some(one.latest.range_sigma_m))),
        ("least_range_m", numbers(&|one| Some(one.least_range_m))),
        ("last_closing_mps", numbers(&|one| one.latest.closing_mps)),
        ("last_closing_sigma_mps", numbers(&|one| one.latest.closing_sigma_mps)),
        ("least_ttc_s", numbers(&|one| one.least_ttc_s)),
        ("last_speed_mps", numbers(&|one| one.latest.speed_mps.flatten())),
        ("last_speed_sigma_mps", numbers(&|one| one.latest.speed_sigma_mps.flatten())),
    ]
}

/// The table for people: one row a track.
fn print_table(summary: &BTreeMap<u64, Summary>, printer: &mut Printer) {
    let row = |cells: [&str; 8]| {
        let [id, class, from, to, frames, distance, closing, ttc] = cells;
        let row =
            format!("{id:>5}  {class:10}  {from:>8}  {to:>8}  {frames:>6}  {distance:>13}  {closing:>15}  {ttc:>9}");
        row.trim_end().to_owned()
    };
    let heading = ["id", "class", "from", "to", "frames", "last distance", "closing", "least ttc"];
    printer.heading(&row(heading));
    for (id, one) in summary {
        let latest = &one.latest;
        let closing = latest.closing_mps.zip(latest.closing_sigma_mps);
        printer.line(&row([
            &id.to_string(),
            &one.class,
            &format!("{:.2} s", one.first.1),
            &format!("{:.2} s", one.last.1),
            &one.seen.to_string(),
            &format!("{:.1} ±{:.1} m", latest.range_m, latest.range_sigma_m),
            &closing.map_or_else(String::new, |(mps, sigma)| format!("{mps:.1} ±{sigma:.1} m/s")),
            &one.least_ttc_s.map_or_else(String::new, |ttc| format!("{ttc:.1} s")),
        ]));
    }
}

/// Rows of the tracking benchmark: frame and identity, then a result's 16 columns.
fn kitti_rows(record: &FrameRecord, detections: &[Detection]) -> String {
    let without_sigma: Vec<Detection> =
        detections.iter().map(|detection| Detection { range_sigma_m: None, ..detection.clone() }).collect();
    let rows = text_from_results(&without_sigma);
    let mut text = String::new();
    for (row, track) in rows.lines().zip(&record.tracks) {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{} {} {row}", record.frame, track.id);
    }
    text
}

/// The tracks as recordings have them.
fn found(followed: &TrackingResult) -> Vec<RecordedObject> {
    let found = |(track, detection): (&TrackRecord, Detection)| RecordedObject {
        id: track.id.to_string(),
        detection,
        label: track_words(track),
    };
    followed.record.tracks.iter().zip(followed.detections()).map(found).collect()
}

/// The frame with its tracks.
fn drawn(frame: &VideoFrame, followed: &TrackingResult) -> RgbImage {
    let view = &followed.view;
    draw_tracks(&frame.image, view.camera(), view.lens(), &followed.detections(), &followed.record.tracks)
}

//! Rendered sequences in the layout of KITTI's tracking benchmark.

use std::f64::consts::{FRAC_PI_2, PI};
use std::fmt::Write as _;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use farsight::video::EgoFile;
use farsight_core::Label;
use farsight_data::kitti::{Calibration, image_size, text_from_labels};
use farsight_eval::tracks::{GroundTruthFrame, GroundTruthTrack, read_sequence};
use farsight_files::{write_atomically, write_quickly};
use farsight_synth::{EgoTruth, MAX_IMAGE_PX, SceneConfig, Sequence, SequenceFrame, SequenceLayout, SequenceStream};
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use serde_json::{Value, json};

use super::{PLAN_FILE, SynthArgs, check_plan, encode, label_ids};
use crate::printer::{Printer, counted, progress_bar};

/// Frames of a sequence, and frames a second, where nothing is said.
const DEFAULT_FRAMES: usize = 60;
const DEFAULT_FPS: f64 = 10.0;

/// Folders of the layout; the last of them is written last.
const FOLDERS: [&str; 5] = ["image_02", "label_02", "calib", "velocity_02", "oxts"];

/// Where the first frame is, degrees north and east.
const ORIGIN_DEG: [f64; 2] = [49.0, 8.4];

/// The earth's radius that KITTI's development kit uses, metres.
const EARTH_M: f64 = 6_378_137.0;

/// Where the sequences come from.
enum Source {
    /// Random traffic.
    Stream { stream: SequenceStream, count: usize },
    /// Label files of others, with the names of the sequences.
    Layout { stream: SequenceStream, layout: Layout, names: Vec<String> },
}

/// The folders of label files.
struct Layout {
    labels: PathBuf,
    calibrations: PathBuf,
    oxts: Option<PathBuf>,
    /// Longer ones are cut.
    max_frames: Option<usize>,
}

impl Source {
    fn new(args: &SynthArgs, config: SceneConfig, count: usize) -> Result<Self> {
        let (seed, fps) = (args.seed, args.fps.unwrap_or(DEFAULT_FPS));
        let frames = args.frames.unwrap_or(DEFAULT_FRAMES);
        let stream = SequenceStream { config, seed, frames, fps };
        let (Some(labels), Some(calibrations)) = (&args.layout, &args.calib_dir) else {
            check_cameras(&stream.config)?;
            return Ok(Self::Stream { stream, count });
        };
        let mut names = label_ids(labels)?;
        ensure!(!names.is_empty(), "{}: no label files; expected files such as 0000.txt", labels.display());
        names.truncate(count);
        let (labels, calibrations, oxts) = (labels.clone(), calibrations.clone(), args.oxts_dir.clone());
        let layout = Layout { labels, calibrations, oxts, max_frames: args.frames };
        Ok(Self::Layout { stream, layout, names })
    }

    /// What the sequences follow from.
    fn plan(&self, args: &SynthArgs) -> Value {
        let source = match self {
            Self::Stream { stream: SequenceStream { config, frames, fps, .. }, count } => {
                json!({"scene_config": config, "sequences": count, "frames": frames, "fps": fps})
            }
            Self::Layout { stream, layout: Layout { labels, calibrations, oxts, max_frames }, names } => json!({
                "scene_config": stream.config, "layout": labels, "calib_dir": calibrations, "oxts_dir": oxts,
                "sequences": names.len(), "frames": max_frames, "fps": stream.fps,
            }),
        };
        json!({"farsight": env!("CARGO_PKG_VERSION"), "seed": args.seed, "jpeg": args.jpeg, "source": source})
    }

    fn names(&self) -> Vec<String> {
        match self {
            Self::Stream { count, .. } => (0..*count).map(|index| format!("{index:04}")).collect(),
            Self::Layout { names, .. } => names.clone(),
        }
    }

    fn sequence(&self, index: usize, name: &str) -> Result<Sequence> {
        match self {
            Self::Stream { stream, .. } => Ok(stream.sequence(index as u64)),
            Self::Layout { stream, layout, .. } => Ok(stream.twin(&layout.read(name, stream.fps)?, name)),
        }
    }
}

impl Layout {
    /// The labels, the camera and its motion of the sequence called `name`.
    fn read(&self, name: &str, fps: f64) -> Result<SequenceLayout> {
        let file = format!("{name}.txt");
        let path = self.labels.join(&file);
        let mut truth = read_sequence(&path, None)?;
        truth.truncate(self.max_frames.unwrap_or(truth.len()));
        ensure!(!truth.is_empty(), "{}: no labels; expected rows of KITTI's tracking benchmark", path.display());
        let frame = |frame: &GroundTruthFrame| -> Result<Vec<(u32, Label)>> {
            let label = |track: &GroundTruthTrack| {
                let id =
                    u32::try_from(track.id).with_context(|| format!("{}: identity {}", path.display(), track.id))?;
                Ok((id, track.label.clone()))
            };
            frame.tracks.iter().map(label).collect()
        };
        let frames: Vec<_> = truth.iter().map(frame).collect::<Result<_>>()?;
        let calibration = self.calibrations.join(&file);
        let camera = Calibration::read(&calibration)?.camera();
        let image_size @ [width, height] = image_size(&camera);
        ensure!(
            width.saturating_mul(height) <= MAX_IMAGE_PX,
            "{}: the camera of an image of {width} x {height} pixels; expected at most {MAX_IMAGE_PX} in all",
            calibration.display()
        );
        let motion = self.oxts.as_ref().map_or_else(
            || Ok(Vec::new()),
            |folder| {
                let path = folder.join(&file);
                let ego = EgoFile::read(&path)?;
                let motion = |frame: usize| {
                    let motion = ego.motion(frame as u64, frame as f64 / fps);
                    let motion = motion.with_context(|| format!("{}: nothing of frame {frame}", path.display()))?;
                    Ok([motion.speed_mps, motion.yaw_rate])
                };
                (0..frames.len()).map(motion).collect::<Result<Vec<_>>>()
            },
        )?;
        Ok(SequenceLayout { frames, motion, fps, camera, image_size })
    }
}

fn check_cameras(config: &SceneConfig) -> Result<()> {
    for camera in &config.cameras {
        ensure!(
            camera.heading_deg.iter().all(|heading| heading.abs() < 1e-9) && camera.height_m[1] <= MAX_HEIGHT_M,
            "a camera with heading_deg {:?} and height_m {:?}; sequences are seen from vehicles, expected a heading of 0 \
             and at most {MAX_HEIGHT_M} m",
            camera.heading_deg,
            camera.height_m
        );
    }
    Ok(())
}

/// Renders `count` sequences into the folder of `args`.
pub(super) fn run(args: &SynthArgs, config: SceneConfig, count: usize, printer: &mut Printer) -> Result<()> {
    let source = Source::new(args, config, count)?;
    let names = source.names();
    let root = args.out.join("training");
    let plan = source.plan(args);
    let is_there = root.exists();
    if is_there && args.resume {
        check_plan(&args.out.join(PLAN_FILE), &plan)?;
    } else if is_there {
        bail!("{}: there is a data set here already; name another --out, or --resume", args.out.display());
    }
    for folder in FOLDERS {
        let folder = root.join(folder);
        fs::create_dir_all(&folder).with_context(|| format!("{}: cannot be made", folder.display()))?;
    }
    let text = serde_json::to_string_pretty(&plan)? + "\n";
    write_atomically(&args.out.join(PLAN_FILE), |file| file.write_all(text.as_bytes()))?;
    let mut frames = 0;
    for (index, name) in names.iter().enumerate() {
        let writer = Writer { root: &root, name: name.clone(), jpeg: args.jpeg };
        if is_there && writer.path("oxts", "txt").is_file() {
            printer.note(&format!("sequence {name} is there already (--resume)"));
            continue;
        }
        let sequence = source.sequence(index, name)?;
        frames += sequence.len();
        writer.sequence(&sequence)?;
    }
    let all = counted(names.len(), "rendered sequence");
    printer.status(&format!("{all}, {} rendered now, in {}", counted(frames, "frame"), args.out.display()));
    Ok(())
}

/// Vehicles carry cameras no higher than this, metres.
const MAX_HEIGHT_M: f64 = 3.4;

struct Writer<'a> {
    root: &'a Path,
    name: String,
    jpeg: Option<u8>,
}

impl Writer<'_> {
    fn path(&self, folder: &str, extension: &str) -> PathBuf {
        self.root.join(format!("{folder}/{}.{extension}", self.name))
    }

    fn sequence(&self, sequence: &Sequence) -> Result<()> {
        let bar = progress_bar(sequence.len());
        let folder = self.root.join(format!("image_02/{}", self.name));
        fs::create_dir_all(&folder).with_context(|| format!("{}: cannot be made", folder.display()))?;
        let extension = if self.jpeg.is_some() { "jpg" } else { "png" };
        let frame = |number: usize| {
            let mut frame = sequence.frame(number);
            let path = folder.join(format!("{number:06}.{extension}"));
            write_quickly(&path, |file| encode(self.jpeg, &frame.image, file).map_err(io::Error::other))?;
            // Hours of pictures do not fit into memory.
            frame.image = farsight::RgbImage::default();
            bar.inc(1);
            Ok(frame)
        };
        let frames: Vec<SequenceFrame> = (0..sequence.len()).into_par_iter().map(frame).collect::<Result<_>>()?;
        bar.finish_and_clear();
        let (mut labels, mut velocities, mut oxts) =
            (String::new(), "frame,time_s,id,vx_mps,vy_mps,vz_mps,speed_mps\n".to_owned(), String::new());
        for (number, frame) in frames.iter().enumerate() {
            labels += &label_rows(number, frame);
            for track in &frame.tracks {
                let ([x, y, z], time_s) = (track.velocity_mps, frame.time_s);
                // Writing to a string cannot fail.
                let _ =
                    writeln!(velocities, "{number},{time_s},{},{x:.6},{y:.6},{z:.6},{:.6}", track.id, track.speed_mps);
            }
            oxts += &oxts_row(&frame.ego);
        }
        let write = |folder: &str, extension: &str, text: &str| {
            write_atomically(&self.path(folder, extension), |file| file.write_all(text.as_bytes()))
        };
        write("label_02", "txt", &labels)?;
        write("velocity_02", "csv", &velocities)?;
        if let Some(frame) = frames.first() {
            Calibration::from_camera(&frame.camera).write(&self.path("calib", "txt"))?;
        }
        Ok(write("oxts", "txt", &oxts)?)
    }
}

/// Rows of the tracking benchmark: frame and identity, then a label's columns.
fn label_rows(number: usize, frame: &SequenceFrame) -> String {
    let ids = frame.tracks.iter().map(|track| i64::from(track.id)).chain(frame.dont_care.iter().map(|_| -1));
    let labels: Vec<_> = frame.tracks.iter().map(|track| &track.label).chain(&frame.dont_care).cloned().collect();
    let rows = text_from_labels(&labels);
    let rows: Vec<String> = rows.lines().zip(ids).map(|(row, id)| format!("{number} {id} {row}\n")).collect();
    rows.concat()
}

/// The 30 fields of KITTI's oxts (KITTI raw, `dataformat.txt`).
fn oxts_row(ego: &EgoTruth) -> String {
    let EgoTruth { position_m: [east, north], yaw_rad, speed_mps, yaw_rate, acceleration_mps2, .. } = *ego;
    let [latitude, longitude] = ORIGIN_DEG;
    let scale = (latitude * PI / 180.0).cos();
    let (x, y) = (
        scale * EARTH_M * longitude * PI / 180.0 + east,
        scale * EARTH_M * ((90.0 + latitude) * PI / 360.0).tan().ln() + north,
    );
    let degrees = [360.0 / PI * (y / (scale * EARTH_M)).exp().atan() - 90.0, x * 180.0 / (PI * scale * EARTH_M)];
    // The first frame looks north; 0 is east.
    let yaw = farsight_core::wrapped_angle(yaw_rad + FRAC_PI_2);
    let (vn, ve) = (speed_mps * yaw.sin(), speed_mps * yaw.cos());
    let sideways = speed_mps * yaw_rate;
    let fields = [
        degrees[0],
        degrees[1],
        0.0,
        ego.roll_rad,
        ego.pitch_rad,
        yaw,
        vn,
        ve,
        speed_mps,
        0.0,
        0.0,
        acceleration_mps2,
        sideways,
        9.81,
        acceleration_mps2,
        sideways,
        9.81,
        0.0,
        0.0,
        yaw_rate,
        0.0,
        0.0,
        yaw_rate,
        0.01,
        0.01,
    ];
    let fields = fields.iter().map(|field| format!("{field:.12} ")).collect::<Vec<_>>().concat();
    fields + "4 10 4 4 4\n"
}

#[cfg(test)]
mod tests {
    use super::oxts_row;

    #[test]
    fn oxts_have_their_fields() {
        let config = farsight_synth::SceneConfig::default();
        let stream = farsight_synth::SequenceStream { config, seed: 1, frames: 1, fps: 10.0 };
        let frame = stream.sequence(0).frame(0);
        let row = oxts_row(&frame.ego);
        let fields: Vec<f64> = row.split_ascii_whitespace().map(|field| field.parse().unwrap()).collect();
        assert_eq!(fields.len(), 30);
        assert!((fields[8] - frame.ego.speed_mps).abs() < 1e-9 && (fields[22] - frame.ego.yaw_rate).abs() < 1e-9);
        assert!((fields[0] - 49.0).abs() < 1e-9 && (fields[1] - 8.4).abs() < 1e-9);
    }
}

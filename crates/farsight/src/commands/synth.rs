//! `farsight synth`: a data set of rendered scenes in KITTI's layout.

mod sequence;
mod world;

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fs;
use std::io::{self, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use farsight_data::Frame;
use farsight_data::annotations::FILE_FORMATS;
use farsight_data::kitti::{Calibration, image_size, read_labels, read_split, write_labels};
use farsight_files::{read_text, remove_stale_scratch, write_atomically, write_quickly};
use farsight_synth::{MAX_IMAGE_PX, RegionWeights, SceneConfig, SceneStream};
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ImageResult, RgbImage};
use indicatif::ParallelProgressIterator;
use rayon::iter::{IntoParallelRefIterator, ParallelIterator};
use serde_json::{Value, json};

use super::Outcome;
use crate::printer::{Printer, counted, progress_bar};
use crate::shard::manifest::{Join, Run};
use crate::shard::{Part, ShardArgs, check_relative};
use world::read_config;

/// Arguments of `farsight synth`.
#[derive(Debug, Args)]
pub(crate) struct SynthArgs {
    /// Folder for the data set, in KITTI's layout
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// How many scenes; with --layout, the first so many of its label files [default: 100, or all label files]
    #[arg(long, value_name = "N", value_parser = frames_from_text, allow_negative_numbers = true)]
    frames: Option<usize>,
    /// Decides about everything that is random
    #[arg(long, value_name = "S", default_value_t = 0)]
    seed: u64,
    /// Write JPEG files of this quality instead of PNG: a sixth of the size
    #[arg(long, value_name = "QUALITY", value_parser = clap::value_parser!(u8).range(1..=100))]
    jpeg: Option<u8>,
    /// What the scenes look like and which cameras see them, TOML [default: KITTI's camera in mixed traffic]; with
    /// --layout, in which part of the world, weather and severity the objects stand
    #[arg(long, alias = "world", value_name = "FILE")]
    scene_config: Option<PathBuf>,
    /// Render the objects of these label files at their own positions instead of random traffic
    #[arg(long, value_name = "LABEL_DIR", requires = "calib_dir")]
    layout: Option<PathBuf>,
    /// Only the label files of these frames, one id a line
    #[arg(long, value_name = "FILE", requires = "layout")]
    split: Option<PathBuf>,
    /// The cameras of the label files
    #[arg(long, value_name = "DIR", requires = "layout")]
    calib_dir: Option<PathBuf>,
    /// Render this many sequences with moving traffic and a moving camera, in the layout of KITTI's tracking benchmark;
    /// --frames is then the length of each [default: 60]. With --layout of label files of that benchmark, the first N
    /// of them
    #[arg(long, value_name = "N", num_args = 0..=1, default_missing_value = "1", value_parser = frames_from_text, conflicts_with = "split", allow_negative_numbers = true)]
    sequence: Option<usize>,
    /// How the camera of each of these sequences moves, oxts files called as the label files; it stands where this is
    /// not given
    #[arg(long, value_name = "DIR", requires_all = ["sequence", "layout"])]
    oxts_dir: Option<PathBuf>,
    /// Frames a second of a sequence [default: 10]
    #[arg(long, value_name = "N", requires = "sequence", value_parser = fps_from_text, allow_negative_numbers = true)]
    fps: Option<f64>,
    /// Go on with an interrupted data set: frames that are there stay; all other options must be as they were
    #[arg(long, conflicts_with = "shard")]
    resume: bool,
    #[command(flatten)]
    shard: ShardArgs,
}

impl SynthArgs {
    /// Twins of the frames that the file `split` lists, of labels and cameras in the folder `kitti`.
    pub(crate) fn twins(out: &Path, kitti: &Path, split: &Path, seed: u64) -> Self {
        let training = kitti.join("training");
        Self {
            out: out.to_owned(),
            frames: None,
            seed,
            jpeg: None,
            scene_config: None,
            layout: Some(training.join("label_2")),
            split: Some(split.to_owned()),
            calib_dir: Some(training.join("calib")),
            sequence: None,
            oxts_dir: None,
            fps: None,
            resume: true,
            shard: ShardArgs::default(),
        }
    }
}

impl SynthArgs {
    /// The same with scenes as this file says.
    pub(crate) fn with_scene_config(self, scene_config: &Path) -> Self {
        Self { scene_config: Some(scene_config.to_owned()), ..self }
    }
}

/// Frames to try things on.
const DEFAULT_FRAMES: usize = 100;

fn frames_from_text(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|frames| *frames > 0).ok_or_else(|| "expected a whole number, at least 1".to_owned())
}

fn fps_from_text(text: &str) -> Result<f64, String> {
    let fps = text.parse().ok().filter(|fps: &f64| (1.0..=120.0).contains(fps));
    fps.ok_or_else(|| "expected a number from 1 to 120".to_owned())
}

/// Runs the command.
pub(crate) fn run(args: &SynthArgs, printer: &mut Printer) -> Result<Outcome> {
    if let Some(count) = args.sequence {
        let config = args.scene_config.as_deref().map_or_else(|| Ok(SceneConfig::default()), read_config)?;
        sequence::run(args, config, count, printer)?;
        return Ok(Outcome::Done);
    }
    let source = Source::new(args)?;
    let ids = source.ids();
    if args.shard.asked().is_some() {
        return run_part(args, &source, &ids, printer);
    }
    let folder = Folder::new(&args.out, args, &source)?;
    render(&folder, &source, &ids, 0..ids.len(), printer)?;
    printer.status(&format!("{} in {}", counted(ids.len(), "rendered frame"), args.out.display()));
    Ok(Outcome::Done)
}

/// Renders the part that is asked for.
fn run_part(args: &SynthArgs, source: &Source, ids: &[String], printer: &mut Printer) -> Result<Outcome> {
    let Some(asked @ (shard, _)) = args.shard.asked() else { return Ok(Outcome::Done) };
    check_relative("--out", &args.out)?;
    let shared: Vec<PathBuf> = args.scene_config.iter().chain(&args.split).cloned().collect();
    let run = Run::new(ids, &shared, None, shard.count);
    let Some(part) = Part::begin(asked, run, ids, |item| source.files(&ids[item]))? else {
        printer.note(&format!("part {shard} is there already"));
        return Ok(Outcome::Done);
    };
    let folder = Folder::new(&part.output(&args.out)?, args, source)?;
    let block = part.block();
    render(&folder, source, ids, block.clone(), printer)?;
    part.finish(Vec::new(), |path| match path.extension().and_then(OsStr::to_str) {
        Some("txt") if path.parent().is_some_and(|folder| folder.ends_with("ImageSets")) => Join::Lines,
        Some("json") if path.ends_with(PLAN_FILE) => Join::Same,
        _ => Join::Own,
    })?;
    printer.status(&format!("part {shard}: {}", counted(block.len(), "rendered frame")));
    Ok(Outcome::Done)
}

/// Renders the frames of `block` that are not there yet, and lists those of the block.
fn render(folder: &Folder, source: &Source, ids: &[String], block: Range<usize>, printer: &mut Printer) -> Result<()> {
    let todo: Vec<(usize, &String)> =
        block.clone().map(|index| (index, &ids[index])).filter(|(_, id)| !folder.has(id)).collect();
    let ids = &ids[block.clone()];
    if todo.len() < ids.len() {
        printer.note(&format!("{} there already (--resume)", counted(ids.len() - todo.len(), "frame")));
    }
    let bar = progress_bar(todo.len());
    let failure = Mutex::new(None);
    todo.par_iter()
        .progress_with(bar.clone())
        .try_for_each(|&(index, id)| {
            let done = source.frame(index, id).and_then(|frame| folder.write(&frame));
            done.map_err(|error| {
                failure.lock().unwrap_or_else(std::sync::PoisonError::into_inner).get_or_insert(error);
            })
        })
        .ok();
    bar.finish_and_clear();
    if let Some(error) = failure.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner) {
        return Err(error);
    }
    folder.write_splits(block.zip(ids), source)
}

/// Where the frames come from.
enum Source {
    /// Random traffic.
    Stream { stream: SceneStream, frames: usize },
    /// Label files of others.
    Layout { stream: SceneStream, labels: PathBuf, calibrations: PathBuf, ids: Vec<String> },
}

impl Source {
    fn new(args: &SynthArgs) -> Result<Self> {
        let config = args.scene_config.as_deref().map_or_else(|| Ok(SceneConfig::default()), read_config)?;
        let stream = SceneStream { config, seed: args.seed };
        let (Some(labels), Some(calibrations)) = (&args.layout, &args.calib_dir) else {
            return Ok(Self::Stream { stream, frames: args.frames.unwrap_or(DEFAULT_FRAMES) });
        };
        let mut ids = args.split.as_deref().map_or_else(|| label_ids(labels), |split| Ok(read_split(split)?))?;
        ensure!(!ids.is_empty(), "{}: no label files; expected files such as 000000.txt", labels.display());
        ids.truncate(args.frames.unwrap_or(ids.len()));
        check_files([labels.as_path(), calibrations.as_path()], &ids)?;
        Ok(Self::Layout { stream, labels: labels.clone(), calibrations: calibrations.clone(), ids })
    }

    /// What the frames follow from.
    fn plan(&self, args: &SynthArgs) -> Value {
        let (program, seed, jpeg) = (env!("CARGO_PKG_VERSION"), args.seed, args.jpeg);
        let source = match self {
            Self::Stream { stream, frames } => json!({"scene_config": stream.config, "frames": frames}),
            Self::Layout { stream, labels, calibrations, ids } => {
                json!({"scene_config": stream.config, "layout": labels, "calib_dir": calibrations, "frames": ids.len()})
            }
        };
        json!({"farsight": program, "seed": seed, "jpeg": jpeg, "source": source})
    }

    /// The files that the frame `id` is made from.
    fn files(&self, id: &str) -> Vec<PathBuf> {
        match self {
            Self::Stream { .. } => Vec::new(),
            Self::Layout { labels, calibrations, .. } => {
                [labels, calibrations].map(|folder| folder.join(format!("{id}.txt"))).to_vec()
            }
        }
    }

    fn ids(&self) -> Vec<String> {
        match self {
            Self::Stream { frames, .. } => (0..*frames).map(|index| format!("{index:06}")).collect(),
            Self::Layout { ids, .. } => ids.clone(),
        }
    }

    /// The name of the split that a frame's region has; none where regions are not drawn.
    fn region_split(&self, index: usize, id: &str) -> Option<&'static str> {
        let (Self::Stream { stream, .. } | Self::Layout { stream, .. }) = self;
        let region = match self {
            Self::Stream { .. } => stream.region(index as u64),
            Self::Layout { .. } => stream.twin_region(id),
        };
        let has_regions = stream.config.regions != RegionWeights::default();
        has_regions.then(|| region.unwrap_or("kitti"))
    }

    fn frame(&self, index: usize, id: &str) -> Result<Frame> {
        match self {
            Self::Stream { stream, .. } => Ok(Frame { id: id.to_owned(), ..stream.frame(index as u64) }),
            Self::Layout { stream, labels, calibrations, .. } => twin(stream, [labels, calibrations], id),
        }
    }
}

/// The twin of the frame `id`, whose label file and calibration are in these folders.
pub(crate) fn twin(stream: &SceneStream, [labels, calibrations]: [&Path; 2], id: &str) -> Result<Frame> {
    let file = format!("{id}.txt");
    let camera = Calibration::read(&calibrations.join(&file))?.camera();
    let labels = read_labels(&labels.join(&file))?;
    let size @ [width, height] = image_size(&camera);
    ensure!(
        width.saturating_mul(height) <= MAX_IMAGE_PX,
        "{}: the camera of an image of {width} x {height} pixels; expected at most {MAX_IMAGE_PX} in all",
        calibrations.join(&file).display()
    );
    // By name, so that a frame's world does not depend on which others are rendered.
    Ok(Frame { id: id.to_owned(), ..stream.twin(&labels, &camera, size, id) })
}

/// Whether each frame has its files, before hours are spent on those that have.
fn check_files(folders: [&Path; 2], ids: &[String]) -> Result<()> {
    let files = ids.iter().flat_map(|id| folders.map(|folder| folder.join(format!("{id}.txt"))));
    let mut missing = files.filter(|file| !file.is_file());
    let Some(first) = missing.next() else { return Ok(()) };
    let count = 1 + missing.count();
    bail!("{}: no such file; {} missing in all", first.display(), counted(count, "file"))
}

/// Whether the data set at whose side the plan at `path` lies was begun as `plan` says.
fn check_plan(path: &Path, plan: &Value) -> Result<()> {
    let shown = path.display();
    let text = read_text(path).with_context(|| {
        format!("{shown}: cannot be read; only data sets with this file can be gone on with, expected another --out")
    })?;
    let then: Value = serde_json::from_str(&text).with_context(|| shown.to_string())?;
    for key in ["farsight", "seed", "jpeg", "source"] {
        let [then, now] = [&then, plan].map(|plan| plan.get(key).unwrap_or(&Value::Null));
        ensure!(
            then == now,
            "{shown}: the data set was begun with another {key}: {then}, now {now}; expected the same options, or another --out"
        );
    }
    Ok(())
}

pub(crate) fn label_ids(folder: &Path) -> Result<Vec<String>> {
    let failed = || format!("{}: cannot be listed", folder.display());
    let mut ids = Vec::new();
    for entry in fs::read_dir(folder).with_context(failed)? {
        let path = entry.with_context(failed)?.path();
        let stem =
            path.file_stem().and_then(|stem| stem.to_str()).filter(|_| path.extension().is_some_and(|e| e == "txt"));
        ids.extend(stem.map(str::to_owned));
    }
    ids.sort();
    Ok(ids)
}

/// The folders of a data set; the last one stays empty until all frames are written.
fn folders() -> impl Iterator<Item = String> {
    let annotations = FILE_FORMATS.iter().map(|format| format.name);
    let of_frames = ["image_2", "label_2", "calib"].into_iter().chain(annotations);
    of_frames.map(|name| format!("training/{name}")).chain(["ImageSets".to_owned()])
}

/// What the frames follow from, in the folder of the data set.
const PLAN_FILE: &str = "synth.json";

/// Whether there are some of the [`folders`], and no split. KITTI itself comes without `ImageSets`, so only an empty
/// one tells of an interruption.
fn is_interrupted(root: &Path) -> bool {
    let has_split = |mut files: fs::ReadDir| files.any(|file| file.is_ok_and(|file| !is_hidden(&file.file_name())));
    fs::read_dir(root.join("ImageSets")).is_ok_and(|files| !has_split(files))
}

/// Whether a name is that of a scratch file or suchlike.
fn is_hidden(name: &OsStr) -> bool {
    name.to_string_lossy().starts_with('.')
}

/// What to say of a folder that has some of the [`folders`].
fn there_already(root: &Path) -> &'static str {
    if is_interrupted(root) {
        "there is an interrupted data set here, without a split in ImageSets; --resume goes on with it, or remove it or name another --out"
    } else {
        "there is a data set here already; name another --out"
    }
}

/// Writes a picture as JPEG of this quality, or as PNG.
fn encode(jpeg: Option<u8>, image: &RgbImage, file: &mut dyn Write) -> ImageResult<()> {
    if let Some(quality) = jpeg {
        return image.write_with_encoder(JpegEncoder::new_with_quality(file, quality));
    }
    image.write_with_encoder(PngEncoder::new_with_quality(file, CompressionType::Fast, FilterType::Adaptive))
}

/// A data set being written.
struct Folder {
    root: PathBuf,
    jpeg: Option<u8>,
    /// Whether it goes on with frames that are there.
    resumes: bool,
}

impl Folder {
    fn new(root: &Path, args: &SynthArgs, source: &Source) -> Result<Self> {
        let folders: Vec<PathBuf> = folders().map(|name| root.join(name)).collect();
        let is_there = folders.iter().any(|folder| folder.exists());
        let plan = source.plan(args);
        if is_there && args.resume {
            check_plan(&root.join(PLAN_FILE), &plan)?;
        } else if is_there {
            bail!("{}: {}", root.display(), there_already(root));
        }
        let made =
            |folder: &Path| fs::create_dir_all(folder).with_context(|| format!("{}: cannot be made", folder.display()));
        made(root)?;
        // Before the folders: what they hold can be gone on with from the first frame on.
        let text = serde_json::to_string_pretty(&plan)? + "\n";
        write_atomically(&root.join(PLAN_FILE), |file| file.write_all(text.as_bytes()))?;
        for folder in folders {
            made(&folder)?;
            remove_stale_scratch(&folder).with_context(|| folder.display().to_string())?;
        }
        Ok(Self { root: root.to_owned(), jpeg: args.jpeg, resumes: is_there })
    }

    /// Whether a frame was written by an earlier run. Its calibration comes last.
    fn has(&self, id: &str) -> bool {
        self.resumes && self.root.join(format!("training/calib/{id}.txt")).is_file()
    }

    fn write(&self, frame: &Frame) -> Result<()> {
        let path =
            |folder: &str, extension: &str| self.root.join(format!("training/{folder}/{}.{extension}", frame.id));
        let extension = if self.jpeg.is_some() { "jpg" } else { "png" };
        write_quickly(&path("image_2", extension), |file| {
            encode(self.jpeg, &frame.image, file).map_err(io::Error::other)
        })?;
        write_labels(&path("label_2", "txt"), &frame.labels)?;
        for format in FILE_FORMATS {
            format.write(&self.root.join("training"), &frame.id, &frame.annotations)?;
        }
        Ok(Calibration::from_camera(&frame.camera).write(&path("calib", "txt"))?)
    }

    /// Written last: a data set without a split was interrupted. Each region has a split of its own beside that of all.
    fn write_splits<'a>(&self, frames: impl Iterator<Item = (usize, &'a String)>, source: &Source) -> Result<()> {
        let mut of_regions: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
        let mut ids = Vec::new();
        for (index, id) in frames {
            ids.push(id);
            if let Some(region) = source.region_split(index, id) {
                of_regions.entry(region).or_default().push(id);
            }
        }
        for (region, ids) in of_regions {
            self.write_split(region, &ids)?;
        }
        self.write_split("train", &ids)
    }

    fn write_split<S: AsRef<str>>(&self, name: &str, ids: &[S]) -> Result<()> {
        let text: String = ids.iter().flat_map(|id| [id.as_ref(), "\n"]).collect();
        Ok(write_atomically(&self.root.join(format!("ImageSets/{name}.txt")), |file| file.write_all(text.as_bytes()))?)
    }
}

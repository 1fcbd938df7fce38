//! `farsight synth`: a data set of rendered scenes in KITTI's layout.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use farsight_data::Frame;
use farsight_data::annotations::FILE_FORMATS;
use farsight_data::kitti::{Calibration, image_size, read_labels, read_split, write_labels};
use farsight_files::{write_atomically, write_quickly};
use farsight_synth::{SceneConfig, SceneStream, frame_from_labels};
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ImageResult, RgbImage};
use indicatif::ParallelProgressIterator;
use rayon::iter::{IndexedParallelIterator, IntoParallelRefIterator, ParallelIterator};

use super::Outcome;
use crate::printer::{Printer, counted, progress_bar};

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
    /// What the scenes look like and which cameras see them, TOML [default: KITTI's camera in mixed traffic]
    #[arg(long, alias = "world", value_name = "FILE", conflicts_with = "layout")]
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
}

/// Frames to try things on.
const DEFAULT_FRAMES: usize = 100;

fn frames_from_text(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|frames| *frames > 0).ok_or_else(|| "expected a whole number, at least 1".to_owned())
}

/// Runs the command.
pub(crate) fn run(args: &SynthArgs, printer: &mut Printer) -> Result<Outcome> {
    let source = Source::new(args)?;
    let ids = source.ids();
    let folder = Folder::new(&args.out, args.jpeg)?;
    let bar = progress_bar(ids.len());
    let failure = Mutex::new(None);
    ids.par_iter()
        .enumerate()
        .progress_with(bar.clone())
        .try_for_each(|(index, id)| {
            let done = source.frame(index, id, args.seed).and_then(|frame| folder.write(&frame));
            done.map_err(|error| {
                failure.lock().unwrap_or_else(std::sync::PoisonError::into_inner).get_or_insert(error);
            })
        })
        .ok();
    bar.finish_and_clear();
    if let Some(error) = failure.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner) {
        return Err(error);
    }
    folder.write_split(&ids)?;
    printer.status(&format!("{} in {}", counted(ids.len(), "rendered frame"), args.out.display()));
    Ok(Outcome::Done)
}

/// Where the frames come from.
enum Source {
    /// Random traffic.
    Stream { stream: SceneStream, frames: usize },
    /// Label files of others.
    Layout { labels: PathBuf, calibrations: PathBuf, ids: Vec<String> },
}

impl Source {
    fn new(args: &SynthArgs) -> Result<Self> {
        let (Some(labels), Some(calibrations)) = (&args.layout, &args.calib_dir) else {
            let config = args.scene_config.as_deref().map_or_else(|| Ok(SceneConfig::default()), read_config)?;
            let frames = args.frames.unwrap_or(DEFAULT_FRAMES);
            return Ok(Self::Stream { stream: SceneStream { config, seed: args.seed }, frames });
        };
        let mut ids = args.split.as_deref().map_or_else(|| label_ids(labels), |split| Ok(read_split(split)?))?;
        ensure!(!ids.is_empty(), "{}: no label files; expected files such as 000000.txt", labels.display());
        ids.truncate(args.frames.unwrap_or(ids.len()));
        check_files([labels.as_path(), calibrations.as_path()], &ids)?;
        Ok(Self::Layout { labels: labels.clone(), calibrations: calibrations.clone(), ids })
    }

    fn ids(&self) -> Vec<String> {
        match self {
            Self::Stream { frames, .. } => (0..*frames).map(|index| format!("{index:06}")).collect(),
            Self::Layout { ids, .. } => ids.clone(),
        }
    }

    fn frame(&self, index: usize, id: &str, seed: u64) -> Result<Frame> {
        match self {
            Self::Stream { stream, .. } => Ok(Frame { id: id.to_owned(), ..stream.frame(index as u64) }),
            Self::Layout { labels, calibrations, .. } => {
                let file = format!("{id}.txt");
                let camera = Calibration::read(&calibrations.join(&file))?.camera();
                let labels = read_labels(&labels.join(&file))?;
                // By name, so that a frame's world does not depend on which others are rendered.
                Ok(Frame { id: id.to_owned(), ..frame_from_labels(&labels, &camera, image_size(&camera), seed, id) })
            }
        }
    }
}

/// Whether each frame has its files, before hours are spent on those that have.
fn check_files(folders: [&Path; 2], ids: &[String]) -> Result<()> {
    let files = ids.iter().flat_map(|id| folders.map(|folder| folder.join(format!("{id}.txt"))));
    let mut missing = files.filter(|file| !file.is_file());
    let Some(first) = missing.next() else { return Ok(()) };
    let count = 1 + missing.count();
    bail!("{}: no such file; {} missing in all", first.display(), counted(count, "file"))
}

fn read_config(path: &Path) -> Result<SceneConfig> {
    let text = farsight_files::read_text(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    let config: SceneConfig = toml::from_str(&text).with_context(|| path.display().to_string())?;
    match config.problem() {
        Some(problem) => bail!("{}: {problem}", path.display()),
        None => Ok(config),
    }
}

fn label_ids(folder: &Path) -> Result<Vec<String>> {
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

/// What to say of a folder that has some of the [`folders`]. KITTI itself comes without `ImageSets`, so only an empty one tells of an interruption.
fn there_already(root: &Path) -> &'static str {
    let is_interrupted = fs::read_dir(root.join("ImageSets")).is_ok_and(|mut splits| splits.next().is_none());
    if is_interrupted {
        "there is an interrupted data set here, without a split in ImageSets; remove it or name another --out"
    } else {
        "there is a data set here already; name another --out"
    }
}

/// A data set being written.
struct Folder {
    root: PathBuf,
    jpeg: Option<u8>,
}

impl Folder {
    fn new(root: &Path, jpeg: Option<u8>) -> Result<Self> {
        let folders: Vec<PathBuf> = folders().map(|name| root.join(name)).collect();
        if folders.iter().any(|folder| folder.exists()) {
            bail!("{}: {}", root.display(), there_already(root));
        }
        for folder in folders {
            fs::create_dir_all(&folder).with_context(|| format!("{}: cannot be made", folder.display()))?;
        }
        Ok(Self { root: root.to_owned(), jpeg })
    }

    fn write(&self, frame: &Frame) -> Result<()> {
        let path =
            |folder: &str, extension: &str| self.root.join(format!("training/{folder}/{}.{extension}", frame.id));
        let extension = if self.jpeg.is_some() { "jpg" } else { "png" };
        write_quickly(&path("image_2", extension), |file| self.encode(&frame.image, file).map_err(io::Error::other))?;
        write_labels(&path("label_2", "txt"), &frame.labels)?;
        for format in FILE_FORMATS {
            format.write(&self.root.join("training"), &frame.id, &frame.annotations)?;
        }
        Ok(Calibration::from_camera(&frame.camera).write(&path("calib", "txt"))?)
    }

    fn encode(&self, image: &RgbImage, file: &mut dyn Write) -> ImageResult<()> {
        if let Some(quality) = self.jpeg {
            return image.write_with_encoder(JpegEncoder::new_with_quality(file, quality));
        }
        image.write_with_encoder(PngEncoder::new_with_quality(file, CompressionType::Fast, FilterType::Adaptive))
    }

    /// Written last: a data set without a split was interrupted.
    fn write_split(&self, ids: &[String]) -> Result<()> {
        let text = ids.join("\n") + "\n";
        Ok(write_atomically(&self.root.join("ImageSets/train.txt"), |file| file.write_all(text.as_bytes()))?)
    }
}

//! `farsight range`: finds vehicles and says how far away they are.

mod answers;
mod format;
mod job;
mod part;
mod picture;
#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use anyhow::{Result, bail, ensure};
use clap::{Args, ValueEnum};
use farsight::{Pipeline, RangeKind};

use super::Outcome;
use crate::camera_args::ViewArgs;
use crate::inputs;
use crate::pipeline_args::{self, PipelineArgs};
use crate::printer::Printer;
use crate::recording_file::RecordingArgs;
use crate::shard::ShardArgs;
use format::Format;
use job::Job;
use picture::PictureFormat;

/// Arguments of `farsight range`.
#[derive(Debug, Clone, Args)]
pub(crate) struct RangeArgs {
    /// Images (PNG, JPEG, WebP, BMP, TIFF, GIF, PPM), folders of images, patterns such as 'frames/*.png'
    #[arg(required = true, value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    #[command(flatten)]
    pipeline: PipelineArgs,
    /// Write a picture of each image, with the view from above, to DIR/IMAGE.png, or .jpg
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// In which format pictures are written
    #[arg(long, value_enum, default_value_t = PictureFormat::Png, requires = "out")]
    picture_format: PictureFormat,
    /// Write everything to FILE: an array with one object for each image that was done, or one line for each if FILE
    /// ends in .jsonl; "-" prints the array instead of the table
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// What to print [default: table]
    #[arg(long, value_enum)]
    format: Option<Format>,
    /// Go on with an interrupted run: images whose answers are in --json FILE, --out and --kitti, as far as these are
    /// named, are left as they are
    #[arg(long, conflicts_with_all = ["shard", "mcap", "rerun"])]
    resume: bool,
    /// Write KITTI result files to DIR/IMAGE.txt, empty where nothing is found
    #[arg(long, value_name = "DIR")]
    kitti: Option<PathBuf>,
    #[command(flatten)]
    recordings: RecordingArgs,
    /// Which distance to give
    #[arg(long, value_enum, default_value_t = RangeName::Depth)]
    range: RangeName,
    /// Leave out what has a lower score [default: 0.5, or 0.25 where scores are no probabilities]
    #[arg(long, value_name = "SCORE", value_parser = score, allow_negative_numbers = true)]
    min_score: Option<f64>,
    /// What once asked for the exit status that failed images have anyway
    #[arg(long, hide = true)]
    strict: bool,
    // Last, because their help headings would go on to what follows.
    #[command(flatten)]
    view: ViewArgs,
    #[command(flatten)]
    shard: ShardArgs,
}

impl RangeArgs {
    /// The shipped model on a folder of images in KITTI's layout: pictures into the folder `out`, everything into the
    /// file `json`.
    pub(super) fn demo(images: PathBuf, out: PathBuf, json: PathBuf) -> Self {
        Self {
            inputs: vec![images],
            pipeline: PipelineArgs::default(),
            out: Some(out),
            picture_format: PictureFormat::Png,
            json: Some(json),
            format: None,
            resume: false,
            kitti: None,
            recordings: RecordingArgs::default(),
            range: RangeName::Depth,
            min_score: None,
            strict: false,
            view: ViewArgs::default(),
            shard: ShardArgs::default(),
        }
    }
}

impl RangeArgs {
    /// What is printed.
    fn format(&self) -> Result<Format> {
        let asked = self.format.unwrap_or_default();
        if self.json.as_deref() != Some(Path::new("-")) {
            return Ok(asked);
        }
        ensure!(
            self.format.is_none_or(|asked| asked == Format::Json),
            "--json - prints an array; expected --format json beside it, or no --format"
        );
        Ok(Format::Json)
    }

    /// The file for all answers.
    fn json_file(&self) -> Option<&Path> {
        self.json.as_deref().filter(|path| *path != Path::new("-"))
    }

    /// What looks at so many images.
    fn open(&self, images: usize, printer: &mut Printer) -> Result<Pipeline> {
        let builder = self.pipeline.builder(printer)?.range(self.range.kind()).images(images);
        let builder = self.min_score.into_iter().fold(builder, farsight::PipelineBuilder::min_score);
        pipeline_args::open_and_tell(&builder, printer)
    }

    fn check_resume(&self) -> Result<()> {
        let writes_files = [self.json_file(), self.out.as_deref(), self.kitti.as_deref()].iter().any(Option::is_some);
        ensure!(
            writes_files || !self.resume,
            "--resume goes by the files of an earlier run; expected --json FILE, --out or --kitti beside it"
        );
        Ok(())
    }
}

/// [`RangeKind`] as it is written on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum RangeName {
    /// Along the optical axis, KITTI's z
    Depth,
    /// From the camera to the centre of the box
    Euclidean,
    /// From the camera to the nearest point of the box
    Nearest,
}

impl RangeName {
    fn kind(self) -> RangeKind {
        match self {
            Self::Depth => RangeKind::Depth,
            Self::Euclidean => RangeKind::Euclidean,
            Self::Nearest => RangeKind::Nearest,
        }
    }
}

fn score(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "expected a number".to_owned())?;
    if (0.0..1.0).contains(&value) { Ok(value) } else { Err("expected at least 0 and less than 1".to_owned()) }
}

/// Runs the command.
pub(crate) fn run(args: &RangeArgs, printer: &mut Printer) -> Result<Outcome> {
    args.check_resume()?;
    let found = inputs::find(&args.inputs);
    for problem in &found.problems {
        printer.error(problem);
    }
    if found.images.is_empty() {
        bail!("no image to look at");
    }
    if args.shard.asked().is_some() {
        return part::run(args, found, printer);
    }
    let job = Job::new(args, found.images, printer)?;
    let pipeline = args.open(job.image_count(), printer)?;
    let failed = found.problems.len() + job.run(&pipeline, printer)?.len();
    pipeline_args::tell_of_camera(&pipeline, printer);
    Ok(outcome(failed))
}

fn outcome(failed: usize) -> Outcome {
    if failed > 0 { Outcome::Told } else { Outcome::Done }
}

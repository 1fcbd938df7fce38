//! `farsight bench`: where the time goes, from the image file to the picture.

mod compare;
mod stream;

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, Result, ensure};
use clap::Args;
use farsight::camera_source::KITTI_HFOV_DEG;
use farsight::{Camera, EngineKind, Pipeline, PipelineBuilder, RangeKind, StageTimes, draw, read_image, shipped};
use farsight_core::statistics::{quantile, sorted};
use farsight_files::{Scratch, write_atomically};
use farsight_runtime::timing::timed;
use image::RgbImage;
use serde::Serialize;

use super::Outcome;
use crate::pipeline_args::{self, PipelineArgs};
use crate::printer::{Printer, counted};
use crate::{outputs, untrained};
use compare::Variant;
use stream::{Throughput, throughput};

pub(super) use compare::median;
pub(super) use stream::cores;

/// Runs before the clock counts: engines plan and allocate in the first ones.
pub(super) const WARM_UP: usize = 3;

/// More images at once are a mistake.
const MAX_BATCH: usize = 256;

/// Arguments of `farsight bench`.
#[derive(Debug, Args)]
#[command(after_help = "--model may also be the config of a model (.toml): its network gets random weights")]
pub(crate) struct BenchArgs {
    #[command(flatten)]
    pipeline: PipelineArgs,
    /// Image to look at [default: a scene that comes with the program, 1242x375 JPEG]
    #[arg(long, value_name = "FILE")]
    image: Option<PathBuf>,
    /// Width and height of the network's input, pixels, multiples of 32 [default: the model's]
    #[arg(long, value_name = "WxH", value_parser = super::input_size)]
    input: Option<[usize; 2]>,
    /// Images that the network sees together; times are of the batch
    #[arg(long, value_name = "N", default_value_t = 1)]
    batch: usize,
    /// Compute the regression head everywhere instead of at the peaks, to see what that saves
    #[arg(long)]
    dense_head: bool,
    /// How often each stage is timed, one image after the other
    #[arg(long, value_name = "N", default_value_t = 20)]
    runs: usize,
    /// Images of the stream, neighbouring ones side by side as in a folder, whose throughput is told; 0 is none
    #[arg(long, value_name = "N", default_value_t = 12)]
    images: usize,
    /// Compare these in turns and print a table: ENGINE[:PRECISION[:EFFORT]], several separated by commas, such as
    /// rten,openvino:int8,openvino:int8:fast
    #[arg(long, value_name = "VARIANTS", value_delimiter = ',')]
    compare: Vec<Variant>,
    /// Write the figures as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// With --compare: write the table as JSON, for documents to quote (`farsight measure --docs`)
    #[arg(long, value_name = "FILE", requires = "compare")]
    table: Option<PathBuf>,
}

/// All figures.
#[derive(Debug, Serialize)]
struct Figures {
    engine: String,
    model: String,
    image: [usize; 2],
    input: [usize; 2],
    /// Of the network, as asked for; none is the engine's own choice.
    threads: Option<usize>,
    batch: usize,
    runs: usize,
    /// From the image files of the batch to the detections, milliseconds.
    total: Spread,
    stages: Vec<(&'static str, Spread)>,
    /// Objects that were found in the image.
    objects: usize,
    /// None where no stream was asked for, or the times are of a batch.
    throughput: Option<Throughput>,
    /// The most memory that the process ever held, megabytes, where the system tells.
    peak_memory_mb: Option<f64>,
}

/// Median and quartiles, milliseconds.
#[derive(Debug, Clone, Copy, Serialize)]
struct Spread {
    median_ms: f64,
    quartiles_ms: [f64; 2],
}

/// One pass over a batch.
pub(super) struct Pass {
    pub(super) times: StageTimes,
    draw: Duration,
    pub(super) objects: usize,
}

/// Runs the command.
pub(crate) fn run(args: &BenchArgs, printer: &mut Printer) -> Result<Outcome> {
    ensure!(args.runs > 0, "--runs is 0; expected at least one");
    ensure!((1..=MAX_BATCH).contains(&args.batch), "--batch is {}; expected 1 to {MAX_BATCH}", args.batch);
    for json in args.json.iter().chain(&args.table) {
        outputs::check_json(json, args.image.clone().into_iter().chain(args.pipeline.files()))?;
    }
    let folder = Scratch::temporary_folder().context("no folder for the scene")?;
    let image = match &args.image {
        Some(image) => image.clone(),
        None => shipped::write_scenes(folder.path())?.join("000000.jpg"),
    };
    if !args.compare.is_empty() {
        ensure!(args.images > 0, "--images is 0; expected at least one with --compare");
        compare::run(args, &image, printer)?;
        return Ok(Outcome::Done);
    }
    let builder = builder(args, printer)?;
    let pipeline = pipeline_args::open_and_tell(&builder, printer)?;
    for _ in 0..WARM_UP {
        pass(&image, args.batch, &pipeline)?;
    }
    let passes = (0..args.runs).map(|_| pass(&image, args.batch, &pipeline)).collect::<Result<Vec<Pass>>>()?;
    let mut figures = figures(args, &image, &pipeline, &passes)?;
    if args.images > 0 && args.batch == 1 {
        let pipeline = pipeline_args::open(&builder.images(args.images))?;
        throughput(&image, WARM_UP * pipeline.side_by_side(), &pipeline)?;
        figures.throughput = Some(throughput(&image, args.images, &pipeline)?);
        figures.peak_memory_mb = peak_memory_mb();
    }
    print(&figures, printer);
    if let Some(path) = &args.json {
        let text = serde_json::to_string_pretty(&figures)? + "\n";
        write_atomically(path, |file| file.write_all(text.as_bytes()))?;
    }
    Ok(Outcome::Done)
}

/// The pipeline to time: its model may be a config, whose network gets random weights.
fn builder(args: &BenchArgs, printer: &mut Printer) -> Result<PipelineBuilder> {
    let config = args.pipeline.model.as_deref().filter(|path| untrained::is_config(path));
    let engine = args.pipeline.engine.engine.kind();
    ensure!(
        engine != EngineKind::Libtorch || (config.is_none() && args.input.is_none()),
        "the engine libtorch is timed with a model and its own input only"
    );
    let mut builder = args.pipeline.builder(printer)?.dense_head(args.dense_head).images(1);
    if let Some(path) = config {
        builder = builder.model(untrained::network(path, engine.target())?);
    }
    Ok(args.input.into_iter().fold(builder, PipelineBuilder::input_size))
}

/// Reads the image `batch` times and looks at them together.
pub(super) fn pass(path: &Path, batch: usize, pipeline: &Pipeline) -> Result<Pass> {
    let (images, load) = timed(|| (0..batch).map(|_| read_image(path)).collect::<Result<Vec<_>, _>>());
    let images = images?;
    let camera = camera(images[0].width() as usize, images[0].height() as usize)?;
    let views: Vec<(&RgbImage, &Camera)> = images.iter().map(|image| (image, &camera)).collect();
    let (answers, times) = pipeline.detect_batch(&views)?;
    let ((), draw) = timed(|| {
        for (image, objects) in images.iter().zip(&answers) {
            draw(image, &camera, objects, RangeKind::Depth);
        }
    });
    let objects = answers.iter().map(Vec::len).max().unwrap_or(0);
    Ok(Pass { times: StageTimes { load, ..times }, draw, objects })
}

/// KITTI's field of view: the answers do not matter here, and the time does not depend on it.
fn camera(width: usize, height: usize) -> Result<Camera> {
    Ok(Camera::from_hfov(KITTI_HFOV_DEG, width, height)?)
}

fn figures(args: &BenchArgs, path: &std::path::Path, pipeline: &Pipeline, passes: &[Pass]) -> Result<Figures> {
    let (width, height) = image::image_dimensions(path).with_context(|| path.display().to_string())?;
    let image = [width as usize, height as usize];
    let stage = |time: fn(&Pass) -> Duration| Spread::of(passes.iter().map(time));
    Ok(Figures {
        engine: pipeline.engine().to_owned(),
        model: pipeline.info().name.clone(),
        image,
        input: pipeline.input_size(image, &camera(image[0], image[1])?),
        threads: args.pipeline.engine.options()?.usable_threads(),
        batch: args.batch,
        runs: passes.len(),
        total: stage(|pass| pass.times.total()),
        stages: vec![
            ("load", stage(|pass| pass.times.load)),
            ("warp", stage(|pass| pass.times.warp)),
            ("network", stage(|pass| pass.times.network)),
            ("decode", stage(|pass| pass.times.decode)),
            ("refine", stage(|pass| pass.times.refine)),
            ("draw", stage(|pass| pass.draw)),
        ],
        objects: passes.iter().map(|pass| pass.objects).max().unwrap_or(0),
        throughput: None,
        peak_memory_mb: peak_memory_mb(),
    })
}

fn print(figures: &Figures, printer: &mut Printer) {
    let Figures { engine, model, image: [width, height], input: [input_width, input_height], batch, runs, .. } =
        figures;
    printer.heading(&format!(
        "{model} on {engine}: image {width}x{height}, input {input_width}x{input_height}, batch {batch}, {}, milliseconds",
        counted(*runs, "run")
    ));
    let row = |name: &str, spread: &Spread| {
        let [low, high] = spread.quartiles_ms;
        format!("{name:<24}{:>9.2}   quartiles {low:.2} to {high:.2}", spread.median_ms)
    };
    for (name, spread) in &figures.stages {
        printer.line(&row(name, spread));
    }
    printer.line(&row("file to detections", &figures.total));
    let rate = *batch as f64 * 1e3 / figures.total.median_ms;
    printer.line(&format!("{:<24}{rate:>9.1}", "images a second"));
    printer.line(&format!("{:<24}{:>9}", "objects found", figures.objects));
    if figures.objects == 0 {
        printer.note(
            "nothing was found, as by a model with random weights or one that was pruned and not trained on: decoding, refining and drawing take longer where something is",
        );
    }
    if let Some(Throughput { images, side_by_side, images_per_s, cores_used, cpu_ms }) = figures.throughput {
        let name = format!("a stream, {side_by_side} at once");
        printer.line(&format!("{name:<24}{images_per_s:>9.1}   images a second, {}", counted(images, "image")));
        if let Some((used, cpu_ms)) = cores_used.zip(cpu_ms) {
            let of = cores();
            printer.line(&format!(
                "{:<24}{used:>9.2}   of {of}; {cpu_ms:.1} ms of processor time an image",
                "cores at work"
            ));
        }
    }
    if let Some(megabytes) = figures.peak_memory_mb {
        printer.line(&format!("{:<24}{megabytes:>9.0} MB", "most memory held"));
    }
}

impl Spread {
    fn of(times: impl Iterator<Item = Duration>) -> Self {
        let times = sorted(times.map(|time| time.as_secs_f64() * 1e3));
        let at = |share: f64| quantile(&times, share);
        Self { median_ms: at(0.5), quartiles_ms: [at(0.25), at(0.75)] }
    }
}

/// Linux tells it in `/proc/self/status`, in kilobytes.
fn peak_memory_mb() -> Option<f64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kilobytes: f64 = line.trim().trim_end_matches("kB").trim().parse().ok()?;
    Some(kilobytes / 1024.0)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::Spread;

    #[test]
    fn spread_of_a_few_times() {
        let spread = Spread::of([5, 1, 3, 2, 4].into_iter().map(Duration::from_millis));
        assert!((spread.median_ms - 3.0).abs() < 1e-9);
        assert!((spread.quartiles_ms[0] - 2.0).abs() < 1e-9 && (spread.quartiles_ms[1] - 4.0).abs() < 1e-9);
        let even = Spread::of([1, 2].into_iter().map(Duration::from_millis));
        assert!((even.median_ms - 1.5).abs() < 1e-9);
    }
}

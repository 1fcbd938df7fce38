//! `farsight export --int8`: the network in 8 bits as far as that does no harm, and what it does to distances.

mod metres;
mod sweep;

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use clap::{Args, ValueEnum};
use farsight::camera_source::{CameraSource, KITTI_HFOV_DEG};
use farsight_core::Camera;
use farsight_data::{Exif, read_image};
use farsight_files::write_atomically;
use farsight_graph::quantize::{Observer, WeightRange, layers};
use farsight_graph::transform::Network;
use farsight_methods::InputSpec;
use farsight_methods::smoke::SmokeModel;
use farsight_methods::smoke::sensitivity::{Answers, Reference, Sensitivity};
use farsight_methods::smoke::{DetectorFile, LOGITS};
use farsight_onnx::{Facts, Target, key};
use farsight_runtime::{Calibration, TensorView};
use serde_json::{Value, json};

use super::{ExportArgs, facts};
use crate::commands::Outcome;
use crate::inputs;
use crate::pipeline_args::EngineArgs;
use crate::printer::{Printer, progress_bar};
use metres::Metres;
use sweep::{Sweep, Trial};

/// So many images, spread over the folder, are used to find out which layers do harm.
const SWEEP_IMAGES: usize = 8;

/// With a larger mean change of distances (a share) or of scores than this a file is refused: it would be another
/// model.
const HOPELESS: f64 = 0.1;

/// Arguments of `farsight export --int8`.
#[derive(Debug, Args)]
#[command(next_help_heading = "8 bits")]
pub(super) struct Int8Args {
    /// Quantise: convolutions compute in 8 bits (ONNX Runtime and OpenVINO are several times faster); with --half only
    /// measure the ranges, of any model of ours, and write them into its file, for --precision int8
    #[arg(long, requires = "calibration")]
    pub(super) int8: bool,
    /// Folder of images like those that the model will see; some hundred are plenty
    #[arg(long, value_name = "DIR", requires = "int8")]
    pub(super) calibration: Option<PathBuf>,
    /// How the ranges of the maps are chosen from what the images show
    #[arg(long, value_enum, default_value_t = ObserverName::Mse, requires = "int8")]
    observer: ObserverName,
    /// The share of values inside the range, for --observer percentile
    #[arg(long, value_name = "PERCENT", default_value_t = 99.99, value_parser = percent, requires = "int8")]
    percentile: f64,
    /// How many layers stay in float, those that do the most harm [default: as few as keep the answers within 1%]
    #[arg(long, value_name = "N", requires = "int8")]
    float_layers: Option<usize>,
    /// Weights from -63 to 63 instead of -127 to 127, for CPUs whose sums of bytes are cut off at 16 bits (x86 without
    /// VNNI; `farsight doctor` tells); --precision int8 chooses by itself
    #[arg(long, requires = "int8")]
    reduce_range: bool,
    /// Labelled data in KITTI's layout to compare distances and AP on, before and after
    #[arg(long, value_name = "DIR", requires = "int8")]
    data: Option<PathBuf>,
    /// Frames of the data, one id a line [default: all that have an image]
    #[arg(long, value_name = "FILE", requires = "data")]
    split: Option<PathBuf>,
    #[command(flatten)]
    pub(super) engine: EngineArgs,
}

/// See [`Observer`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ObserverName {
    /// From the smallest to the largest value
    Minmax,
    /// Without the rarest values
    Percentile,
    /// With the least mean square error
    Mse,
}

fn percent(text: &str) -> Result<f64, String> {
    let value = text.parse().ok().filter(|value| (50.0..=100.0).contains(value));
    value.ok_or_else(|| "expected a number from 50 to 100".to_owned())
}

impl Int8Args {
    /// How ranges are chosen.
    pub(super) fn observer(&self) -> Observer {
        match self.observer {
            ObserverName::Minmax => Observer::MinMax,
            ObserverName::Percentile => Observer::Percentile(self.percentile),
            ObserverName::Mse => Observer::MeanSquare,
        }
    }

    pub(super) fn observer_name(&self) -> String {
        match self.observer() {
            Observer::MinMax => "minmax".to_owned(),
            Observer::Percentile(percent) => format!("percentile {percent}"),
            Observer::MeanSquare => "mse".to_owned(),
        }
    }
}

/// Runs the command.
pub(super) fn run(model: &SmokeModel, args: &ExportArgs, target: Target, printer: &mut Printer) -> Result<Outcome> {
    let images = Images::find(args, &model.config)?;
    let facts = facts(args, model, target)?;
    let network = Network::deployable(model)?;
    let (ranges, references) = calibrate(&network, &facts, &images, args)?;
    printer.status(&format!("calibrated on {} images ({})", images.paths.len(), args.int8.observer_name()));
    let sweep = Sweep {
        network: &network,
        facts: &facts,
        ranges,
        weights: if args.int8.reduce_range { WeightRange::Reduced } else { WeightRange::Full },
        references: &references,
        threads: args.int8.engine.options()?.usable_threads(),
    };
    let Trial { quantization, sensitivity } = chosen(&sweep, args.int8.float_layers, printer)?;
    let float_layers = sweep.float_layers(&quantization);
    printer.line(&format!(
        "{} convolutions in 8 bits, {} left in float{}",
        quantization.layer_count(),
        float_layers.len(),
        if float_layers.is_empty() { String::new() } else { format!(": {}", float_layers.join(", ")) }
    ));
    tell_sensitivity(&sensitivity, &args.out, printer)?;

    let mut told = json!({
        "bits": 8, "observer": args.int8.observer_name(), "images": images.paths.len(), "layers": quantization.layer_count(),
        "float_layers": float_layers, "reduce_range": args.int8.reduce_range,
        "distance_change": sensitivity.distance, "score_change": sensitivity.score,
    });
    let file = |told: &Value| {
        let mut facts = facts.clone();
        facts.set(key::QUANTIZATION, told.to_string());
        sweep.file(&quantization, &facts, target, &args.out)
    };
    let mut written = file(&told)?;
    if let Some(data) = &args.int8.data {
        let whole = DetectorFile::from_model(model, target, &args.model)?;
        let metres = Metres::measure(&whole, &written, data, args, printer)?;
        metres.lines().iter().for_each(|line| printer.line(line));
        told["evaluation"] = metres.to_json();
        written = file(&told)?;
    }
    let bytes = written.onnx.sealed();
    write_atomically(&args.out, |out| out.write_all(&bytes))?;
    printer.line(&format!("{}: {:.1} MB, {}", args.out.display(), bytes.len() as f64 / 1e6, target.name()));
    Ok(Outcome::Done)
}

/// Which layers compute in 8 bits: all but so many, or but as few as the answers ask for.
fn chosen(sweep: &Sweep<'_>, float_layers: Option<usize>, printer: &mut Printer) -> Result<Trial> {
    if float_layers == Some(0) {
        return sweep.everything();
    }
    let harm = sweep.harm_of_layers()?;
    harm.table().iter().for_each(|line| printer.line(line));
    sweep.chosen(&harm, float_layers)
}

/// Says how far the answers are from those in float; an error when they have nothing to do with them.
fn tell_sensitivity(sensitivity: &Sensitivity, out: &Path, printer: &mut Printer) -> Result<()> {
    let Sensitivity { distance, score, peaks } = sensitivity;
    let (percent, limit) = (100.0 * distance, 100.0 * HOPELESS);
    printer.line(&format!("distances change by {percent:.2}% and scores by {score:.4} on average, at {peaks} peaks"));
    // What is not a number is not below any limit.
    if !(*distance < HOPELESS && *score < HOPELESS) {
        bail!(
            "{}: not written: distances change by {percent:.1}% and scores by {score:.3}; expected less than {limit:.0}% and {HOPELESS}",
            out.display()
        );
    }
    Ok(())
}

/// The images of the calibration and their cameras.
struct Images {
    folder: PathBuf,
    paths: Vec<PathBuf>,
    cameras: Option<CameraSource>,
    spec: InputSpec,
}

impl Images {
    fn find(args: &ExportArgs, config: &farsight_methods::smoke::config::SmokeConfig) -> Result<Self> {
        let folder = args.int8.calibration.clone().context("--int8 needs --calibration DIR")?;
        let found = inputs::find(std::slice::from_ref(&folder));
        // Films beside the images are no matter here.
        if let Some(problem) = found.problems.first().filter(|_| found.images.is_empty()) {
            bail!("{problem}");
        }
        let paths = found.images;
        let cameras = CameraSource::of_layout(&paths);
        Ok(Self { folder, paths, cameras, spec: config.input_spec() })
    }

    /// Writes the network's input for an image to `input`; its size and its camera.
    fn input_into(&self, input: &mut Vec<f32>, path: &Path) -> Result<([usize; 2], Camera)> {
        let image = read_image(path)?;
        let size @ [width, height] = [image.width() as usize, image.height() as usize];
        ensure!(width > 0 && height > 0, "{}: no pixels", path.display());
        let camera = match &self.cameras {
            Some(cameras) => cameras.camera(path, size, &Exif::NONE)?,
            // Only the size of the network's input depends on it.
            None => Camera::from_hfov(KITTI_HFOV_DEG, width, height)?,
        };
        let (size, view) = self.spec.input_into(input, &image, &camera);
        Ok((size, view.input_camera))
    }

    /// Whether this image is among those that find out which layers do harm.
    fn in_sweep(&self, index: usize) -> bool {
        let count = self.paths.len();
        let wanted = SWEEP_IMAGES.min(count);
        // Evenly over the folder.
        (index * wanted) / count != ((index + 1) * wanted) / count
    }
}

/// Ranges of all maps, and what the network answers in float for the images of the sweep.
fn calibrate(
    network: &Network,
    facts: &Facts,
    images: &Images,
    args: &ExportArgs,
) -> Result<(sweep::Ranges, Vec<Reference>)> {
    let threads = args.int8.engine.options()?.usable_threads();
    let mut calibration = Calibration::new(network, &layers(&network.graph, LOGITS), &[], facts, threads)?;
    let file = DetectorFile::from_bytes(farsight_onnx::write(network, facts, Target::Portable)?, &args.model)?;
    let mut answers = Answers::new(&file, &args.model, threads)?;
    let mut references = Vec::new();
    let bar = progress_bar(images.paths.len());
    let mut input = Vec::new();
    for (index, path) in images.paths.iter().enumerate() {
        let (size, camera) = images.input_into(&mut input, path)?;
        let shape = [1, 3, size[1], size[0]];
        calibration
            .observe(TensorView { shape: &shape, values: &input })
            .with_context(|| path.display().to_string())?;
        if images.in_sweep(index) {
            references.push(answers.reference(input.clone(), size, camera)?);
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    ensure!(
        references.iter().any(|reference| reference.peak_count() > 0),
        "{}: the model finds nothing in these images; expected some with vehicles",
        images.folder.display()
    );
    Ok((calibration.ranges(args.int8.observer()), references))
}

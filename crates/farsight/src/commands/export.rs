//! `farsight export`: a model as an ONNX file, checked before it is kept.

mod camera;
mod cascade;
pub(super) mod fit;
mod int8;
mod plates;
mod ranges;
mod refiner;
mod second_stage;
mod whole;

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use clap::{Args, ValueEnum};
use farsight::detector::reference_network;
use farsight::model_file::{is_other_detector, read_own};
use farsight::{EngineKind, EngineOptions, Library};
use farsight_files::{read_text, write_atomically};
use farsight_graph::model::{Model, NetworkConfig};
use farsight_graph::transform::Network;
use farsight_methods::smoke::{DetectorFile, LOGITS, REGRESSION, SmokeModel};
use farsight_onnx::{Facts, INPUT, OnnxModel, Target, key};
use farsight_runtime::probe::{self, Difference};
use farsight_runtime::{Runner, Tensor, TensorView};

use super::Outcome;
use crate::outputs;
use crate::pipeline_args::tell_unhashed;
use crate::printer::Printer;
use int8::Int8Args;
use second_stage::SecondStageModel;

/// The largest difference of a head map that is let pass (single precision), for values up to 1.
pub(super) const TOLERANCE: f32 = 1e-4;

/// Arguments of `farsight export`.
#[derive(Debug, Args)]
pub(crate) struct ExportArgs {
    /// Model that `farsight train` or `farsight import` wrote, "farsight-w", "farsight-s" or "farsight-n" for those
    /// that come with the program; or a refiner, a plate reader or a camera estimator ("farsight-w-refiner",
    /// "farsight-s-refiner", "farsight-n-refiner", "shipped-plates", "shipped-camera"), of which --half --fit-on makes
    /// one that is fitted on labelled frames
    #[arg(long, value_name = "FILE")]
    model: PathBuf,
    /// The file to write
    #[arg(long, value_name = "FILE.onnx")]
    out: PathBuf,
    /// Write a model file of our own (.safetensors) with half-precision numbers instead: half the size, to be shipped
    #[arg(long, conflicts_with = "target")]
    half: bool,
    /// In which form deformable convolutions are written
    #[arg(long, value_enum, default_value_t = TargetName::Portable)]
    target: TargetName,
    /// Width and height of the network's input, pixels, multiples of 32: larger sees farther and takes longer
    /// [default: the model's]
    #[arg(long, value_name = "WxH", value_parser = super::input_size)]
    input: Option<[usize; 2]>,
    /// Focal lengths, pixels of the network's input, into which images of other cameras are scaled: where the model
    /// proved good [default: the model's]
    #[arg(long, value_name = "LEAST,MOST", value_parser = focal_range)]
    focal_range: Option<[f64; 2]>,
    /// Labelled frames in KITTI's layout, not those of the training, to fit the answers on: distances to be right in
    /// the median and to have error bars, scores to be probabilities (of a hundred detections with a score of 0.7
    /// seventy are right) [default: the model's]
    #[arg(long, value_name = "DIR")]
    fit_on: Option<PathBuf>,
    /// Images like those that a refiner will see: to fit below which scores a further iteration of it does not pay;
    /// nothing else of the model changes [default: the model's]
    #[arg(long, value_name = "DIR", requires = "half")]
    cascade_on: Option<PathBuf>,
    /// With --fit-on, --cascade-on or --int8 of a refiner or a plate reader: the detector that it is to follow,
    /// "farsight-w", "farsight-s", "farsight-n" or a file
    #[arg(long, value_name = "FILE", default_value = "farsight-s", requires = "half")]
    detector: PathBuf,
    /// With --fit-on of a refiner: another training of the same network, whose weights and this one's are averaged (a
    /// model soup)
    #[arg(long, value_name = "FILE", requires = "fit_on")]
    average_with: Option<PathBuf>,
    /// What the model was trained on, for the file's metadata
    #[arg(long, value_name = "TEXT")]
    training_data: Option<String>,
    /// The licence of what it was trained on
    #[arg(long, value_name = "TEXT")]
    training_data_licence: Option<String>,
    /// A JSON file of `farsight eval`, for the file's metadata
    #[arg(long, value_name = "FILE")]
    evaluation: Option<PathBuf>,
    // Last, because its help heading would go on to what follows.
    #[command(flatten)]
    int8: Int8Args,
}

/// See [`Target`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum TargetName {
    /// Sums of samples: every engine runs it
    Portable,
    /// ONNX's own operator: ONNX Runtime runs it, and faster
    Onnxruntime,
}

impl ExportArgs {
    /// Before anything is computed, and so that no file is called what it is not.
    fn check_out(&self) -> Result<()> {
        if self.half {
            outputs::check_kind(&self.out, "onnx", "a name ending in .safetensors, as --half writes a model of our own")
        } else {
            outputs::check_kind(
                &self.out,
                "safetensors",
                "a name ending in .onnx, or --half, which writes a model of our own",
            )
        }
    }

    /// The labelled frames to fit a second stage on, as `name` says; none where it becomes an ONNX file. An error when
    /// what is asked for is of detectors.
    fn second_stage_data(&self, name: &str) -> Result<Option<&Path>> {
        let path = self.model.display();
        ensure!(
            self.half == self.fit_on.is_some(),
            "{path}: {name}; expected --half and --fit-on DIR beside it, or neither for an ONNX file"
        );
        let is_resized = self.input.is_some() || self.focal_range.is_some();
        ensure!(!is_resized, "{path}: {name}; --input and --focal-range are of detectors");
        ensure!(!self.int8.int8, "{path}: {name}; --int8 is of detectors");
        ensure!(
            !self.tells_facts(),
            "{path}: {name}; --training-data, --training-data-licence and --evaluation are of detectors"
        );
        Ok(self.fit_on.as_deref())
    }

    fn tells_facts(&self) -> bool {
        self.training_data.is_some() || self.training_data_licence.is_some() || self.evaluation.is_some()
    }
}

/// Runs the command.
pub(crate) fn run(args: &ExportArgs, printer: &mut Printer) -> Result<Outcome> {
    args.check_out()?;
    tell_unhashed([args.model.clone()], printer);
    let target = match args.target {
        TargetName::Portable => Target::Portable,
        TargetName::Onnxruntime => Target::OnnxRuntime,
    };
    if args.int8.int8 && args.half {
        return ranges::run(args, printer);
    }
    if let Some(model) = SecondStageModel::read(&args.model)? {
        return model.export(args, target, printer);
    }
    ensure!(args.cascade_on.is_none(), "{}: a detector; --cascade-on is of refiners", args.model.display());
    if is_other_detector(&args.model) {
        return whole::run(args, target, printer);
    }
    let mut model = read_own(&args.model)?;
    ensure!(args.average_with.is_none(), "{}: a detector; --average-with is of refiners", args.model.display());
    if let Some(size) = args.input {
        resize_input(&mut model, size, args, printer)?;
    }
    model.config.focal_range_px = args.focal_range.or(model.config.focal_range_px);
    if let Some(data) = &args.fit_on {
        fit::fit(&mut model, &args.model, data, None, printer)?;
    }
    if args.half {
        return half(model, args, printer);
    }
    if args.int8.int8 {
        return int8::run(&model, args, target, printer);
    }
    let file = OnnxModel::from_model(&model, &facts(args, &model, target)?, target, &args.out)?;
    let input = image_probe();
    let (expected, reference) = reference(&model, &file, &input)?;
    keep(&file, &input, &expected, &reference, &args.out, printer)
}

/// The fixed input of a detector.
fn image_probe() -> Tensor {
    probe::tensor(3, probe::SIZE)
}

/// Writes `file` to `out` if it answers `input` as `expected`, which `reference` said.
fn keep(
    file: &OnnxModel,
    input: &Tensor,
    expected: &[Tensor],
    reference: &str,
    out: &Path,
    printer: &mut Printer,
) -> Result<Outcome> {
    check(file, input, expected, reference, out, printer)?;
    write_file(file, out, printer)?;
    Ok(Outcome::Done)
}

/// Refuses `file`, which is to become `out`, unless it answers `input` as `expected`, which `reference` said.
fn check(
    file: &OnnxModel,
    input: &Tensor,
    expected: &[Tensor],
    reference: &str,
    out: &Path,
    printer: &mut Printer,
) -> Result<()> {
    let differences = differences(file, input, expected, reference, out, printer)?;
    for Difference { name, largest, scale } in &differences {
        printer.line(&format!("{name:10} largest difference {largest:.1e}, values up to {scale:.1}"));
    }
    if let Some(worst) = differences.iter().find(|difference| !difference.within(TOLERANCE)) {
        bail!(
            "{}: not written: {} differs by {:.1e} in values up to {:.1}; expected at most {TOLERANCE:.0e} of that",
            out.display(),
            worst.name,
            worst.largest,
            worst.scale
        );
    }
    Ok(())
}

/// Writes `file` to `out`.
fn write_file(file: &OnnxModel, out: &Path, printer: &mut Printer) -> Result<()> {
    let bytes = file.sealed();
    write_atomically(out, |out| out.write_all(&bytes))?;
    let target = file.facts().get(key::TARGET).unwrap_or("portable");
    printer.line(&format!("{}: {:.1} MB, {target}", out.display(), bytes.len() as f64 / 1e6));
    Ok(())
}

/// A convolutional network takes an input of any size, but what it says of depth holds at one scale of the image unless
/// its depths are virtual. What was fitted at the old size is rough at the new one.
fn resize_input(model: &mut SmokeModel, size: [usize; 2], args: &ExportArgs, printer: &mut Printer) -> Result<()> {
    let [width, height] = model.config.input;
    if size == [width, height] {
        return Ok(());
    }
    if model.config.depth.focal_px.is_none() {
        bail!(
            "{}: --input: the depths of this model hold at the size it was trained at, {width}x{height}; expected a model with virtual depth (model.depth.focal_px)",
            args.model.display()
        );
    }
    if model.config.has_fitted_answers() && args.fit_on.is_none() {
        printer.warning(&format!(
            "scores and error bars were fitted at {width}x{height} and are rough at another size; --fit-on fits them again"
        ));
    }
    model.config.input = size;
    Ok(())
}

/// Two focal lengths, as in `230,560`.
fn focal_range(text: &str) -> Result<[f64; 2], String> {
    let ends = text.split_once(',').map(|(least, most)| [least.parse::<f64>(), most.parse::<f64>()]);
    match ends {
        Some([Ok(least), Ok(most)]) if least > 0.0 && most > least && most.is_finite() => Ok([least, most]),
        _ => Err("expected two focal lengths in pixels, the smaller one first: 230,560".to_owned()),
    }
}

/// Numbers of three digits move the head maps by more than an engine may, so there is no tolerance here: what counts is
/// the evaluation of the file.
fn half<C: NetworkConfig>(mut model: Model<C>, args: &ExportArgs, printer: &mut Printer) -> Result<Outcome> {
    model.weights.metadata.extend(told(args)?.into_iter().map(|(key, fact)| (key.to_owned(), fact)));
    model.write_half(&args.out)?;
    printer.line(&format!("{}: half-precision numbers", args.out.display()));
    Ok(Outcome::Done)
}

fn facts(args: &ExportArgs, model: &SmokeModel, target: Target) -> Result<Facts> {
    let mut facts = DetectorFile::facts(model, target);
    told(args)?.into_iter().for_each(|(key, fact)| facts.set(key, fact));
    Ok(facts)
}

/// What only the one who exports knows about the model.
fn told(args: &ExportArgs) -> Result<Vec<(&'static str, String)>> {
    let texts = [(key::TRAINING_DATA, &args.training_data), (key::TRAINING_DATA_LICENCE, &args.training_data_licence)];
    let mut told: Vec<_> = texts.into_iter().filter_map(|(key, text)| Some((key, text.clone()?))).collect();
    if let Some(path) = &args.evaluation {
        let text = read_text(path).with_context(|| format!("{}: cannot be read", path.display()))?;
        let figures: serde_json::Value =
            serde_json::from_str(&text).with_context(|| format!("{}: no JSON", path.display()))?;
        told.push((key::EVALUATION, figures.to_string()));
    }
    Ok(told)
}

/// How far the outputs of the file are from what is expected of `input`.
fn differences(
    file: &OnnxModel,
    input: &Tensor,
    expected: &[Tensor],
    reference: &str,
    path: &Path,
    printer: &mut Printer,
) -> Result<Vec<Difference>> {
    let mut runner = file_runner(file, path)?;
    let found = outputs_of(&mut *runner, input)?;
    let [height, width] = [input.shape[2], input.shape[3]];
    let by = runner.engine();
    printer.status(&format!("checked: the file on {by} against {reference}, {width} x {height} pixels of noise"));
    Ok(probe::differences(runner.outputs(), &found, expected))
}

fn outputs_of(runner: &mut dyn Runner, input: &Tensor) -> Result<Vec<Tensor>> {
    Ok(runner.run(&[(INPUT, TensorView { shape: &input.shape, values: &input.values })])?)
}

/// An engine that runs the file as it is.
fn file_runner(file: &OnnxModel, path: &Path) -> Result<Box<dyn Runner>> {
    let engine = if file.has_deform_conv() { EngineKind::OnnxRuntime } else { EngineKind::Rten };
    EngineOptions::from(engine)
        .start(file.clone(), path)
        .with_context(|| format!("{}: not written, because it cannot be checked", path.display()))
}

/// What the model itself answers: libtorch's answer where it is built in; else that of the network before any
/// transform, on an engine that the file itself was not run on where there is one, with deformable convolutions in the
/// other form where that can be.
fn reference(model: &SmokeModel, file: &OnnxModel, input: &Tensor) -> Result<(Vec<Tensor>, String)> {
    if let Some(mut runner) = reference_network(model)? {
        return Ok((outputs_of(&mut *runner, input)?, runner.engine().to_owned()));
    }
    let engine = reference_engine(file);
    let target = engine.target();
    let whole = Network::new(model).with_outputs(&[LOGITS, REGRESSION]);
    let source = Path::new("the untransformed network");
    let whole = OnnxModel::from_network(&whole, &DetectorFile::facts(model, target), target, source)?;
    answer(engine, whole, source, input)
}

/// An engine that the file itself was not run on, where there is one.
fn reference_engine(file: &OnnxModel) -> EngineKind {
    let library = Library::OnnxRuntime;
    let is_there = library.find(None).is_ok_and(|found| library.version(&found.path).is_ok());
    if is_there && !file.has_deform_conv() { EngineKind::OnnxRuntime } else { EngineKind::Rten }
}

/// What the untransformed network answers on `engine`, and what to call that.
fn answer(engine: EngineKind, whole: OnnxModel, source: &Path, input: &Tensor) -> Result<(Vec<Tensor>, String)> {
    let mut runner = EngineOptions::from(engine).start(whole, source)?;
    let outputs = outputs_of(&mut *runner, input)?;
    Ok((outputs, format!("the untransformed network on {}", runner.engine())))
}

//! Opening a model on an engine: the one place where commands get a network that runs.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use clap::{Args, ValueEnum};
use farsight_core::detection::DecodeOptions;
use farsight_core::road::Road;
use farsight_graph::model::{Model, NetworkConfig};
use farsight_methods::plate_reader::{PlateReader, PlateReaderModel};
use farsight_methods::refiner::{Refiner, RefinerModel};
use farsight_methods::roi::{self, RoiRunner};
use farsight_methods::smoke::{DetectorFile, REGRESSION, SmokeConfig, SmokeDetector, SmokeModel, SparseHead};
use farsight_onnx::{LocalHeadFile, OnnxModel, Target, key};
use farsight_runtime::{RtenRunner, Runner};

use crate::libraries::{Found, Library};
use crate::pipeline::Pipeline;
use crate::{model_files, shipped, untrained};

/// What runs the network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub(crate) enum EngineName {
    /// Built in, needs nothing
    #[default]
    Rten,
    /// Microsoft's library, the fastest on most CPUs; `farsight engine install onnxruntime`
    Onnxruntime,
    /// Intel's library; `farsight engine install openvino`
    Openvino,
    /// PyTorch's library; on the GPU when there is one
    Libtorch,
}

/// Which engine, and how it is to run.
#[derive(Debug, Clone, Default, PartialEq, Eq, Args)]
pub(crate) struct EngineArgs {
    /// What runs the network
    #[arg(long, value_enum, default_value_t = EngineName::Rten)]
    pub(crate) engine: EngineName,
    /// The engine's shared library, or the folder that it is in
    #[arg(long, value_name = "PATH")]
    pub(crate) engine_path: Option<PathBuf>,
    /// Threads of the network [default: one for each core]
    #[arg(long, value_name = "N", value_parser = threads)]
    pub(crate) threads: Option<usize>,
    /// In which numbers OpenVINO computes
    #[arg(long, value_enum, default_value_t = Precision::F32)]
    pub(crate) precision: Precision,
}

impl EngineArgs {
    /// Options of another engine than the one that is asked for would be ignored without a word.
    fn check(&self) -> Result<()> {
        let has_library = matches!(self.engine, EngineName::Onnxruntime | EngineName::Openvino);
        ensure!(
            has_library || self.engine_path.is_none(),
            "--engine-path is for onnxruntime and openvino; expected one of them as --engine"
        );
        ensure!(
            self.engine == EngineName::Openvino || self.precision == Precision::F32,
            "--precision is for openvino; expected --engine openvino beside it"
        );
        Ok(())
    }
}

/// What looks again at what was found.
#[derive(Debug, Clone, Default, PartialEq, Eq, Args)]
pub(crate) struct SecondLookArgs {
    /// Refiner that `farsight train` wrote, for a second look at each object, or none [default: the one that comes with the program, if the model's weights do too]
    #[arg(long, value_name = "FILE|none")]
    refiner: Option<PathBuf>,
    /// Plate reader that `farsight train` wrote, which measures cars by their number plates, or none [default: the one that comes with the program, where its refiner is used]
    #[arg(long, value_name = "FILE|none")]
    plates: Option<PathBuf>,
}

/// The word for doing without.
fn is_none(word: &Path) -> bool {
    word == Path::new("none")
}

impl SecondLookArgs {
    /// The files that are named.
    pub(crate) fn files(&self) -> impl Iterator<Item = &Path> {
        [&self.refiner, &self.plates].into_iter().filter_map(|word| word.as_deref()).filter(|word| !is_none(word))
    }

    fn names_plates(&self) -> bool {
        self.plates.as_deref().is_some_and(|word| !is_none(word))
    }

    /// The pipeline with the second stages that there are to be.
    fn beside(&self, Opened { mut pipeline, is_shipped }: Opened, args: &EngineArgs) -> Result<Pipeline> {
        if let Some(model) = second_stage(self.refiner.as_deref(), is_shipped, shipped::refiner)? {
            pipeline = pipeline.with_refiner(refiner(args, model)?);
        }
        let has_shipped_refiner = is_shipped && self.refiner.is_none();
        if let Some(model) = second_stage(self.plates.as_deref(), has_shipped_refiner, shipped::plates)? {
            pipeline = pipeline.with_plate_reader(plate_reader(args, model)?);
        }
        Ok(pipeline)
    }
}

/// The second stage that is named, or the shipped one where that is the default.
fn second_stage<C: NetworkConfig>(
    word: Option<&Path>,
    is_default: bool,
    shipped: impl FnOnce() -> Result<Model<C>>,
) -> Result<Option<Model<C>>> {
    match word {
        Some(word) if is_none(word) => Ok(None),
        Some(path) => {
            model_files::check(path, &format!("{} that `farsight train` wrote, or none", C::NAME))?;
            Ok(Some(Model::read(path)?))
        }
        None if is_default => shipped().map(Some),
        None => Ok(None),
    }
}

/// Where the camera is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Args)]
pub(crate) struct RoadArgs {
    /// Height of the camera above the road, on which all that is found is put if the model has error bars, "any" if it is not known, or "none" for each object
    /// by itself [default: any for the weights that come with the program, none for others]
    #[arg(long, value_name = "METRES|any|none", value_parser = road, allow_negative_numbers = true)]
    above_road: Option<Road>,
}

impl RoadArgs {
    fn is_asked_for(self) -> bool {
        self.above_road.is_some_and(|road| road != Road::Ignored)
    }

    /// The road to use; `is_shipped` is whether the detector is the shipped one.
    fn under(self, is_shipped: bool) -> Road {
        let usual = if is_shipped { Road::Below } else { Road::Ignored };
        self.above_road.unwrap_or(usual)
    }
}

/// Cameras are neither in the road nor on satellites.
const HEIGHTS_M: std::ops::RangeInclusive<f64> = 0.2..=50.0;

fn road(text: &str) -> Result<Road, String> {
    let height_m = || text.parse().ok().filter(|height_m| HEIGHTS_M.contains(height_m));
    let expected = || format!("expected metres, from {} to {}, any or none", HEIGHTS_M.start(), HEIGHTS_M.end());
    match text {
        "none" => Ok(Road::Ignored),
        "any" => Ok(Road::Below),
        _ => height_m().map(Road::BelowBy).ok_or_else(expected),
    }
}

/// In which numbers OpenVINO computes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub(crate) enum Precision {
    /// Single precision
    #[default]
    F32,
    /// bfloat16, where the CPU has it: faster, two to three digits
    Bf16,
}

/// More threads than any computer has cores are a mistake.
const MOST_THREADS: usize = 1024;

fn threads(text: &str) -> Result<usize, String> {
    let count = text.parse().ok().filter(|count| (1..=MOST_THREADS).contains(count));
    count.ok_or_else(|| format!("expected a number from 1 to {MOST_THREADS}"))
}

/// The model at `path`, or the shipped one, ready to look at images, with all that is to follow its first look.
pub(crate) fn open_whole(
    args: &EngineArgs,
    second_look: &SecondLookArgs,
    road: RoadArgs,
    path: Option<&Path>,
    options: DecodeOptions,
) -> Result<Pipeline> {
    let opened = open(args, path, options)?;
    let road_under_it = road.under(opened.is_shipped);
    let pipeline = second_look.beside(opened, args)?;
    for (option, is_asked_for) in [("--plates", second_look.names_plates()), ("--above-road", road.is_asked_for())] {
        ensure!(
            pipeline.has_error_bars() || !is_asked_for,
            "{}: a model without error bars, which {option} goes by; `farsight export --fit-on` fits them",
            path.unwrap_or(Path::new(shipped::NAME)).display()
        );
    }
    Ok(pipeline.with_road(road_under_it))
}

/// The refiner that comes with the program, on the engine that is asked for.
pub(crate) fn shipped_refiner(args: &EngineArgs) -> Result<Refiner> {
    refiner(args, shipped::refiner()?)
}

/// A pipeline, and what the second stages and the road go by.
struct Opened {
    pipeline: Pipeline,
    /// Whether its weights are those that come with the program, in whatever file they are: the refiner and the road are made for them.
    is_shipped: bool,
}

/// The model at `path`, or the shipped one.
fn open(args: &EngineArgs, path: Option<&Path>, options: DecodeOptions) -> Result<Opened> {
    let (detector, is_shipped) = open_detector(args, path)?;
    Ok(Opened { pipeline: Pipeline::new(Box::new(detector), options), is_shipped })
}

/// The first look of the model at `path`, or of the shipped one, and whether it has the shipped weights. Its regression head is only computed where it is
/// needed, if it is of that kind.
pub(crate) fn open_detector(args: &EngineArgs, path: Option<&Path>) -> Result<(SmokeDetector, bool)> {
    args.check()?;
    let source = path.unwrap_or(Path::new(shipped::NAME));
    if args.engine == EngineName::Libtorch {
        let model = own_model(path)?;
        let is_shipped = shipped::has_weights(&model.weights.sha256())?;
        return Ok((SmokeDetector::new(libtorch(args, &model)?, &model.config, None), is_shipped));
    }
    let file = read(args.engine, path)?;
    let is_shipped = has_shipped_weights(&file.onnx)?;
    Ok((detector_of(args, file, source)?, is_shipped))
}

/// The first look of the model that comes with the program.
pub(crate) fn open_shipped() -> Result<SmokeDetector> {
    Ok(open_detector(&EngineArgs::default(), None)?.0)
}

fn has_shipped_weights(model: &OnnxModel) -> Result<bool> {
    model.facts().get(key::WEIGHTS_SHA256).map_or(Ok(false), shipped::has_weights)
}

/// A model in memory, ready to look at images; `path` is only what errors call it.
pub(crate) fn detector_of(args: &EngineArgs, file: DetectorFile, path: &Path) -> Result<SmokeDetector> {
    args.check()?;
    detector(args, file.onnx, path, &file.config)
}

/// How a network is to be run when only the time matters.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Timing {
    /// Width and height of the input, pixels; the model's own by default.
    pub(crate) input: Option<[usize; 2]>,
    /// Whether the regression head is computed everywhere, as other programs do.
    pub(crate) dense_head: bool,
}

/// As [`open_whole`], to be timed: `path` may also be a config, whose network gets random weights.
pub(crate) fn open_to_time(
    args: &EngineArgs,
    second_look: &SecondLookArgs,
    path: Option<&Path>,
    timing: Timing,
) -> Result<Pipeline> {
    second_look.beside(first_look_to_time(args, path, timing)?, args)
}

fn first_look_to_time(args: &EngineArgs, path: Option<&Path>, timing: Timing) -> Result<Opened> {
    args.check()?;
    let is_config = path.is_some_and(untrained::is_config);
    if args.engine == EngineName::Libtorch {
        ensure!(
            !is_config && timing.input.is_none(),
            "the engine libtorch is timed with a model and its own input only"
        );
        return open(args, path, DecodeOptions::default());
    }
    let file = match path {
        Some(path) if is_config => DetectorFile::from_model(&untrained::model(path)?, target(args.engine), path)?,
        _ => read(args.engine, path)?,
    };
    let mut config = file.config;
    if let Some(size) = timing.input {
        config.input = size;
        // The camera must not change the size.
        config.focal_range_px = None;
    }
    let source = path.unwrap_or(Path::new(shipped::NAME));
    let is_shipped = has_shipped_weights(&file.onnx)?;
    let detector = if timing.dense_head {
        SmokeDetector::new(start(args, file.onnx, source)?, &config, None)
    } else {
        detector(args, file.onnx, source, &config)?
    };
    Ok(Opened { pipeline: Pipeline::new(Box::new(detector), DecodeOptions::default()), is_shipped })
}

fn detector(args: &EngineArgs, onnx: OnnxModel, source: &Path, config: &SmokeConfig) -> Result<SmokeDetector> {
    Ok(match LocalHeadFile::new(&onnx, REGRESSION, source)? {
        Some(cut) => {
            let head = SparseHead::new(&cut);
            SmokeDetector::new(start(args, cut.model, source)?, config, Some(head))
        }
        None => SmokeDetector::new(start(args, onnx, source)?, config, None),
    })
}

/// The whole network of the model at `path`, every output as it is.
pub(crate) fn open_runner(args: &EngineArgs, path: &Path) -> Result<Box<dyn Runner>> {
    args.check()?;
    match args.engine {
        EngineName::Libtorch => libtorch(args, &own_model(Some(path))?),
        engine => start(args, read(engine, Some(path))?.onnx, path),
    }
}

/// The refiner `model` on the engine that is asked for.
pub(crate) fn refiner(args: &EngineArgs, model: RefinerModel) -> Result<Refiner> {
    Ok(Refiner::new(roi_runner(args, &model)?, model.config))
}

/// The plate reader `model` on the engine that is asked for.
pub(crate) fn plate_reader(args: &EngineArgs, model: PlateReaderModel) -> Result<PlateReader> {
    Ok(PlateReader::new(roi_runner(args, &model)?, model.config))
}

/// The network of a second stage on the engine that is asked for.
pub(crate) fn roi_runner<C: NetworkConfig>(args: &EngineArgs, model: &Model<C>) -> Result<RoiRunner> {
    let runner = match args.engine {
        EngineName::Libtorch => libtorch(args, model)?,
        engine => start(args, roi::runner::onnx(model, target(engine), Path::new(C::NAME))?, Path::new(C::NAME))?,
    };
    Ok(RoiRunner::new(runner))
}

/// The model in the form that suits the engine: an ONNX file, or one of our own that becomes one in memory.
fn read(engine: EngineName, path: Option<&Path>) -> Result<DetectorFile> {
    let target = target(engine);
    let Some(path) = path else {
        return Ok(DetectorFile::from_model(&shipped::model()?, target, Path::new(shipped::NAME))?);
    };
    model_files::check_detector(path)?;
    Ok(DetectorFile::read(path, target)?)
}

/// A model file of our own, or the shipped model.
fn own_model(path: Option<&Path>) -> Result<SmokeModel> {
    let Some(path) = path else { return shipped::model() };
    model_files::check_detector(path)?;
    Ok(SmokeModel::read(path)?)
}

fn target(engine: EngineName) -> Target {
    match engine {
        EngineName::Onnxruntime => Target::OnnxRuntime,
        _ => Target::Portable,
    }
}

/// A model in memory on an engine that runs ONNX; `source` is only what errors call it.
pub(crate) fn start(args: &EngineArgs, model: OnnxModel, source: &Path) -> Result<Box<dyn Runner>> {
    ensure!(
        args.engine == EngineName::Onnxruntime || !model.has_deform_conv(),
        "{}: its deformable convolutions are in the form that only ONNX Runtime has; export it with --target portable, or say --engine onnxruntime",
        source.display()
    );
    match args.engine {
        EngineName::Rten => Ok(Box::new(RtenRunner::new(model, args.threads)?)),
        EngineName::Onnxruntime => {
            let Found { path, .. } = Library::Onnxruntime.find(args.engine_path.as_deref())?;
            onnxruntime(&path, &model, args).with_context(|| path.display().to_string())
        }
        EngineName::Openvino => {
            let Found { path, .. } = Library::Openvino.find(args.engine_path.as_deref())?;
            openvino(&path, model, args).with_context(|| path.display().to_string())
        }
        EngineName::Libtorch => bail!("libtorch runs no ONNX files"),
    }
}

#[cfg(feature = "onnxruntime")]
fn onnxruntime(library: &Path, model: &OnnxModel, args: &EngineArgs) -> Result<Box<dyn Runner>> {
    Ok(Box::new(farsight_runtime::OrtRunner::new(library, model, args.threads)?))
}

#[cfg(not(feature = "onnxruntime"))]
fn onnxruntime(_: &Path, _: &OnnxModel, _: &EngineArgs) -> Result<Box<dyn Runner>> {
    bail!("this farsight was built without the engine onnxruntime (cargo feature \"onnxruntime\")")
}

#[cfg(feature = "openvino")]
fn openvino(library: &Path, model: OnnxModel, args: &EngineArgs) -> Result<Box<dyn Runner>> {
    use farsight_runtime::{OpenvinoPrecision, OpenvinoRunner};
    let precision = match args.precision {
        Precision::F32 => OpenvinoPrecision::F32,
        Precision::Bf16 => OpenvinoPrecision::Bf16,
    };
    Ok(Box::new(OpenvinoRunner::new(library, model, args.threads, precision)?))
}

#[cfg(not(feature = "openvino"))]
fn openvino(_: &Path, _: OnnxModel, _: &EngineArgs) -> Result<Box<dyn Runner>> {
    bail!("this farsight was built without the engine openvino (cargo feature \"openvino\")")
}

/// libtorch runs our own model files, and no ONNX.
#[cfg(feature = "train")]
fn libtorch<C: NetworkConfig>(args: &EngineArgs, model: &Model<C>) -> Result<Box<dyn Runner>> {
    farsight_train::set_threads(args.threads);
    Ok(Box::new(farsight_train::runner::TorchRunner::on_any_device(model)?))
}

#[cfg(not(feature = "train"))]
fn libtorch<C: NetworkConfig>(_: &EngineArgs, _: &Model<C>) -> Result<Box<dyn Runner>> {
    bail!(
        "this farsight was built without libtorch; `cargo xtask libtorch` fetches it, `cargo xtask run range ...` builds and runs with it"
    )
}

//! The options that choose a pipeline.

use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::thread::available_parallelism;

use anyhow::{Error, Result, anyhow, bail, ensure};
use clap::{Args, ValueEnum};
use farsight::{
    Device, Effort, EngineKind, EngineOptions, Error as PipelineError, ModelSource, Pipeline, PipelineBuilder,
    Precision, Road, SeenPitches, StageSource, model_file,
};
use farsight_core::Region;

use crate::printer::{Printer, counted};

/// [`EngineKind`] as it is written on the command line.
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

/// [`Precision`] as it is written on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub(crate) enum PrecisionName {
    /// Single precision
    #[default]
    F32,
    /// bfloat16, where the CPU has it: faster, two to three digits; openvino
    Bf16,
    /// Convolutions in 8 bits: several times faster; onnxruntime and openvino
    Int8,
}

impl PrecisionName {
    fn precision(self) -> Precision {
        match self {
            Self::F32 => Precision::F32,
            Self::Bf16 => Precision::Bf16,
            Self::Int8 => Precision::Int8,
        }
    }
}

/// [`Device`] as it is written on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub(crate) enum DeviceName {
    /// The processor; with libtorch the first GPU, if there is one
    #[default]
    Cpu,
    /// An NVIDIA GPU; onnxruntime with its CUDA provider
    Cuda,
    /// An NVIDIA GPU; onnxruntime with its TensorRT provider
    Tensorrt,
    /// Intel's GPU; openvino
    Gpu,
}

impl DeviceName {
    fn device(self) -> Device {
        match self {
            Self::Cpu => Device::Cpu,
            Self::Cuda => Device::Cuda,
            Self::Tensorrt => Device::TensorRt,
            Self::Gpu => Device::Gpu,
        }
    }
}

/// [`Effort`] as it is written on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub(crate) enum EffortName {
    /// One iteration of the refiner for each object, or two; no mirror images
    Fast,
    /// Three iterations for what is promising, and a mirror image
    #[default]
    Normal,
    /// Three iterations and a mirror image, whatever the score
    Best,
}

impl EffortName {
    pub(crate) fn effort(self) -> Effort {
        match self {
            Self::Fast => Effort::Fast,
            Self::Normal => Effort::Normal,
            Self::Best => Effort::Best,
        }
    }
}

/// When images are smoothed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub(crate) enum DenoiseName {
    /// Those with much noise
    #[default]
    Auto,
    /// None
    Off,
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
    /// Threads of the network [default: one for each core, and at most that]
    #[arg(long, value_name = "N", value_parser = threads)]
    pub(crate) threads: Option<usize>,
    /// In which numbers the engine computes
    #[arg(long, value_enum, default_value_t = PrecisionName::F32)]
    pub(crate) precision: PrecisionName,
    /// What the engine computes on
    #[arg(long, value_enum, default_value_t = DeviceName::Cpu)]
    pub(crate) device: DeviceName,
}

impl EngineName {
    pub(crate) fn kind(self) -> EngineKind {
        match self {
            Self::Rten => EngineKind::Rten,
            Self::Onnxruntime => EngineKind::OnnxRuntime,
            Self::Openvino => EngineKind::OpenVino,
            Self::Libtorch => EngineKind::Libtorch,
        }
    }
}

impl EngineArgs {
    /// The options; an error where one of them would be ignored without a word.
    pub(crate) fn options(&self) -> Result<EngineOptions> {
        let kind = self.engine.kind();
        ensure!(
            kind.library().is_some() || self.engine_path.is_none(),
            "--engine-path is for onnxruntime and openvino; expected one of them as --engine"
        );
        let has_it = match self.precision {
            PrecisionName::F32 => true,
            PrecisionName::Bf16 => self.engine == EngineName::Openvino,
            PrecisionName::Int8 => kind.library().is_some(),
        };
        let [word, expected] = match self.precision {
            PrecisionName::Int8 => ["int8", "onnxruntime or openvino"],
            _ => ["bf16", "openvino"],
        };
        ensure!(has_it, "--precision {word} is for {expected}; expected --engine {expected} beside it");
        let options = EngineOptions {
            kind,
            library: self.engine_path.clone(),
            threads: self.threads,
            precision: self.precision.precision(),
            device: self.device.device(),
            side_by_side: None,
        };
        match options.check_device() {
            Err(PipelineError::Device { device, expected, .. }) => {
                bail!("--device {device} is for {expected}; expected --engine {expected} beside it")
            }
            checked => checked?,
        }
        Ok(options)
    }

    /// Says so when there are more threads than cores: they are not started.
    pub(crate) fn tell_threads(&self, printer: &mut Printer) {
        let cores = available_parallelism().map_or(usize::MAX, NonZero::get);
        if let Some(threads) = self.threads.filter(|&threads| threads > cores) {
            printer.note(&format!(
                "--threads {threads}: {cores} are started, one for each core; more make nothing faster"
            ));
        }
    }
}

/// More threads than any computer has cores are a mistake.
const MAX_THREADS: usize = 1024;

/// A number of threads.
pub(crate) fn threads(text: &str) -> Result<usize, String> {
    let count = text.parse().ok().filter(|count| (1..=MAX_THREADS).contains(count));
    count.ok_or_else(|| format!("expected a number from 1 to {MAX_THREADS}"))
}

/// The stages after the detector.
#[derive(Debug, Clone, Default, PartialEq, Eq, Args)]
pub(crate) struct SecondStageArgs {
    /// Refiner that `farsight train` wrote, to refine each object, "shipped" for the one that comes with the program,
    /// or "none" [default: shipped, if the model's weights are]
    #[arg(long, value_name = "FILE|none")]
    refiner: Option<PathBuf>,
    /// Plate reader that `farsight train` wrote, which measures cars by their number plates, "shipped" for the one that
    /// comes with the program, or "none" [default: shipped for farsight-s, none for others]
    #[arg(long, value_name = "FILE|none")]
    plates: Option<PathBuf>,
}

impl SecondStageArgs {
    /// The files that are named.
    pub(crate) fn files(&self) -> impl Iterator<Item = PathBuf> {
        [&self.refiner, &self.plates].into_iter().filter_map(|word| match stage(word.as_deref()) {
            StageSource::File(path) => Some(path),
            _ => None,
        })
    }

    /// `builder` with the second stages that there are to be.
    pub(crate) fn choose(&self, builder: PipelineBuilder) -> PipelineBuilder {
        builder.refiner(stage(self.refiner.as_deref())).plates(stage(self.plates.as_deref()))
    }
}

fn stage(word: Option<&Path>) -> StageSource {
    word.map_or(StageSource::Default, StageSource::from_word)
}

/// Where the camera is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Args)]
pub(crate) struct RoadArgs {
    /// Height of the camera above the road, on which all that is found is put if the model has error bars, "any" if it
    /// is not known, or "none" for each object by itself
    /// [default: any for the weights that come with the program, none for others]
    #[arg(long, value_name = "METRES|any|none", value_parser = road, allow_negative_numbers = true)]
    above_road: Option<Road>,
    /// How far down the camera looks, degrees (negative: up), where no calibration says it [default: by what is seen]
    #[arg(long, value_name = "DEG", value_parser = pitch, allow_negative_numbers = true)]
    pitch: Option<f64>,
    /// Part of the world that the images are from, by the sizes of its vehicles: world, europe, north-america, china,
    /// japan or india; for farsight-w
    #[arg(long, value_name = "REGION", default_value_t)]
    region: Region,
}

impl RoadArgs {
    /// What is said of the camera's height.
    pub(crate) fn above_road(&self) -> Option<Road> {
        self.above_road
    }

    /// `builder` with what is known.
    pub(crate) fn choose(&self, builder: PipelineBuilder) -> PipelineBuilder {
        let builder = self.pitch.map(f64::to_radians).into_iter().fold(builder, PipelineBuilder::pitch);
        self.above_road.into_iter().fold(builder.region(self.region), PipelineBuilder::road)
    }
}

fn pitch(text: &str) -> Result<f64, String> {
    let [least, most] = farsight::builder::PITCHES_DEG;
    let degrees = text.parse().ok().filter(|degrees| (least..=most).contains(degrees));
    degrees.ok_or_else(|| format!("expected degrees, from {least} to {most}"))
}

fn road(text: &str) -> Result<Road, String> {
    let height_m = || text.parse().ok().and_then(Road::below_by);
    let [lowest_m, highest_m] = Road::HEIGHTS_M;
    let expected = || format!("expected metres, from {lowest_m} to {highest_m}, any or none");
    match text {
        "none" => Ok(Road::Ignored),
        "any" => Ok(Road::Below),
        _ => height_m().ok_or_else(expected),
    }
}

/// What a pipeline is made of.
#[derive(Debug, Clone, Default, PartialEq, Args)]
pub(crate) struct PipelineArgs {
    /// Model that `farsight train`, `farsight import` or `farsight export` wrote, or one that comes with the program:
    /// farsight-w, which has seen photographs, farsight-s, which knows one city, or farsight-n, which is small
    /// [default: farsight-w]
    #[arg(long, value_name = "FILE")]
    pub(crate) model: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) engine: EngineArgs,
    /// What runs refiner and plate reader [default: the same engine, as it is to run]
    #[arg(long, value_name = "ENGINE", value_enum)]
    pub(crate) second_stage_engine: Option<EngineName>,
    /// In which numbers it computes [default: those of --precision, single precision on an engine of its own]
    #[arg(long, value_name = "PRECISION", value_enum)]
    pub(crate) second_stage_precision: Option<PrecisionName>,
    #[command(flatten)]
    pub(crate) second_stage: SecondStageArgs,
    /// How much is done for each object: how many iterations of the refiner, and whether for its mirror image, too
    #[arg(long, value_enum, default_value_t = EffortName::Normal)]
    pub(crate) effort: EffortName,
    #[command(flatten)]
    pub(crate) road: RoadArgs,
    /// Whether images with much noise are smoothed before the networks see them
    #[arg(long, value_enum, default_value_t = DenoiseName::Auto)]
    pub(crate) denoise: DenoiseName,
    /// Of detections that stand in the same place, overlapping by more than this as seen from above, keep the best; 1
    /// keeps all, as SMOKE does [default: 0.1]
    #[arg(long, value_name = "IOU", value_parser = overlap_from_text, allow_negative_numbers = true)]
    pub(crate) max_overlap: Option<f64>,
}

/// An intersection over union that can be reached.
pub(crate) fn overlap_from_text(text: &str) -> Result<f64, String> {
    let overlap = text.parse().ok().filter(|overlap| *overlap > 0.0 && *overlap <= 1.0);
    overlap.ok_or_else(|| "expected a number above 0 and at most 1".to_owned())
}

impl PipelineArgs {
    /// The detector.
    pub(crate) fn source(&self) -> ModelSource {
        self.model.as_ref().map_or_else(ModelSource::default, ModelSource::from_word)
    }

    /// The files that are named.
    pub(crate) fn files(&self) -> impl Iterator<Item = PathBuf> {
        self.model.clone().into_iter().chain(self.second_stage.files())
    }

    /// A builder with what is chosen.
    pub(crate) fn builder(&self, printer: &mut Printer) -> Result<PipelineBuilder> {
        self.engine.tell_threads(printer);
        tell_unhashed(self.files(), printer);
        let builder = Pipeline::builder().model(self.source()).engine_options(self.engine.options()?);
        let second_engine = self.second_stage_engine.map(EngineName::kind);
        let builder = second_engine.into_iter().fold(builder, PipelineBuilder::second_stage_engine);
        let second_precision = self.second_stage_precision.map(PrecisionName::precision);
        let builder = second_precision.into_iter().fold(builder, PipelineBuilder::second_stage_precision);
        let builder = self.second_stage.choose(builder).effort(self.effort.effort());
        let builder = self.max_overlap.into_iter().fold(builder, PipelineBuilder::max_overlap);
        Ok(self.road.choose(builder).denoise(self.denoise == DenoiseName::Auto))
    }
}

/// Says what was found out about the camera: how far down it looks, and when its height contradicts what was said.
pub(crate) fn tell_of_camera(pipeline: &Pipeline, printer: &mut Printer) {
    if let Some(SeenPitches { images, least_deg, most_deg }) = pipeline.seen_pitches() {
        let by = match [least_deg, most_deg].map(|degrees| format!("{degrees:.0}")) {
            [least, most] if least == most => least,
            [least, most] => format!("{least} to {most}"),
        };
        let images = counted(images, "image");
        printer.note(&format!("{images} taken to look down by {by} degrees, by what is seen (--pitch tells)"));
    }
    if let Some((images, doubt)) = pipeline.height_conflict() {
        printer.warning(&format!("{doubt} ({})", counted(images, "image")));
    }
}

/// Says which of the model files carry no hash: those from before files had one.
pub(crate) fn tell_unhashed(files: impl IntoIterator<Item = PathBuf>, printer: &mut Printer) {
    files.into_iter().filter_map(|file| model_file::hash_note(&file)).for_each(|note| printer.note(&note));
}

/// As [`open`], and says what is left out because the weights are not those that it is made for.
pub(crate) fn open_and_tell(builder: &PipelineBuilder, printer: &mut Printer) -> Result<Pipeline> {
    let pipeline = open(builder)?;
    if let Some(note) = pipeline.disabled_stages_note() {
        printer.note(&format!("{note} (--refiner, --plates and --above-road choose them)"));
    }
    Ok(pipeline)
}

/// Opens the pipeline; errors name the options that are to blame.
pub(crate) fn open(builder: &PipelineBuilder) -> Result<Pipeline> {
    builder.open().map_err(with_options)
}

fn with_options(error: PipelineError) -> Error {
    match error {
        PipelineError::NoErrorBars { model, stage } => {
            let option = if stage == farsight::builder::PLATE_READER { "--plates" } else { "--above-road" };
            anyhow!(PipelineError::NoErrorBars { model, stage: option })
        }
        _ => error.into(),
    }
}

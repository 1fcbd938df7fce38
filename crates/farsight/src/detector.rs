//! Opening the detector: the network that looks at whole images.

use std::path::{Path, PathBuf};

use farsight_methods::Detector;
use farsight_methods::detectors::{DetectorNetwork, Part, from_hashed_model, from_model_file, from_onnx, from_parts};
use farsight_methods::smoke::{DetectorFile, REGRESSION, SmokeDetector, SmokeModel, SparseHead};
use farsight_onnx::{LocalHeadFile, OnnxError, OnnxModel, OnnxProblem, is_safetensors, key};
use farsight_runtime::Runner;

use crate::shipped::Family;
use crate::source::ModelSource;
use crate::{EngineKind, EngineOptions, Error, Precision, libtorch, model_file, shipped};

/// How the network differs from the file when only the time matters.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Timing {
    /// Width and height of the input, pixels; the model's own by default.
    pub(crate) input: Option<[usize; 2]>,
    /// Whether the regression head is computed everywhere, as other programs do.
    pub(crate) dense_head: bool,
}

/// A detector, and which one it is.
pub(crate) struct OpenDetector {
    pub(crate) detector: Box<dyn Detector>,
    /// What errors and records call it.
    pub(crate) name: PathBuf,
    /// Hash of its weights, where the file tells it.
    pub(crate) weights_sha256: Option<String>,
}

impl OpenDetector {
    /// The family, if its weights come with the library, in whatever file they are: refiner, plate reader and road are
    /// made for them.
    pub(crate) fn family(&self) -> Option<Family> {
        self.weights_sha256.as_deref().and_then(shipped::family_of)
    }
}

/// The detector of `source` on `engine`. A head that need only be computed at the peaks is computed there.
pub(crate) fn open(source: &ModelSource, engine: &EngineOptions, timing: Timing) -> Result<OpenDetector, Error> {
    engine.check()?;
    let name = source.name().to_owned();
    let network = network(source, engine)?;
    check_precision(&network.first.onnx, engine, &name)?;
    let weights_sha256 = network.first.onnx.facts().get(key::WEIGHTS_SHA256).map(str::to_owned);
    let is_cut = engine.kind != EngineKind::Libtorch && !timing.dense_head;
    let head = if is_cut { network.local_head(&name)? } else { None };
    let runner = match &head {
        Some(cut) => engine.start(cut.model.clone(), &name)?,
        None => start(&network.first, engine, &name)?,
    };
    let later = network.later.iter().map(|part| start(part, engine, &name)).collect::<Result<_, _>>()?;
    let mut detector = network.detector(runner, later, head.as_ref(), &name)?;
    if let Some(size) = timing.input
        && !detector.set_input_size(size)
    {
        let found = "a model that gives its inputs sizes of their own";
        return Err(model_file::kind_error(&name, found, "no size for them"));
    }
    Ok(OpenDetector { detector, name, weights_sha256 })
}

/// Starts a network, or a part of one, on `engine`.
fn start(part: &Part, engine: &EngineOptions, name: &Path) -> Result<Box<dyn Runner>, Error> {
    match (engine.kind, &part.trained) {
        (EngineKind::Libtorch, Some(trained)) => engine.start_libtorch_network(trained, name),
        _ => engine.start(part.onnx.clone(), name),
    }
}

/// The detector of `source` on `engine`, without anything that follows it.
///
/// # Errors
/// When the file is no detector, or the engine fails.
pub fn open_detector(source: &ModelSource, engine: &EngineOptions) -> Result<Box<dyn Detector>, Error> {
    Ok(open(source, engine, Timing::default())?.detector)
}

/// A SMOKE detector alone, with nothing to follow its look: what fits to labelled frames go by. `source` is only what
/// errors call it.
///
/// # Errors
/// When the engine cannot run it.
pub fn smoke_detector(engine: &EngineOptions, file: DetectorFile, source: &Path) -> Result<SmokeDetector, Error> {
    let DetectorFile { onnx, config } = file;
    Ok(match LocalHeadFile::new(&onnx, REGRESSION, source)? {
        Some(cut) => {
            let head = SparseHead::new(&cut);
            SmokeDetector::new(engine.start(cut.model, source)?, &config, Some(head))
        }
        None => SmokeDetector::new(engine.start(onnx, source)?, &config, None),
    })
}

/// The whole network of the model at `path`, every output as it is; of one with samplers what is before the first.
///
/// # Errors
/// When the file is no detector, or the engine cannot run it.
pub fn open_network(engine: &EngineOptions, path: &Path) -> Result<Box<dyn Runner>, Error> {
    start(&network(&ModelSource::from_word(path), engine)?.first, engine, path)
}

/// The network of a model in memory on libtorch's CPU, the reference for exported files; none where libtorch is not
/// built in.
///
/// # Errors
/// When libtorch refuses it.
pub fn reference_network(model: &SmokeModel) -> Result<Option<Box<dyn Runner>>, Error> {
    if libtorch::IS_BUILT_IN { libtorch::start_on_cpu(model).map(Some) } else { Ok(None) }
}

/// Whether libtorch is built in.
pub fn has_libtorch() -> bool {
    libtorch::IS_BUILT_IN
}

/// An ONNX file is in 8 bits or not, whatever is asked for.
fn check_precision(onnx: &OnnxModel, engine: &EngineOptions, source: &Path) -> Result<(), Error> {
    let is_there = engine.precision != Precision::Int8 || onnx.facts().get(key::QUANTIZATION).is_some();
    if is_there { Ok(()) } else { Err(OnnxError::new(source, OnnxProblem::NoRanges).into()) }
}

/// The network of `source` in the form that suits the engine: that of an ONNX file, or of a model file of our own,
/// which becomes one in memory.
fn network(source: &ModelSource, engine: &EngineOptions) -> Result<DetectorNetwork, Error> {
    let (form, target, name) = (engine.form(), engine.kind.target(), source.name());
    let path = match source {
        ModelSource::Shipped(family) => {
            let hash = family.weights_sha256();
            return Ok(match family {
                Family::FarsightW => from_hashed_model(&shipped::ssd()?, hash, form, target, name),
                Family::FarsightS => from_hashed_model(&shipped::smoke()?, hash, form, target, name),
                Family::FarsightN => from_hashed_model(&shipped::small_smoke()?, hash, form, target, name),
            }?);
        }
        ModelSource::Memory { onnx, later, .. } => return Ok(from_parts((**onnx).clone(), later.clone())),
        ModelSource::File(path) => path,
    };
    model_file::check_detector(path)?;
    if is_safetensors(path).map_err(|error| OnnxError::new(path, OnnxProblem::Read(error)))? {
        return Ok(from_model_file(path, form, target)?);
    }
    Ok(from_onnx(OnnxModel::read(path)?, path)?)
}

//! Opening the detector: the network that looks at whole images.

use std::path::{Path, PathBuf};

use farsight_methods::Detector;
use farsight_methods::detectors::{self, DetectorNetwork, Part};
use farsight_methods::smoke::{DetectorFile, REGRESSION, SmokeConfig, SmokeDetector, SmokeModel, SparseHead};
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
    pub(crate) fn family(&self) -> Result<Option<Family>, Error> {
        Ok(self.weights_sha256.as_deref().map_or(Ok(None), shipped::family_of)?)
    }
}

/// The detector of `source` on `engine`. Its regression head is only computed where it is needed, if it is of that
/// kind.
pub(crate) fn open(source: &ModelSource, engine: &EngineOptions, timing: Timing) -> Result<OpenDetector, Error> {
    engine.check()?;
    let name = source.name().to_owned();
    if let Some(network) = other_method(source, engine)? {
        let onnx = &network.first.onnx;
        check_precision(onnx, engine, &name)?;
        let weights_sha256 = onnx.facts().get(key::WEIGHTS_SHA256).map(str::to_owned);
        let start = |part: &Part| match (engine.kind, &part.trained) {
            (EngineKind::Libtorch, Some(trained)) => libtorch::start_network(engine, trained),
            (EngineKind::Libtorch, None) => Err(libtorch::no_onnx().into()),
            _ => engine.start(part.onnx.clone(), &name),
        };
        let (runner, second) = (start(&network.first)?, network.second.as_ref().map(start).transpose()?);
        let detector = network.detector(runner, second, &name)?;
        return Ok(OpenDetector { detector, name, weights_sha256 });
    }
    if engine.kind == EngineKind::Libtorch {
        let model = own_model(source)?;
        let weights_sha256 = Some(model.weights.sha256());
        let detector = SmokeDetector::new(engine.start_libtorch(&model, &name)?, &model.config, None);
        return Ok(OpenDetector { detector: Box::new(detector), name, weights_sha256 });
    }
    let DetectorFile { onnx, mut config } = read(source, engine)?;
    check_precision(&onnx, engine, &name)?;
    if let Some(size) = timing.input {
        config.input = size;
        // The camera must not change the size.
        config.focal_range_px = None;
    }
    let weights_sha256 = onnx.facts().get(key::WEIGHTS_SHA256).map(str::to_owned);
    let detector = if timing.dense_head {
        SmokeDetector::new(engine.start(onnx, &name)?, &config, None)
    } else {
        smoke(engine, onnx, &config, &name)?
    };
    Ok(OpenDetector { detector: Box::new(detector), name, weights_sha256 })
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
    smoke(engine, file.onnx, &file.config, source)
}

/// The whole network of the model at `path`, every output as it is.
///
/// # Errors
/// When the file is no detector, or the engine cannot run it.
pub fn open_network(engine: &EngineOptions, path: &Path) -> Result<Box<dyn Runner>, Error> {
    let source = ModelSource::from_word(path);
    match engine.kind {
        EngineKind::Libtorch => engine.start_libtorch(&own_model(&source)?, path),
        _ => engine.start(read(&source, engine)?.onnx, path),
    }
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

fn smoke(engine: &EngineOptions, onnx: OnnxModel, config: &SmokeConfig, source: &Path) -> Result<SmokeDetector, Error> {
    Ok(match LocalHeadFile::new(&onnx, REGRESSION, source)? {
        Some(cut) => {
            let head = SparseHead::new(&cut);
            SmokeDetector::new(engine.start(cut.model, source)?, config, Some(head))
        }
        None => SmokeDetector::new(engine.start(onnx, source)?, config, None),
    })
}

/// An ONNX file is in 8 bits or not, whatever is asked for.
fn check_precision(onnx: &OnnxModel, engine: &EngineOptions, source: &Path) -> Result<(), Error> {
    let is_there = engine.precision != Precision::Int8 || onnx.facts().get(key::QUANTIZATION).is_some();
    if is_there { Ok(()) } else { Err(OnnxError::new(source, OnnxProblem::NoRanges).into()) }
}

/// The network of a file whose method is not SMOKE.
fn other_method(source: &ModelSource, engine: &EngineOptions) -> Result<Option<DetectorNetwork>, Error> {
    let (form, target) = (engine.form(), engine.kind.target());
    let path = match source {
        ModelSource::Shipped(Family::World) => {
            let model = shipped::world()?;
            return Ok(Some(detectors::from_model(&model, form, target, source.name())?));
        }
        ModelSource::File(path) => path,
        ModelSource::Shipped(Family::Smoke) | ModelSource::Memory { .. } => return Ok(None),
    };
    model_file::check_detector(path)?;
    if is_safetensors(path).map_err(|error| OnnxError::new(path, OnnxProblem::Read(error)))? {
        return Ok(detectors::from_model_file(path, form, target)?);
    }
    Ok(detectors::from_onnx(OnnxModel::read(path)?, path)?)
}

/// The model in the form that suits the engine: an ONNX file, or one of our own that becomes one in memory.
fn read(source: &ModelSource, engine: &EngineOptions) -> Result<DetectorFile, Error> {
    let target = engine.kind.target();
    let in_int8 = |model: &SmokeModel| -> Result<DetectorFile, Error> {
        let facts = DetectorFile::facts(model, target);
        let onnx = OnnxModel::from_model_in_int8(model, &facts, target, source.name())?;
        Ok(DetectorFile::from_onnx(onnx, source.name())?)
    };
    let is_int8 = engine.precision == Precision::Int8;
    match source {
        ModelSource::Shipped(Family::Smoke) if is_int8 => in_int8(&shipped::smoke()?),
        ModelSource::Shipped(Family::Smoke) => Ok(DetectorFile::from_model(&shipped::smoke()?, target, source.name())?),
        ModelSource::Shipped(Family::World) => Err(model_file::not_smoke(source.name())),
        ModelSource::File(path) => {
            model_file::check_detector(path)?;
            let is_own = is_int8 && is_safetensors(path).unwrap_or(false);
            if is_own { in_int8(&SmokeModel::read(path)?) } else { Ok(DetectorFile::read(path, target)?) }
        }
        ModelSource::Memory { file, .. } => Ok((**file).clone()),
    }
}

/// A model file of our own, or the shipped model.
fn own_model(source: &ModelSource) -> Result<SmokeModel, Error> {
    match source {
        ModelSource::Shipped(Family::Smoke) => Ok(shipped::smoke()?),
        ModelSource::Shipped(Family::World) => Err(model_file::not_smoke(source.name())),
        ModelSource::File(path) => {
            model_file::check_detector(path)?;
            Ok(SmokeModel::read(path)?)
        }
        ModelSource::Memory { .. } => Err(libtorch::no_onnx().into()),
    }
}

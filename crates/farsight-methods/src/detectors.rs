//! Which methods detect: a file says its method by a tag, and here the tag becomes a detector.

use std::path::Path;

use farsight_graph::model::{METHOD_KEY, Model, ModelError, NetworkConfig};
use farsight_graph::transform::Network;
use farsight_graph::weights::Weights;
use farsight_onnx::{Facts, OnnxError, OnnxModel, OnnxProblem, Target, key, write};
use farsight_runtime::Runner;

use crate::Detector;
use crate::centernet3d::{CenterNet3dConfig, CenterNet3dDetector};
use crate::ssd::{SsdConfig, SsdDetector};

pub use crate::file::{ReadError, config_of};

/// A method that detects with one network and no part of it left to the decoder.
pub trait WholeNetwork: NetworkConfig {
    /// The detector of this config, whose network `runner` runs.
    fn detector(self, runner: Box<dyn Runner>) -> Box<dyn Detector>;
}

impl WholeNetwork for CenterNet3dConfig {
    fn detector(self, runner: Box<dyn Runner>) -> Box<dyn Detector> {
        Box::new(CenterNet3dDetector::new(runner, self))
    }
}

impl WholeNetwork for SsdConfig {
    fn detector(self, runner: Box<dyn Runner>) -> Box<dyn Detector> {
        Box::new(SsdDetector::new(runner, self))
    }
}

/// A network of such a method, ready to be started.
pub struct DetectorNetwork {
    /// Its ONNX form, with what the file says.
    pub onnx: OnnxModel,
    /// The network as it was trained, its outputs alone; none of an ONNX file.
    pub trained: Option<Network>,
    make: Make,
}

impl DetectorNetwork {
    /// The detector, whose network `runner` runs; `source` is only what errors call it.
    ///
    /// # Errors
    /// When the file's config is none.
    pub fn detector(&self, runner: Box<dyn Runner>, source: &Path) -> Result<Box<dyn Detector>, OnnxError> {
        (self.make)(runner, &self.onnx, source)
    }
}

/// What becomes of the weights of a model file, in a form and for a target; the path is only what errors call it.
type FromWeights = fn(Weights, NetworkForm, Target, &Path) -> Result<(OnnxModel, Network), ReadError>;
type Make = fn(Box<dyn Runner>, &OnnxModel, &Path) -> Result<Box<dyn Detector>, OnnxError>;

/// In which form a network is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NetworkForm {
    /// As it was trained: the reference.
    AsTrained,
    /// With normalisation folded into the convolutions, as it is run.
    Deployable,
    /// Deployable, in 8 bits with the ranges that the model's file keeps.
    Int8,
}

/// The methods, by their tags. SMOKE has a way of its own ([`crate::smoke::DetectorFile`]): its regression head may be
/// computed at the peaks alone.
const METHODS: [(&str, FromWeights, Make); 2] = [
    (CenterNet3dConfig::METHOD, onnx_of::<CenterNet3dConfig>, detector_of::<CenterNet3dConfig>),
    (SsdConfig::METHOD, onnx_of::<SsdConfig>, detector_of::<SsdConfig>),
];

/// The network of a model file (safetensors) of ours, if it is of a method that is listed here.
///
/// # Errors
/// When the file is of such a method and broken.
pub fn from_model_file(path: &Path, form: NetworkForm, target: Target) -> Result<Option<DetectorNetwork>, ReadError> {
    let metadata = Weights::read_metadata(path).unwrap_or_default();
    let Some((_, onnx, make)) = metadata.get(METHOD_KEY).and_then(|tag| METHODS.iter().find(|row| row.0 == tag)) else {
        return Ok(None);
    };
    let weights = Weights::read(path).map_err(ModelError::from)?;
    let (onnx, trained) = onnx(weights, form, target, path)?;
    Ok(Some(DetectorNetwork { onnx, trained: Some(trained), make: *make }))
}

/// The network of `model`; `source` is only what errors call it.
///
/// # Errors
/// When the weights do not fit the network.
pub fn from_model<C: WholeNetwork>(
    model: &Model<C>,
    form: NetworkForm,
    target: Target,
    source: &Path,
) -> Result<DetectorNetwork, ReadError> {
    let (onnx, trained) = onnx_of_model(model, form, target, source)?;
    Ok(DetectorNetwork { onnx, trained: Some(trained), make: detector_of::<C> })
}

/// The network of an ONNX file of ours, if it is of a method that is listed here.
///
/// # Errors
/// The file itself, when it is of no such method.
pub fn from_onnx(onnx: OnnxModel) -> Result<DetectorNetwork, OnnxModel> {
    let tag = onnx.facts().get(key::METHOD);
    match tag.and_then(|tag| METHODS.iter().find(|row| row.0 == tag)) {
        Some((_, _, make)) => Ok(DetectorNetwork { onnx, trained: None, make: *make }),
        None => Err(onnx),
    }
}

/// The network of any model of ours in this form; `source` is only what errors call it.
///
/// # Errors
/// When the weights do not fit the network, or its file keeps no ranges for 8 bits.
pub fn in_form<C: NetworkConfig>(
    model: &Model<C>,
    form: NetworkForm,
    target: Target,
    source: &Path,
) -> Result<OnnxModel, ReadError> {
    Ok(onnx_of_model(model, form, target, source)?.0)
}

fn onnx_of<C: NetworkConfig>(
    weights: Weights,
    form: NetworkForm,
    target: Target,
    source: &Path,
) -> Result<(OnnxModel, Network), ReadError> {
    onnx_of_model(&Model::<C>::from_weights(weights, source)?, form, target, source)
}

fn onnx_of_model<C: NetworkConfig>(
    model: &Model<C>,
    form: NetworkForm,
    target: Target,
    source: &Path,
) -> Result<(OnnxModel, Network), ReadError> {
    let facts = Facts::new(model, target);
    let trained = Network::new(model).with_outputs(C::OUTPUTS);
    let onnx = match form {
        NetworkForm::Deployable => OnnxModel::from_model(model, &facts, target, source)?,
        NetworkForm::Int8 => OnnxModel::from_model_in_int8(model, &facts, target, source)?,
        NetworkForm::AsTrained => {
            let failed = |error| OnnxError::new(source, OnnxProblem::Weights(error));
            OnnxModel::from_bytes(write(&trained, &facts, target).map_err(failed)?, source)?
        }
    };
    Ok((onnx, trained))
}

fn detector_of<C: WholeNetwork>(
    runner: Box<dyn Runner>,
    onnx: &OnnxModel,
    source: &Path,
) -> Result<Box<dyn Detector>, OnnxError> {
    Ok(config_of::<C>(onnx, source)?.detector(runner))
}

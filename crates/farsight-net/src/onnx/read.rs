//! Reading what a file says about itself.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use farsight_core::codec::CHANNELS;
use thiserror::Error;

use super::error::{OnnxError, OnnxProblem};
use super::wire::{Message, WireError};
use super::{Facts, INPUT, Target, field, key, write};
use crate::config::{ConfigError, ModelConfig};
use crate::graph::{LOGITS, REGRESSION};
use crate::model::{Model, ModelError};
use crate::transform::Network;

/// Every operator that files of ours have.
const OPERATORS: [&str; 28] = [
    "Add",
    "BatchNormalization",
    "Cast",
    "Clip",
    "Concat",
    "Conv",
    "ConvTranspose",
    "DeformConv",
    "DepthToSpace",
    "DequantizeLinear",
    "Div",
    "Gather",
    "GlobalAveragePool",
    "GridSample",
    "InstanceNormalization",
    "MaxPool",
    "Mul",
    "QuantizeLinear",
    "Range",
    "Relu",
    "Reshape",
    "Resize",
    "Shape",
    "Sigmoid",
    "Slice",
    "Split",
    "Sub",
    "Transpose",
];

/// The one among them that only ONNX Runtime has.
const DEFORM_CONV: &str = "DeformConv";

/// The largest file that is read: several times the largest network of ours.
const LARGEST_FILE: u64 = 1 << 30;

/// More nodes, constants or facts than this has no network of ours.
const LARGEST_COUNT: usize = 100_000;

/// Bytes of a safetensors file up to the first brace of its header.
const SAFETENSORS_START: usize = 9;

/// How much of a stranger's name goes into a message.
const SHOWN: usize = 60;

/// A file that is no model of either kind.
#[derive(Debug, Error)]
pub enum ReadAnyError {
    /// It looks like a model of ours (safetensors) and is none.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// It is no ONNX file of ours.
    #[error(transparent)]
    Onnx(#[from] OnnxError),
}

/// A file of ours, checked, and what it says about itself.
///
/// Whoever made the file, this holds: it is a whole protobuf message of at most a gibibyte, its description is valid, it has the input and the
/// outputs that the description promises, its constants are in it and in no other file, and it consists of operators that `farsight export`
/// writes: none that loops, branches or calls other code. Reading it takes memory for one copy of the file.
#[derive(Debug, Clone, PartialEq)]
pub struct OnnxModel {
    bytes: Vec<u8>,
    config: ModelConfig,
    facts: Facts,
    deform_conv: bool,
    outputs: [String; 2],
}

impl OnnxModel {
    /// Reads a file.
    ///
    /// # Errors
    /// When the file cannot be read or is not one of ours.
    pub fn read(path: &Path) -> Result<Self, OnnxError> {
        let failed = |error| OnnxError::new(path, OnnxProblem::Read(error));
        let file = File::open(path).map_err(failed)?;
        let found = file.metadata().map_err(failed)?.len();
        if found > LARGEST_FILE {
            return Err(OnnxError::new(path, OnnxProblem::Size { found, limit: LARGEST_FILE }));
        }
        let mut bytes = Vec::new();
        // A file may grow while it is read, and some (/dev/zero) have no size.
        file.take(LARGEST_FILE).read_to_end(&mut bytes).map_err(failed)?;
        Self::from_bytes(bytes, path)
    }

    /// Reads a model of either kind: an ONNX file, or a model file of ours (safetensors), which becomes one in memory, for `target`.
    ///
    /// # Errors
    /// When the file cannot be read or is neither.
    pub fn read_any(path: &Path, target: Target) -> Result<Self, ReadAnyError> {
        if is_safetensors(path).map_err(|error| OnnxError::new(path, OnnxProblem::Read(error)))? {
            Ok(Self::from_model(&Model::read(path)?, target, path)?)
        } else {
            Ok(Self::read(path)?)
        }
    }

    /// The ONNX form of `model`; `source` is only what errors call it.
    ///
    /// # Errors
    /// When the weights do not fit the network.
    pub fn from_model(model: &Model, target: Target, source: &Path) -> Result<Self, ReadAnyError> {
        let network = Network::deployable(model).map_err(ModelError::from)?;
        let bytes = write(&network, &Facts::new(model, target), target).map_err(ModelError::from)?;
        Ok(Self::from_bytes(bytes, source)?)
    }

    /// A file that is in memory already; `source` is only what errors call it.
    ///
    /// # Errors
    /// When the bytes are not a file of ours.
    pub fn from_bytes(bytes: Vec<u8>, source: &Path) -> Result<Self, OnnxError> {
        let (config, facts, deform_conv) = checked(&bytes).map_err(|problem| OnnxError::new(source, problem))?;
        let outputs = [LOGITS, REGRESSION].map(str::to_owned);
        Ok(Self { bytes, config, facts, deform_conv, outputs })
    }

    /// What the model is.
    pub fn config(&self) -> &ModelConfig {
        &self.config
    }

    /// Names of the outputs: the heat map's logits, and the regression or what [`super::PeaksOnly`] reads instead.
    pub fn outputs(&self) -> [&str; 2] {
        [&self.outputs[0], &self.outputs[1]]
    }

    /// The same model with other bytes, which end at `features` instead of the regression.
    pub(super) fn ending_at(&self, features: String, bytes: Vec<u8>) -> Self {
        Self { bytes, outputs: [LOGITS.to_owned(), features], ..self.clone_without_bytes() }
    }

    fn clone_without_bytes(&self) -> Self {
        let Self { bytes: _, config, facts, deform_conv, outputs } = self;
        let (config, facts, outputs) = (config.clone(), facts.clone(), outputs.clone());
        Self { bytes: Vec::new(), config, facts, deform_conv: *deform_conv, outputs }
    }

    /// What else is known about it.
    pub fn facts(&self) -> &Facts {
        &self.facts
    }

    /// Whether it has deformable convolutions in the form that only ONNX Runtime runs.
    pub fn has_deform_conv(&self) -> bool {
        self.deform_conv
    }

    /// The file.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The file, for an engine to keep.
    pub fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }
}

/// Whether a file starts as safetensors files do: the length of the header, and the header's first brace.
///
/// # Errors
/// When the file cannot be read.
pub fn is_safetensors(path: &Path) -> std::io::Result<bool> {
    let mut start = Vec::new();
    File::open(path)?.take(SAFETENSORS_START as u64).read_to_end(&mut start)?;
    Ok(start.len() == SAFETENSORS_START && start.ends_with(b"{"))
}

/// Description, facts, and whether there is a `DeformConv`.
fn checked(bytes: &[u8]) -> Result<(ModelConfig, Facts, bool), OnnxProblem> {
    let model = Message::new(bytes);
    let facts = facts(model)?;
    let config = config(&facts)?;
    facts.get(key::WEIGHTS_SHA256).ok_or(OnnxProblem::Cut)?;
    let graph = model.last(field::MODEL_GRAPH)?.ok_or(OnnxProblem::NoGraph)?;
    if let Some(function) = model.all(field::MODEL_FUNCTIONS).next() {
        function?;
        return Err(OnnxProblem::Operator { name: "a function of the file's own".to_owned() });
    }
    let deform_conv = check_operators(graph)?;
    check_constants(graph)?;
    check_values(graph, &config)?;
    Ok((config, facts, deform_conv))
}

/// Facts whose keys are ours.
fn facts(model: Message<'_>) -> Result<Facts, OnnxProblem> {
    let mut facts = Facts::default();
    for entry in counted(model.all(field::MODEL_METADATA), "facts") {
        let entry = entry?;
        let text = |number| Ok::<_, WireError>(entry.last(number)?.map(Message::text).transpose()?.unwrap_or_default());
        let key = text(field::ENTRY_KEY)?;
        if key.starts_with("farsight.") {
            facts.set(key, text(field::ENTRY_VALUE)?.to_owned());
        }
    }
    Ok(facts)
}

fn config(facts: &Facts) -> Result<ModelConfig, OnnxProblem> {
    let text = facts.get(key::MODEL).ok_or(OnnxProblem::Foreign)?;
    let bad = |problem| OnnxProblem::Config { problem };
    let config: ModelConfig = serde_json::from_str(text).map_err(|error| bad(error.to_string()))?;
    config.validate().map_err(|error: ConfigError| bad(error.to_string()))?;
    Ok(config)
}

/// Only operators of ours; says whether `DeformConv` is among them.
fn check_operators(graph: Message<'_>) -> Result<bool, OnnxProblem> {
    let mut deform_conv = false;
    for node in counted(graph.all(field::GRAPH_NODE), "nodes") {
        let name = text_in(node?, field::NODE_OPERATOR)?;
        if OPERATORS.binary_search(&name).is_err() {
            return Err(OnnxProblem::Operator { name: shortened(name) });
        }
        deform_conv |= name == DEFORM_CONV;
    }
    Ok(deform_conv)
}

fn check_constants(graph: Message<'_>) -> Result<(), OnnxProblem> {
    for tensor in counted(graph.all(field::GRAPH_CONSTANT), "constants") {
        let tensor = tensor?;
        if tensor.number(field::TENSOR_LOCATION)? != 0 {
            return Err(OnnxProblem::External { name: shortened(text_in(tensor, field::TENSOR_NAME)?) });
        }
    }
    Ok(())
}

fn check_values(graph: Message<'_>, config: &ModelConfig) -> Result<(), OnnxProblem> {
    value(graph, field::GRAPH_INPUT, "input", INPUT)?;
    for (name, expected) in [(LOGITS, config.classes.len()), (REGRESSION, CHANNELS)] {
        let output = value(graph, field::GRAPH_OUTPUT, "output", name)?;
        if let Some(found) = channels(output)?
            && found != expected as u64
        {
            return Err(OnnxProblem::Channels { name, found, expected });
        }
    }
    Ok(())
}

/// The input or output called `name`.
fn value<'a>(
    graph: Message<'a>,
    number: u64,
    kind: &'static str,
    name: &'static str,
) -> Result<Message<'a>, OnnxProblem> {
    let mut found = Vec::new();
    for value in counted(graph.all(number), "inputs or outputs") {
        let value = value?;
        let value_name = text_in(value, field::VALUE_NAME)?;
        if value_name == name {
            return Ok(value);
        }
        if found.len() < 8 {
            found.push(shortened(value_name));
        }
    }
    Err(OnnxProblem::Value { kind, name, found })
}

/// The size of the second axis, where the file gives it as a number.
fn channels(value: Message<'_>) -> Result<Option<u64>, WireError> {
    let path = [field::VALUE_TYPE, field::TYPE_TENSOR, field::TENSOR_SHAPE];
    let shape = path.iter().try_fold(Some(value), |message, &number| match message {
        Some(message) => message.last(number),
        None => Ok(None),
    })?;
    let axis = shape.and_then(|shape| shape.all(field::SHAPE_AXIS).nth(1)).transpose()?;
    let size = axis.map(|axis| axis.number(field::AXIS_SIZE)).transpose()?;
    Ok(size.filter(|&size| size > 0))
}

pub(super) fn text_in(message: Message<'_>, number: u64) -> Result<&str, WireError> {
    Ok(message.last(number)?.map(Message::text).transpose()?.unwrap_or_default())
}

/// The items up to the largest count that makes sense, then an error.
pub(super) fn counted<'a>(
    items: impl Iterator<Item = Result<Message<'a>, WireError>>,
    what: &'static str,
) -> impl Iterator<Item = Result<Message<'a>, OnnxProblem>> {
    items.enumerate().map(move |(count, item)| {
        if count >= LARGEST_COUNT {
            return Err(OnnxProblem::Count { what, limit: LARGEST_COUNT });
        }
        Ok(item?)
    })
}

pub(super) fn shortened(name: &str) -> String {
    name.chars().take(SHOWN).collect()
}

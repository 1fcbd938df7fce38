//! Reading what a file says about itself.

use std::borrow::Cow;
use std::io::Read;
use std::path::Path;

use crate::bounded::{counted, shortened, text_in};
use crate::error::{OnnxError, OnnxProblem};
use crate::wire::{Message, WireError};
use crate::write::encoded;
use crate::{Facts, INPUT, Target, field, key, limits, seal};
use farsight_files::{open_regular, read_file};
use farsight_graph::model::{Model, NetworkConfig};
use farsight_graph::quantize::{StoredRanges, WeightRange};
use farsight_graph::transform::Network;
use farsight_graph::weights::{FILE_SHA256_KEY, WeightsError};

/// The outputs whose layers may be in 8 bits.
pub fn int8_outputs<C: NetworkConfig>() -> Vec<&'static str> {
    C::OUTPUTS.iter().copied().filter(|output| C::LOCAL_HEAD != Some(*output)).collect()
}

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
const MAX_FILE: u64 = 1 << 30;

/// Bytes of a safetensors file up to the first brace of its header.
const SAFETENSORS_START: usize = 9;

/// An input or output of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TensorInfo {
    /// Its name.
    pub name: String,
    /// Its channels, the second axis, where the file gives them as a number. Batch, height and width are free.
    pub channels: Option<usize>,
}

/// A file of ours, checked, and what it says about itself.
///
/// Whoever made the file, this holds: it is a whole protobuf message of at most a gibibyte, it says which method it is
/// of, it has one input and at least one output, its constants are in it and in no other file, and it consists of
/// operators that `farsight export` writes: none that loops, branches or calls other code. No window, stride or
/// enlargement is wider than 128, and no map of an image takes more than 2 GiB. Its floats are finite, and where it
/// carries a hash, it is as it was written; what was never a file carries none. Reading it takes memory for one copy of
/// the file.
#[derive(Debug, Clone, PartialEq)]
pub struct OnnxModel {
    bytes: Vec<u8>,
    facts: Facts,
    deform_conv: bool,
    has_hash: bool,
    input: TensorInfo,
    outputs: Vec<TensorInfo>,
}

impl OnnxModel {
    /// Reads a file.
    ///
    /// # Errors
    /// When the file cannot be read or is not one of ours.
    pub fn read(path: &Path) -> Result<Self, OnnxError> {
        let bytes = read_file(path, MAX_FILE).map_err(|error| OnnxError::new(path, OnnxProblem::Read(error)))?;
        Self::from_bytes(bytes, path)
    }

    /// The ONNX form of `model` with these `facts`; `source` is only what errors call it.
    ///
    /// # Errors
    /// When the weights do not fit the network.
    pub fn from_model<C: NetworkConfig>(
        model: &Model<C>,
        facts: &Facts,
        target: Target,
        source: &Path,
    ) -> Result<Self, OnnxError> {
        let network = Network::deployable(model);
        let network = network.map_err(|error| OnnxError::new(source, OnnxProblem::Weights(error)))?;
        Self::from_network(&network, facts, target, source)
    }

    /// The ONNX form of a network as it stands; `source` is only what errors call it.
    ///
    /// # Errors
    /// When a weight is missing, has another shape or is not finite.
    pub fn from_network(network: &Network, facts: &Facts, target: Target, source: &Path) -> Result<Self, OnnxError> {
        let bytes = encoded(network, None, facts, target);
        Self::from_bytes(bytes.map_err(|error| OnnxError::new(source, OnnxProblem::Weights(error)))?, source)
    }

    /// As [`OnnxModel::from_model`], in 8 bits with the ranges that the model's file keeps: all but what reads the
    /// image, the last layers, and a head that is computed at the peaks. The weights take the numbers that this CPU
    /// computes rightly with ([`WeightRange::of_this_cpu`]).
    ///
    /// # Errors
    /// When it keeps none of this network, or the weights do not fit.
    pub fn from_model_in_int8<C: NetworkConfig>(
        model: &Model<C>,
        facts: &Facts,
        target: Target,
        source: &Path,
    ) -> Result<Self, OnnxError> {
        let failed = |error: WeightsError| OnnxError::new(source, OnnxProblem::Weights(error));
        let network = Network::deployable(model).map_err(failed)?;
        let ranges = StoredRanges::of_header(&model.weights.metadata);
        let quantization = ranges.and_then(|ranges| ranges.quantization(&network.graph, &int8_outputs::<C>()));
        let quantization = quantization.ok_or_else(|| OnnxError::new(source, OnnxProblem::NoRanges))?;
        let quantization = quantization.with_weights(WeightRange::of_this_cpu());
        let mut facts = facts.clone();
        let told = serde_json::json!({
            "bits": 8, "layers": quantization.layer_count(),
            "reduce_range": quantization.weights() == WeightRange::Reduced,
        });
        facts.set(key::QUANTIZATION, told.to_string());
        Self::from_bytes(encoded(&network, Some(&quantization), &facts, target).map_err(failed)?, source)
    }

    /// A file that is in memory already; `source` is only what errors call it.
    ///
    /// # Errors
    /// When the bytes are not a file of ours.
    pub fn from_bytes(bytes: Vec<u8>, source: &Path) -> Result<Self, OnnxError> {
        let checked = checked(&bytes).map_err(|problem| OnnxError::new(source, problem))?;
        let Checked { facts, deform_conv, has_hash, input, outputs } = checked;
        Ok(Self { bytes, facts, deform_conv, has_hash, input, outputs })
    }

    /// Its input.
    pub fn input(&self) -> &TensorInfo {
        &self.input
    }

    /// Its outputs, in the order of the file.
    pub fn outputs(&self) -> &[TensorInfo] {
        &self.outputs
    }

    /// Channels of the output called `name`, where the file gives them.
    pub fn channels(&self, name: &str) -> Option<usize> {
        self.outputs.iter().find(|output| output.name == name)?.channels
    }

    /// The same model with other bytes, which end at `features` in the place of the output `made`.
    pub(crate) fn ending_at(&self, made: &str, features: String, channels: usize, bytes: Vec<u8>) -> Self {
        let mut outputs = self.outputs.clone();
        outputs.retain(|output| output.name != made);
        outputs.push(TensorInfo { name: features, channels: Some(channels) });
        let (facts, input) = (self.facts.clone(), self.input.clone());
        Self { bytes, facts, deform_conv: self.deform_conv, has_hash: self.has_hash, input, outputs }
    }

    /// What else is known about it.
    pub fn facts(&self) -> &Facts {
        &self.facts
    }

    /// Whether it has deformable convolutions in the form that only ONNX Runtime runs.
    pub fn has_deform_conv(&self) -> bool {
        self.deform_conv
    }

    /// Whether the file carries a hash of its contents, which was checked then.
    pub fn has_hash(&self) -> bool {
        self.has_hash
    }

    /// What is to be written to a file: with a hash of its contents.
    pub fn sealed(&self) -> Cow<'_, [u8]> {
        if self.has_hash { Cow::from(&self.bytes) } else { Cow::from(seal::sealed(self.bytes.clone())) }
    }

    /// What engines read.
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
/// When the file cannot be read, or is a pipe, socket or device, which is not waited for.
pub fn is_safetensors(path: &Path) -> std::io::Result<bool> {
    let mut start = Vec::new();
    open_regular(path)?.take(SAFETENSORS_START as u64).read_to_end(&mut start)?;
    Ok(start.len() == SAFETENSORS_START && start.ends_with(b"{"))
}

/// What a file says, checked.
struct Checked {
    facts: Facts,
    deform_conv: bool,
    has_hash: bool,
    input: TensorInfo,
    outputs: Vec<TensorInfo>,
}

fn checked(bytes: &[u8]) -> Result<Checked, OnnxProblem> {
    let model = Message::new(bytes);
    let facts = facts(model)?;
    let has_hash = seal::check(model)?;
    facts.get(key::MODEL).ok_or(OnnxProblem::UnknownProducer)?;
    facts.get(key::WEIGHTS_SHA256).ok_or(OnnxProblem::Cut)?;
    let graph = model.last(field::MODEL_GRAPH)?.ok_or(OnnxProblem::NoGraph)?;
    if let Some(function) = model.all(field::MODEL_FUNCTIONS).next() {
        function?;
        return Err(OnnxProblem::Operator { name: "a function of the file's own".to_owned() });
    }
    let deform_conv = check_operators(graph)?;
    check_constants(graph)?;
    let inputs = values(graph, field::GRAPH_INPUT)?;
    let input = inputs.iter().find(|input| input.name == INPUT).cloned();
    let input = input.ok_or_else(|| missing("input", INPUT, &inputs))?;
    // What a second part reads is no image.
    let is_second = facts.get(key::PART).is_some_and(|part| part.starts_with('2'));
    let description = facts.get(key::MODEL).filter(|_| !is_second);
    limits::check(graph, INPUT, limits::largest_input_px(description))?;
    let outputs = values(graph, field::GRAPH_OUTPUT)?;
    if outputs.is_empty() {
        return Err(missing("output", "of any name", &outputs));
    }
    Ok(Checked { facts, deform_conv, has_hash, input, outputs })
}

/// An input or output that is not there.
fn missing(kind: &'static str, name: &'static str, found: &[TensorInfo]) -> OnnxProblem {
    let found = found.iter().take(8).map(|value| shortened(&value.name)).collect();
    OnnxProblem::Value { kind, name, found }
}

/// Facts whose keys are ours.
fn facts(model: Message<'_>) -> Result<Facts, OnnxProblem> {
    let mut facts = Facts::default();
    for entry in counted(model.all(field::MODEL_METADATA), "facts") {
        let entry = entry?;
        let text = |number| Ok::<_, WireError>(entry.last(number)?.map(Message::text).transpose()?.unwrap_or_default());
        let key = text(field::ENTRY_KEY)?;
        // The hash is the file's, not the model's.
        if key.starts_with("farsight.") && key != FILE_SHA256_KEY {
            facts.set(key, text(field::ENTRY_VALUE)?.to_owned());
        }
    }
    Ok(facts)
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
        seal::check_floats(tensor)?;
    }
    Ok(())
}

/// All inputs, or all outputs.
fn values(graph: Message<'_>, number: u64) -> Result<Vec<TensorInfo>, OnnxProblem> {
    let value = |value: Result<Message<'_>, OnnxProblem>| {
        let value = value?;
        let name = text_in(value, field::VALUE_NAME)?.to_owned();
        Ok(TensorInfo { name, channels: channels(value)?.and_then(|channels| usize::try_from(channels).ok()) })
    };
    counted(graph.all(number), "inputs or outputs").map(value).collect()
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

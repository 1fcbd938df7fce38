//! A file without one of its heads, and the head on its own.

use std::collections::HashSet;
use std::path::Path;

use prost::Message as _;

use crate::bounded::{counted, floats, shortened, text_in, texts_in};
use crate::error::{OnnxError, OnnxProblem};
use crate::head_names::HeadNames;
use crate::parts::map_info;
use crate::proto::GraphProto;
use crate::wire::{Message, Value, WireError, append};
use crate::{OnnxModel, field, key};
use farsight_graph::weights::WeightTensor;

/// A convolution of a head.
#[derive(Debug, Clone, PartialEq)]
pub struct HeadLayer {
    /// `[out, in, k, k]`, `k` odd.
    pub weight: WeightTensor,
    /// `[out]`.
    pub bias: WeightTensor,
}

/// A network that ends where one head begins, and the head: a convolution, `ReLU`, a 1x1 convolution.
///
/// The file itself stays a whole network that any program can run. The head need only be computed at the peaks of a
/// heatmap.
#[derive(Debug, Clone, PartialEq)]
pub struct LocalHeadFile {
    /// The network without the head. Its last output holds the features.
    pub model: OnnxModel,
    /// First convolution, `[hidden, features, k, k]`, stride 1, the map keeps its size.
    pub hidden: HeadLayer,
    /// Second convolution, `[channels, hidden, 1, 1]`.
    pub output: HeadLayer,
}

impl LocalHeadFile {
    /// Cuts `model` before the head that makes `output`; `None` when the head looks at the whole map, as with group
    /// norm. `source` is only what errors call it.
    ///
    /// # Errors
    /// When the file is not what its metadata say.
    pub fn new(model: &OnnxModel, output: &str, source: &Path) -> Result<Option<Self>, OnnxError> {
        let failed = |problem| OnnxError::new(source, problem);
        let Some(names) = model.facts().get(key::PEAKS_HEAD) else { return Ok(None) };
        let names: HeadNames = serde_json::from_str(names).map_err(|error| failed(bad(error.to_string())))?;
        Self::cut(model, output, names).map(Some).map_err(failed)
    }

    fn cut(model: &OnnxModel, made: &str, names: HeadNames) -> Result<Self, OnnxProblem> {
        let file = Message::new(model.bytes());
        let graph = file.last(field::MODEL_GRAPH)?.ok_or(OnnxProblem::NoGraph)?;
        let hidden = layer(graph, &names.hidden)?;
        let output = layer(graph, &names.output)?;
        let [width, channels, kernel, _] = hidden.weight.shape[..] else { unreachable!("layer() has checked it") };
        if kernel.is_multiple_of(2) {
            return Err(bad(format!("a kernel of {kernel} cells; expected an odd number")));
        }
        let expected = [model.channels(made).unwrap_or(output.weight.shape[0]), width, 1, 1];
        if output.weight.shape != expected {
            return Err(bad(format!("a last convolution of shape {:?}; expected {expected:?}", output.weight.shape)));
        }
        let graph = graph_ending_at(graph, model, made, &names.features, channels)?;
        let mut bytes = Vec::with_capacity(model.bytes().len());
        for part in file.fields() {
            let part = part?;
            if part.number != field::MODEL_GRAPH {
                bytes.extend(part.raw);
            }
        }
        append(&mut bytes, field::MODEL_GRAPH, &graph);
        Ok(Self { model: model.ending_at(made, names.features, channels, bytes), hidden, output })
    }
}

/// A file whose head is not what it should be.
fn bad(problem: String) -> OnnxProblem {
    OnnxProblem::Head { problem }
}

/// The graph with `features` in the place of the output `made`, and nothing that its outputs do not need.
fn graph_ending_at(
    graph: Message<'_>,
    model: &OnnxModel,
    made: &str,
    features: &str,
    channels: usize,
) -> Result<Vec<u8>, OnnxProblem> {
    let others = model.outputs().iter().map(|output| output.name.as_str()).filter(|name| *name != made);
    let needed = needed(graph, &others.chain([features]).collect::<Vec<_>>())?;
    let mut bytes = Vec::new();
    for part in graph.fields() {
        let part = part?;
        let keep = match (part.number, part.value) {
            (field::GRAPH_NODE, Value::Bytes(node)) => produces(node, &needed)?,
            (field::GRAPH_CONSTANT, Value::Bytes(tensor)) => needed.contains(text_in(tensor, field::TENSOR_NAME)?),
            (field::GRAPH_OUTPUT, Value::Bytes(output)) => text_in(output, field::VALUE_NAME)? != made,
            _ => true,
        };
        if keep {
            bytes.extend(part.raw);
        }
    }
    let output = GraphProto { output: vec![map_info(features, channels)], ..GraphProto::default() };
    bytes.extend(output.encode_to_vec());
    Ok(bytes)
}

/// Names of all values that the `outputs` are made from.
fn needed<'a>(graph: Message<'a>, outputs: &[&'a str]) -> Result<HashSet<&'a str>, OnnxProblem> {
    let nodes: Vec<Message<'a>> = counted(graph.all(field::GRAPH_NODE), "nodes").collect::<Result<_, _>>()?;
    let mut needed: HashSet<&str> = outputs.iter().copied().collect();
    let mut made = HashSet::new();
    // Nodes stand in an order in which they can be computed.
    for node in nodes.into_iter().rev() {
        if produces(node, &needed)? {
            made.extend(texts_in(node, field::NODE_OUTPUT)?);
            needed.extend(texts_in(node, field::NODE_INPUT)?);
        }
    }
    match outputs.iter().find(|output| !made.contains(**output)) {
        Some(missing) => Err(bad(format!("no node makes \"{}\"", shortened(missing)))),
        None => Ok(needed),
    }
}

fn produces(node: Message<'_>, needed: &HashSet<&str>) -> Result<bool, WireError> {
    Ok(texts_in(node, field::NODE_OUTPUT)?.iter().any(|name| needed.contains(name)))
}

/// Weight and bias of these names, their shapes checked.
fn layer(graph: Message<'_>, [weight, bias]: &[String; 2]) -> Result<HeadLayer, OnnxProblem> {
    let layer = HeadLayer { weight: constant(graph, weight)?, bias: constant(graph, bias)? };
    match (&layer.weight.shape[..], &layer.bias.shape[..]) {
        ([out, _, height, width], [values]) if out == values && height == width => Ok(layer),
        (weight, bias) => Err(bad(format!("a convolution of shape {weight:?} with a bias of shape {bias:?}"))),
    }
}

/// The constant called `name`, of floats.
fn constant(graph: Message<'_>, name: &str) -> Result<WeightTensor, OnnxProblem> {
    let shown = shortened(name);
    let mut found = None;
    for tensor in counted(graph.all(field::GRAPH_CONSTANT), "constants") {
        let tensor = tensor?;
        if text_in(tensor, field::TENSOR_NAME)? == name {
            found = Some(tensor);
        }
    }
    let tensor = found.ok_or_else(|| bad(format!("no constant \"{shown}\"")))?;
    floats(tensor)?.map_err(|problem| bad(format!("constant \"{shown}\" {problem}")))
}

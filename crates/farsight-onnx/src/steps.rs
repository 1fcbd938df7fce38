//! A network in steps: its convolutions, and what lies between them.

use std::collections::{BTreeSet, HashMap, HashSet};
use std::path::Path;

use prost::Message as _;

use crate::bounded::{floats, text_in, texts_in};
use crate::error::{OnnxError, OnnxProblem};
use crate::limits::whole_numbers;
use crate::proto::{GraphProto, ValueInfoProto};
use crate::wire::{Field, Message, Value, WireError, append};
use crate::{OnnxModel, field};
use farsight_graph::graph::Window;
use farsight_graph::weights::WeightTensor;

/// What is computed at once.
#[derive(Debug, Clone, PartialEq)]
pub enum Step {
    /// A convolution.
    Convolution(Convolution),
    /// A network of its own.
    Graph(Subgraph),
}

/// How channels and cells of a convolution belong together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ConvolutionKind {
    /// Every output channel sees all input channels; weight `[out, in, kernel, kernel]`.
    Dense,
    /// Every channel sees itself; weight `[channels, 1, kernel, kernel]`.
    Depthwise,
    /// A depthwise transposed convolution that enlarges by its stride: the kernel is twice as wide as the stride, the
    /// padding half as wide. Weight `[channels, 1, kernel, kernel]`.
    Upsampling,
}

/// A convolution of floats, and a limit on what comes out.
#[derive(Debug, Clone, PartialEq)]
pub struct Convolution {
    /// Value that it reads, `[batch, in, height, width]`.
    pub input: String,
    /// Value that it makes.
    pub output: String,
    /// How channels and cells belong together.
    pub kind: ConvolutionKind,
    /// Shape of the window.
    pub window: Window,
    /// By output channel, input channel, row and column.
    pub weight: WeightTensor,
    /// One number an output channel.
    pub bias: Vec<f32>,
    /// What comes out is no less and no more: 0 and infinity after a `ReLU`.
    pub limits: [f32; 2],
}

impl Convolution {
    /// Whether it is a dense one whose windows are one cell each, and every cell has one.
    pub fn is_pointwise(&self) -> bool {
        let Window { kernel, stride, padding, end_padding, .. } = self.window;
        self.kind == ConvolutionKind::Dense && kernel == 1 && stride == 1 && padding == 0 && end_padding == 0
    }
}

/// Operators that need no convolution between them.
#[derive(Debug, Clone, PartialEq)]
pub struct Subgraph {
    /// An ONNX file of its own.
    pub bytes: Vec<u8>,
    /// Values that it reads.
    pub inputs: Vec<String>,
    /// Values that it makes for later steps, or for the user.
    pub outputs: Vec<String>,
}

impl OnnxModel {
    /// The network in steps, in an order in which they can be computed. Convolutions that are not of a common kind, or
    /// whose weights are no constant floats, stay among the other operators.
    ///
    /// # Errors
    /// When the file is broken; `source` is only what the error calls it.
    pub fn steps(&self, source: &Path) -> Result<Vec<Step>, OnnxError> {
        self.found_steps().map_err(|problem| OnnxError::new(source, problem))
    }

    fn found_steps(&self) -> Result<Vec<Step>, OnnxProblem> {
        let file = Message::new(self.bytes());
        let graph = file.last(field::MODEL_GRAPH)?.ok_or(OnnxProblem::NoGraph)?;
        let parts = Parts::of(graph)?;
        let mut found = parts.convolutions()?;
        let stages = parts.stages(&found);
        let last = stages.iter().copied().max().unwrap_or_default();
        let mut steps = Vec::new();
        for stage in 0..=last {
            let here = |place: &usize| stages[*place] == stage;
            let (convolutions, others): (Vec<usize>, Vec<usize>) =
                (0..parts.nodes.len()).filter(here).partition(|place| found[*place] != Found::Other);
            for place in convolutions {
                if let Found::Convolution(convolution) = std::mem::replace(&mut found[place], Found::Absorbed) {
                    steps.push(Step::Convolution(convolution));
                }
            }
            let graph = parts.subgraph(file, &others)?;
            if !graph.outputs.is_empty() {
                steps.push(Step::Graph(graph));
            }
        }
        Ok(steps)
    }
}

/// What a node is taken for.
#[derive(Debug, PartialEq)]
enum Found {
    Convolution(Convolution),
    /// A limit that is part of the convolution before it.
    Absorbed,
    Other,
}

/// A node as it stands in the file.
struct Node<'a> {
    raw: &'a [u8],
    message: Message<'a>,
    operator: &'a str,
    inputs: Vec<&'a str>,
    outputs: Vec<&'a str>,
}

/// A graph, taken apart.
struct Parts<'a> {
    nodes: Vec<Node<'a>>,
    constants: HashMap<&'a str, Field<'a>>,
    outputs: Vec<&'a str>,
    /// By how many nodes each value is read, and how often it is an output.
    readers: HashMap<&'a str, usize>,
}

impl<'a> Parts<'a> {
    fn of(graph: Message<'a>) -> Result<Self, WireError> {
        let mut parts =
            Self { nodes: Vec::new(), constants: HashMap::new(), outputs: Vec::new(), readers: HashMap::new() };
        for field in graph.fields() {
            let field = field?;
            let Value::Bytes(message) = field.value else { continue };
            match field.number {
                field::GRAPH_NODE => parts.nodes.push(Node {
                    raw: field.raw,
                    message,
                    operator: text_in(message, field::NODE_OPERATOR)?,
                    inputs: texts_in(message, field::NODE_INPUT)?,
                    outputs: texts_in(message, field::NODE_OUTPUT)?,
                }),
                field::GRAPH_CONSTANT => {
                    parts.constants.insert(text_in(message, field::TENSOR_NAME)?, field);
                }
                field::GRAPH_OUTPUT => parts.outputs.push(text_in(message, field::VALUE_NAME)?),
                _ => {}
            }
        }
        let read = parts.nodes.iter().flat_map(|node| &node.inputs).chain(&parts.outputs);
        for &name in read {
            *parts.readers.entry(name).or_default() += 1;
        }
        Ok(parts)
    }

    fn convolutions(&self) -> Result<Vec<Found>, WireError> {
        let mut found = Vec::with_capacity(self.nodes.len());
        let mut makers = HashMap::new();
        for (place, node) in self.nodes.iter().enumerate() {
            found.push(match self.convolution(node)? {
                Some(convolution) => Found::Convolution(convolution),
                None => Found::Other,
            });
            if let (Some(limits), [input, ..], [output]) = (self.limits(node)?, &node.inputs[..], &node.outputs[..])
                && self.readers.get(input) == Some(&1)
                && let Some(&maker) = makers.get(input)
                && let Found::Convolution(convolution) = &mut found[maker]
            {
                convolution.limits = limits;
                (*output).clone_into(&mut convolution.output);
                found[place] = Found::Absorbed;
            }
            makers.extend(node.outputs.iter().map(|name| (*name, place)));
        }
        Ok(found)
    }

    /// What a node that only limits a value limits it to.
    fn limits(&self, node: &Node<'a>) -> Result<Option<[f32; 2]>, WireError> {
        let limit = |name: &str| {
            let tensor = self.floats(name)?;
            Ok::<_, WireError>(tensor.and_then(|tensor| <[f32; 1]>::try_from(tensor.values).ok()).map(|[limit]| limit))
        };
        Ok(match (node.operator, &node.inputs[..]) {
            ("Relu", [_]) => Some([0.0, f32::INFINITY]),
            ("Clip", [_, low, high]) => limit(low)?.zip(limit(high)?).map(|(low, high)| [low, high]),
            _ => None,
        })
    }

    /// A constant of floats.
    fn floats(&self, name: &str) -> Result<Option<WeightTensor>, WireError> {
        match self.constants.get(name).map(|field| field.value) {
            Some(Value::Bytes(tensor)) => Ok(floats(tensor)?.ok()),
            _ => Ok(None),
        }
    }

    fn convolution(&self, node: &Node<'a>) -> Result<Option<Convolution>, WireError> {
        let (is_transposed, [input, weight, rest @ ..], [output]) =
            (node.operator == "ConvTranspose", &node.inputs[..], &node.outputs[..])
        else {
            return Ok(None);
        };
        if !is_transposed && node.operator != "Conv" || rest.len() > 1 || self.constants.contains_key(input) {
            return Ok(None);
        }
        let Some(weight) = self.floats(weight)? else { return Ok(None) };
        let &[channels, of_group, height, width] = &weight.shape[..] else { return Ok(None) };
        let bias = match rest {
            [bias] => self.floats(bias)?,
            _ => Some(WeightTensor { shape: vec![channels], values: vec![0.0; channels] }),
        };
        let (Some(bias), Some((window, groups))) = (bias, window(node.message)?) else { return Ok(None) };
        if weight.values.is_empty() || bias.shape != [channels] || [height, width] != [window.kernel; 2] {
            return Ok(None);
        }
        let enlarges = window.kernel == 2 * window.stride
            && window.padding == window.stride / 2
            && window.stride.is_multiple_of(2)
            && window.end_padding == 0
            && window.dilation == 1;
        let is_depthwise = groups == channels && of_group == 1;
        let kind = match (is_transposed, groups) {
            (true, _) if is_depthwise && enlarges => ConvolutionKind::Upsampling,
            (false, 1) => ConvolutionKind::Dense,
            (false, _) if is_depthwise => ConvolutionKind::Depthwise,
            _ => return Ok(None),
        };
        let [input, output] = [input, output].map(|name| (*name).to_owned());
        let limits = [f32::NEG_INFINITY, f32::INFINITY];
        Ok(Some(Convolution { input, output, kind, window, weight, bias: bias.values, limits }))
    }

    /// For each node the step that it belongs to: one that reads a convolution's value belongs to the step of that
    /// convolution or a later one; a convolution that reads another node's value, to a later step than that node.
    fn stages(&self, found: &[Found]) -> Vec<usize> {
        let mut made = HashMap::new();
        let mut stages = Vec::with_capacity(found.len());
        for (node, found) in self.nodes.iter().zip(found) {
            let of_inputs = node.inputs.iter().filter_map(|name| made.get(name).copied());
            let stage = of_inputs.map(|(stage, by_other): (usize, bool)| match found {
                Found::Convolution(_) => stage + usize::from(by_other),
                Found::Absorbed | Found::Other => stage,
            });
            let stage = stage.max().unwrap_or_default();
            stages.push(stage);
            let by_other = *found == Found::Other;
            made.extend(node.outputs.iter().map(|name| (*name, (stage, by_other))));
        }
        stages
    }

    /// The nodes at these places as a file of their own.
    fn subgraph(&self, file: Message<'a>, places: &[usize]) -> Result<Subgraph, OnnxProblem> {
        let nodes = || places.iter().map(|place| &self.nodes[*place]);
        let made: HashSet<&str> = nodes().flat_map(|node| &node.outputs).copied().collect();
        let read: BTreeSet<&str> =
            nodes().flat_map(|node| &node.inputs).copied().filter(|name| !name.is_empty()).collect();
        let (constants, others): (Vec<&str>, Vec<&str>) =
            read.into_iter().filter(|name| !made.contains(name)).partition(|name| self.constants.contains_key(name));
        let read_here = |name: &str| nodes().flat_map(|node| &node.inputs).filter(|input| **input == name).count();
        let is_needed = |name: &&str| self.readers.get(name).copied().unwrap_or_default() > read_here(name);
        let outputs: Vec<&str> = nodes().flat_map(|node| &node.outputs).copied().filter(is_needed).collect();
        let infos =
            |names: &[&str]| names.iter().map(|name| ValueInfoProto { name: (*name).to_owned(), kind: None }).collect();
        let frame = GraphProto {
            name: "step".to_owned(),
            input: infos(&others),
            output: infos(&outputs),
            ..GraphProto::default()
        };
        let mut graph = frame.encode_to_vec();
        for node in nodes() {
            graph.extend(node.raw);
        }
        for name in constants {
            graph.extend(self.constants[name].raw);
        }
        let mut bytes = Vec::with_capacity(graph.len() + 64);
        for part in file.fields() {
            let part = part?;
            if part.number != field::MODEL_GRAPH && part.number != field::MODEL_METADATA {
                bytes.extend(part.raw);
            }
        }
        append(&mut bytes, field::MODEL_GRAPH, &graph);
        let owned = |names: Vec<&str>| names.into_iter().map(str::to_owned).collect();
        Ok(Subgraph { bytes, inputs: owned(others), outputs: owned(outputs) })
    }
}

/// Window and groups of a convolution whose settings are the same along both axes.
fn window(node: Message<'_>) -> Result<Option<(Window, usize)>, WireError> {
    let mut window = Window { kernel: 0, stride: 1, padding: 0, end_padding: 0, dilation: 1 };
    let mut groups = 1;
    for attribute in node.all(field::NODE_ATTRIBUTE) {
        let attribute = attribute?;
        let list: Vec<usize> = whole_numbers(attribute, field::ATTRIBUTE_INTS)?
            .into_iter()
            .map(|value| usize::try_from(value).unwrap_or(usize::MAX))
            .collect();
        match (text_in(attribute, field::ATTRIBUTE_NAME)?, &list[..]) {
            ("group", []) => {
                groups = usize::try_from(attribute.number(field::ATTRIBUTE_INT)?).unwrap_or(usize::MAX);
            }
            ("kernel_shape", &[height, width]) if height == width => window.kernel = height,
            ("strides", &[y, x]) if x == y && x > 0 => window.stride = x,
            ("dilations", &[y, x]) if x == y && x > 0 => window.dilation = x,
            ("pads", &[top, left, bottom, right]) if top == left && bottom == right && bottom >= top => {
                window.padding = top;
                window.end_padding = bottom - top;
            }
            _ => return Ok(None),
        }
    }
    // Larger settings are refused when a file is read.
    Ok((window.kernel > 0 && window.padding <= MAX_PADDING && groups > 0).then_some((window, groups)))
}

/// More zeros around a map than this has no network of ours.
const MAX_PADDING: usize = 128;

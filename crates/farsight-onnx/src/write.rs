//! From a graph to ONNX operators.

use prost::Message;

use crate::deform::{self, Operands, Sizes};
use crate::head_names::HeadNames;
use crate::parts::{Parts, convolution, float, int, ints, map_info, value_info, word};
use crate::proto::{GraphProto, ModelProto, OperatorSetIdProto, StringStringEntryProto, ValueInfoProto};
use crate::seal::sealed;
use crate::{Facts, INPUT, Target, key, quantized};
use farsight_graph::graph::{FUSION_EPSILON, NORM_EPSILON, Node, NodeId, Op, ParameterId, Window};
use farsight_graph::quantize::{Quantization, QuantizedWeights, Range, WeightRange};
use farsight_graph::transform::{LocalHead, Network};
use farsight_graph::weights::{WeightTensor, WeightsError};

/// ONNX operators as of 1.14: the first with `DeformConv`; `GridSample` still calls its interpolation "bilinear", as
/// all engines know it.
const OPSET: i64 = 19;

/// The file format that goes with it.
const IR_VERSION: i64 = 9;

/// The bytes of an ONNX file that computes the taps of `network`.
///
/// # Shapes
/// One input, `image`, `[batch, 3, height, width]`; one output a tap, named like the tap. Batch, height and width are
/// free; height and width must be multiples of 32.
///
/// # Errors
/// When a weight is missing or has another shape.
pub fn write(network: &Network, facts: &Facts, target: Target) -> Result<Vec<u8>, WeightsError> {
    Ok(sealed(encoded(network, None, facts, target)?))
}

/// As [`write`](fn@write), with what `quantization` says in 8 bits: maps are rounded by a pair of `QuantizeLinear` and
/// `DequantizeLinear`, weights and biases come out of `DequantizeLinear` (QDQ form). An engine that knows the form
/// computes in 8 bits; any other gets the same numbers from the file as it stands.
///
/// # Errors
/// As [`write`](fn@write).
pub fn write_quantized(
    network: &Network,
    quantization: &Quantization,
    facts: &Facts,
    target: Target,
) -> Result<Vec<u8>, WeightsError> {
    Ok(sealed(encoded(network, Some(quantization), facts, target)?))
}

/// The model without the hash that a file has.
pub(crate) fn encoded(
    network: &Network,
    quantization: Option<&Quantization>,
    facts: &Facts,
    target: Target,
) -> Result<Vec<u8>, WeightsError> {
    let (graph, head) = graph(network, quantization, target)?;
    let mut facts = facts.clone();
    if let Some(head) = head {
        facts.set(key::PEAKS_HEAD, head);
    }
    let model = ModelProto {
        ir_version: IR_VERSION,
        producer_name: "farsight".to_owned(),
        producer_version: env!("CARGO_PKG_VERSION").to_owned(),
        graph: Some(graph),
        opset_import: vec![OperatorSetIdProto { domain: String::new(), version: OPSET }],
        metadata_props: facts.entries().map(|(key, value)| StringStringEntryProto { key, value }).collect(),
    };
    Ok(model.encode_to_vec())
}

/// The graph, and where its regression head lies, when it can be computed at single cells.
fn graph(
    network: &Network,
    quantization: Option<&Quantization>,
    target: Target,
) -> Result<(GraphProto, Option<String>), WeightsError> {
    let mut writer = Writer { network, quantization, target, names: Vec::new(), parts: Parts::default() };
    for (id, node) in network.graph.nodes.iter().enumerate() {
        let output = writer.value_name(id);
        let made = writer.node(id, node, &output)?;
        let range = quantization.and_then(|quantization| quantization.range(id));
        let name = range.map_or_else(|| made.clone(), |range| quantized::rounded(&mut writer.parts, &made, range));
        writer.names.push(name);
    }
    let input = vec![image_info(network)];
    let output =
        network.graph.taps.iter().map(|(name, id)| map_info(name, network.graph.nodes[*id].channels)).collect();
    let head = LocalHead::of(network).map(|head| {
        let parameter = |id: ParameterId| network.graph.parameters[id].name.clone();
        let (hidden, output) = (head.hidden.map(parameter), head.output.map(parameter));
        HeadNames { features: writer.names[head.features].clone(), hidden, output }.to_json()
    });
    Ok((GraphProto { name: "farsight".to_owned(), input, output, ..writer.parts.finish() }, head))
}

fn image_info(network: &Network) -> ValueInfoProto {
    let channels = network.graph.nodes.first().map_or(0, |node| node.channels);
    value_info(INPUT, ["batch", "", "height", "width"], channels)
}

struct Writer<'a> {
    network: &'a Network,
    quantization: Option<&'a Quantization>,
    target: Target,
    /// Names of the values of the nodes so far.
    names: Vec<String>,
    parts: Parts,
}

impl Writer<'_> {
    /// A tap's own name, or one that says where in the network the value belongs.
    fn value_name(&self, id: NodeId) -> String {
        let graph = &self.network.graph;
        let tap = graph.taps.iter().find(|(_, tap)| *tap == id);
        tap.map_or_else(|| format!("{}/{id}", graph.nodes[id].stage), |(name, _)| name.clone())
    }

    fn tensor(&self, id: ParameterId) -> Result<&WeightTensor, WeightsError> {
        let parameter = &self.network.graph.parameters[id];
        self.network.weights.tensor(&parameter.name, &parameter.shape)
    }

    /// A parameter as a constant, with this shape instead of its own.
    fn parameter_as(&mut self, id: ParameterId, shape: &[usize]) -> Result<String, WeightsError> {
        let Self { network, parts, .. } = self;
        let parameter = &network.graph.parameters[id];
        let tensor = network.weights.tensor(&parameter.name, &parameter.shape)?;
        Ok(parts.floats(&parameter.name, shape, &tensor.values))
    }

    fn parameter(&mut self, id: ParameterId) -> Result<String, WeightsError> {
        let shape = &self.network.graph.parameters[id].shape;
        self.parameter_as(id, shape)
    }

    /// Writes one node; returns the name of its value.
    fn node(&mut self, id: NodeId, node: &Node, out: &str) -> Result<String, WeightsError> {
        let inputs: Vec<String> = node.inputs.iter().map(|&id| self.names[id].clone()).collect();
        let x = inputs.first().map_or("", String::as_str);
        let all: Vec<&str> = inputs.iter().map(String::as_str).collect();
        Ok(match &node.op {
            Op::Input => INPUT.to_owned(),
            // Engines get the parts before and after a sampler.
            Op::Sampler { .. } => unreachable!("a network that was not cut at its sampler"),
            Op::Conv { weight, bias, window, groups } => {
                let (weight, bias) = self.convolution_parameters(id, *weight, *bias)?;
                let operands: Vec<&str> = [x, &weight].into_iter().chain(bias.as_deref()).collect();
                self.parts.node("Conv", &operands, out, convolution(*window, *groups))
            }
            Op::DeformConv { weight, bias, window } => self.deform_conv(node, [*weight, *bias], *window, out)?,
            Op::UpConv { weight, factor } if let Some(ranges) = self.layer_ranges(id) => {
                let kernels = quantized::phases(&self.tensor(*weight)?.values, *factor);
                let name = self.network.graph.parameters[*weight].name.clone();
                let (channels, factor, weights) = (node.channels, *factor, self.weight_range());
                let target = self.target;
                let up = quantized::UpConv { x, name: &name, kernels: &kernels, channels, factor, weights, target };
                up.write(&mut self.parts, ranges, out)
            }
            Op::UpConv { weight, factor } => {
                let weight = self.parameter(*weight)?;
                let window =
                    Window { kernel: 2 * factor, stride: *factor, padding: factor / 2, end_padding: 0, dilation: 1 };
                self.parts.node("ConvTranspose", &[x, &weight], out, convolution(window, node.channels))
            }
            Op::GroupNorm { groups, weight, bias } => self.group_norm(x, *groups, [*weight, *bias], out)?,
            Op::BatchNorm { weight, bias, mean, variance } => {
                let [weight, bias, mean, variance] = [weight, bias, mean, variance].map(|id| self.parameter(*id));
                let operands = [x, &weight?, &bias?, &mean?, &variance?];
                self.parts.node("BatchNormalization", &operands, out, vec![float("epsilon", NORM_EPSILON as f32)])
            }
            Op::Relu => self.parts.node("Relu", &all, out, Vec::new()),
            Op::Relu6 => {
                let [low, high] = [0.0, 6.0].map(|limit| self.parts.float(limit));
                self.parts.node("Clip", &[x, &low, &high], out, Vec::new())
            }
            Op::Sigmoid => self.parts.node("Sigmoid", &all, out, Vec::new()),
            Op::MaxPool { kernel, stride, padding } => {
                let [kernel, stride] = [kernel, stride].map(|side| [*side as i64; 2]);
                let mut how = vec![ints("kernel_shape", &kernel), ints("strides", &stride)];
                if *padding > 0 {
                    how.push(ints("pads", &[*padding as i64; 4]));
                }
                self.parts.node("MaxPool", &all, out, how)
            }
            Op::GlobalAveragePool => self.parts.node("GlobalAveragePool", &all, out, Vec::new()),
            Op::Upsample { factor } => {
                let factor = *factor as f32;
                let scales = self.parts.floats(&format!("scales {factor}"), &[4], &[1.0, 1.0, factor, factor]);
                let how = vec![word("mode", "linear"), word("coordinate_transformation_mode", "half_pixel")];
                self.parts.node("Resize", &[x, "", &scales], out, how)
            }
            Op::Add => self.parts.node("Add", &all, out, Vec::new()),
            Op::Multiply => self.parts.node("Mul", &all, out, Vec::new()),
            Op::Narrow { start } => {
                let [from, to, axis] = [*start, start + node.channels, 1].map(|place| self.parts.list(&[place as i64]));
                self.parts.node("Slice", &[x, &from, &to, &axis], out, Vec::new())
            }
            Op::Concat => self.parts.node("Concat", &all, out, vec![int("axis", 1)]),
            Op::WeightedSum { weight } => self.weighted_sum(&all, *weight, out)?,
        })
    }

    /// Ranges of the input and of the output of layer `id`, when it computes in 8 bits.
    fn layer_ranges(&self, id: NodeId) -> Option<[Range; 2]> {
        let quantization = self.quantization.filter(|quantization| quantization.has_layer(id))?;
        let input = quantization.range(self.network.graph.nodes[id].inputs[0])?;
        Some([input, quantization.range(id)?])
    }

    fn weight_range(&self) -> WeightRange {
        self.quantization.map(Quantization::weights).unwrap_or_default()
    }

    /// Names of the weight and the bias of the ordinary convolution `id`, in 8 bits if it computes in them.
    fn convolution_parameters(
        &mut self,
        id: NodeId,
        weight: ParameterId,
        bias: Option<ParameterId>,
    ) -> Result<(String, Option<String>), WeightsError> {
        let network = self.network;
        let graph = &network.graph;
        let input = graph.nodes[id].inputs[0];
        let quantization = self.quantization.filter(|quantization| quantization.has_layer(id));
        let Some(range) = quantization.and_then(|quantization| quantization.range(input)) else {
            return Ok((self.parameter(weight)?, bias.map(|id| self.parameter(id)).transpose()?));
        };
        let biases = bias.map(|id| self.tensor(id)).transpose()?.map_or(&[][..], |tensor| &tensor.values);
        let tensor = self.tensor(weight)?;
        let weights =
            QuantizedWeights::new(&tensor.values, biases, tensor.shape[0], range.scale(), self.weight_range());
        let shape = tensor.shape.clone();
        let name = |id: ParameterId| graph.parameters[id].name.as_str();
        let weight = quantized::weight(&mut self.parts, name(weight), &shape, &weights);
        Ok((weight, bias.map(|id| quantized::bias(&mut self.parts, name(id), &weights))))
    }

    fn deform_conv(
        &mut self,
        node: &Node,
        [weight, bias]: [ParameterId; 2],
        window: Window,
        out: &str,
    ) -> Result<String, WeightsError> {
        let graph = &self.network.graph;
        let [x, offsets] = [0, 1].map(|input| node.inputs[input]);
        let taps = window.kernel * window.kernel;
        let groups = graph.nodes[offsets].channels / (3 * taps);
        let sizes = Sizes { channels: graph.nodes[x].channels, groups, window };
        let weight = match self.target {
            Target::OnnxRuntime => self.parameter(weight)?,
            Target::Portable => self.parameter_as(weight, &[node.channels, sizes.channels * taps, 1, 1])?,
        };
        let bias = self.parameter(bias)?;
        let operands = Operands { x: &self.names[x], offsets: &self.names[offsets], weight: &weight, bias: &bias };
        Ok(match self.target {
            Target::OnnxRuntime => deform::operator(&mut self.parts, operands, sizes, convolution(window, 1), out),
            Target::Portable => deform::samples(&mut self.parts, operands, sizes, out),
        })
    }

    /// Group norm is instance norm over maps as high as all channels of a group together. Engines compute its mean
    /// first and then the squares of the differences, so large means do no harm.
    fn group_norm(
        &mut self,
        x: &str,
        groups: usize,
        [weight, bias]: [ParameterId; 2],
        out: &str,
    ) -> Result<String, WeightsError> {
        let channels = self.network.graph.parameters[weight].shape[0];
        let weight = self.parameter_as(weight, &[channels, 1, 1])?;
        let bias = self.parameter_as(bias, &[channels, 1, 1])?;
        let parts = &mut self.parts;
        let ones = parts.floats(&format!("ones {groups}"), &[groups], &vec![1.0; groups]);
        let zeros = parts.floats(&format!("zeros {groups}"), &[groups], &vec![0.0; groups]);
        let [by_group, by_channel] = [groups, channels].map(|count| parts.list(&[0, count as i64, -1, 0]));
        let step = |name: &str| format!("{out}/{name}");
        let grouped = parts.node("Reshape", &[x, &by_group], &step("grouped"), Vec::new());
        let epsilon = vec![float("epsilon", NORM_EPSILON as f32)];
        let normal = parts.node("InstanceNormalization", &[&grouped, &ones, &zeros], &step("normal"), epsilon);
        let apart = parts.node("Reshape", &[&normal, &by_channel], &step("apart"), Vec::new());
        let scaled = parts.node("Mul", &[&apart, &weight], &step("scaled"), Vec::new());
        Ok(parts.node("Add", &[&scaled, &bias], out, Vec::new()))
    }

    /// The weights are known by now: each input times its share.
    fn weighted_sum(&mut self, inputs: &[&str], weight: ParameterId, out: &str) -> Result<String, WeightsError> {
        let positive: Vec<f64> = self.tensor(weight)?.values.iter().map(|&w| f64::from(w.max(0.0))).collect();
        let sum = positive.iter().sum::<f64>() + FUSION_EPSILON;
        let parts = &mut self.parts;
        let mut total: Option<String> = None;
        for (i, (input, weight)) in inputs.iter().zip(&positive).enumerate() {
            let share = parts.float((weight / sum) as f32);
            let term = parts.node("Mul", &[input, &share], &format!("{out}/term{i}"), Vec::new());
            let name = if i + 1 == inputs.len() { out.to_owned() } else { format!("{out}/sum{i}") };
            total = Some(match total {
                None => term,
                Some(total) => parts.node("Add", &[&total, &term], &name, Vec::new()),
            });
        }
        Ok(total.unwrap_or_default())
    }
}

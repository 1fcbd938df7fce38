//! Runs a graph on libtorch, with gradients.

use std::collections::BTreeMap;

use farsight_graph::graph::{FUSION_EPSILON, Graph, NORM_EPSILON, Node, NodeId, Op, ParameterId, Role, Window};
use farsight_graph::weights::{WeightTensor, Weights};
use serde::{Deserialize, Serialize};
use tch::kind::Element;
use tch::{Device, Kind, Tensor, no_grad};
use thiserror::Error;

use crate::deform::deformable_samples;

/// Share of the new batch in the running statistics of batch norm.
const BATCH_NORM_MOMENTUM: f64 = 0.1;

/// What a pass is for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Mode {
    /// Batch norm uses the batch and updates its running statistics, unless those are frozen: then they are used as
    /// they are.
    Train,
    /// The same, with the batch counting for this share of the statistics.
    Gather {
        /// 1 forgets what was before; one over the number of batches so far makes a mean of them.
        share: f64,
    },
    /// Batch norm uses its running statistics.
    Evaluate,
}

/// In which numbers the maps between the layers are computed.
///
/// Weights, norms, outputs and losses are in single precision, or in double where the maps are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// Single precision.
    #[default]
    F32,
    /// bfloat16 (mixed precision), with the channels of a pixel side by side: what the matrix units of CPUs and GPUs
    /// are made for.
    Bf16,
    /// Double precision throughout, for tests: they test formulas, not rounding.
    ///
    /// No config can ask for it: files hold weights in single precision, so a run could not go on where it stopped.
    #[serde(skip)]
    F64,
}

impl Precision {
    /// The kind of numbers between the layers.
    fn kind(self) -> Kind {
        match self {
            Self::F32 => Kind::Float,
            Self::Bf16 => Kind::BFloat16,
            Self::F64 => Kind::Double,
        }
    }

    /// The kind of weights, norms and outputs.
    fn wide_kind(self) -> Kind {
        wide_kind(self.kind())
    }

    /// An input or a parameter in the order in which the layers want its numbers; they hand that order on to what they
    /// compute, gradients too.
    fn arranged(self, tensor: &Tensor) -> Tensor {
        match self {
            Self::Bf16 if tensor.dim() == 4 => tensor.permute([0, 2, 3, 1]).contiguous().permute([0, 3, 1, 2]),
            _ => tensor.shallow_clone(),
        }
    }
}

/// Whether a device multiplies bfloat16 by itself. A CPU that does not emulates it, tens of times slower than single
/// precision.
pub fn has_bf16(device: Device) -> bool {
    match device {
        #[cfg(target_arch = "x86_64")]
        Device::Cpu => std::arch::is_x86_feature_detected!("avx512bf16"),
        #[cfg(target_arch = "aarch64")]
        Device::Cpu => std::arch::is_aarch64_feature_detected!("bf16"),
        #[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
        Device::Cpu => false,
        _ => true,
    }
}

/// What numbers of this kind are summed in: double precision stays, all else becomes single.
pub fn wide_kind(kind: Kind) -> Kind {
    if kind == Kind::Double { Kind::Double } else { Kind::Float }
}

/// Weights that do not fit the network.
#[derive(Debug, Error)]
pub enum ExecutorError {
    /// A tensor is missing.
    #[error("tensor \"{0}\" is missing from the weights")]
    Missing(String),
    /// A tensor has another shape.
    #[error("tensor \"{name}\" has shape {found:?}; the network expects {expected:?}")]
    Shape {
        /// Its name.
        name: String,
        /// Its shape in the weights.
        found: Vec<usize>,
        /// Its shape in the network.
        expected: Vec<usize>,
    },
}

/// A graph with its parameters on a device.
#[derive(Debug)]
pub struct Network {
    graph: Graph,
    parameters: Vec<Tensor>,
    consumers: Vec<usize>,
    precision: Precision,
}

impl Network {
    /// Puts `graph` with `weights` on `device`.
    ///
    /// # Errors
    /// When a parameter is missing from the weights or has another shape there.
    pub fn new(graph: Graph, weights: &Weights, device: Device, precision: Precision) -> Result<Self, ExecutorError> {
        let parameter = |p: &farsight_graph::graph::Parameter| {
            let tensor = weights.tensors.get(&p.name).ok_or_else(|| ExecutorError::Missing(p.name.clone()))?;
            if tensor.shape != p.shape {
                let (found, expected) = (tensor.shape.clone(), p.shape.clone());
                return Err(ExecutorError::Shape { name: p.name.clone(), found, expected });
            }
            let shape: Vec<i64> = p.shape.iter().map(|&s| s as i64).collect();
            let tensor = Tensor::from_slice(&tensor.values).view(shape.as_slice()).to_kind(precision.wide_kind());
            let tensor = tensor.to_device(device);
            Ok(precision.arranged(&tensor).set_requires_grad(p.role == Role::Learnt))
        };
        let parameters = graph.parameters.iter().map(parameter).collect::<Result<_, _>>()?;
        let consumers = graph.consumers();
        Ok(Self { graph, parameters, consumers, precision })
    }

    /// The same network on the same tensors.
    #[must_use]
    pub fn share(&self) -> Self {
        let parameters = self.parameters.iter().map(Tensor::shallow_clone).collect();
        Self { graph: self.graph.clone(), parameters, consumers: self.consumers.clone(), precision: self.precision }
    }

    /// The graph.
    pub fn graph(&self) -> &Graph {
        &self.graph
    }

    /// Where the parameters are.
    pub fn device(&self) -> Device {
        self.parameters.first().map_or(Device::Cpu, Tensor::device)
    }

    /// Name and tensor of every learnt parameter, in the order of the graph.
    pub fn trainable_parameters(&self) -> impl Iterator<Item = (&str, &Tensor)> {
        let pairs = self.graph.parameters.iter().zip(&self.parameters);
        pairs.filter(|(p, _)| p.role == Role::Learnt).map(|(p, t)| (p.name.as_str(), t))
    }

    /// Name and tensor of every parameter, learnt or gathered, in the order of the graph.
    pub fn parameters(&self) -> impl Iterator<Item = (&str, &Tensor)> {
        self.graph.parameters.iter().zip(&self.parameters).map(|(p, t)| (p.name.as_str(), t))
    }

    /// All parameters, copied to main memory.
    pub fn weights(&self) -> Weights {
        let tensors = self.parameters().map(|(name, tensor)| (name.to_owned(), weight_from_tensor(tensor))).collect();
        Weights { tensors, metadata: BTreeMap::new() }
    }

    /// Computes the nodes `wanted` for `input` `[batch, 3, height, width]`.
    ///
    /// Maps are let go as soon as their last reader is done, unless the gradient needs them.
    pub fn forward(&self, input: &Tensor, mode: Mode, wanted: &[NodeId]) -> Vec<Tensor> {
        self.forward_from(std::slice::from_ref(input), mode, wanted)
    }

    /// As [`Network::forward`], for a graph with several inputs, in the order of its input nodes.
    pub fn forward_from(&self, inputs: &[Tensor], mode: Mode, wanted: &[NodeId]) -> Vec<Tensor> {
        self.forward_through(inputs, &|_, _| unreachable!("a graph with a sampler, run without one"), mode, wanted)
    }

    /// As [`Network::forward_from`]; `sampler` is what stands between the parts of a graph ([`Op::Sampler`]): it gets
    /// the number of the place, from 0, and the maps that are read there.
    pub fn forward_through(
        &self,
        inputs: &[Tensor],
        sampler: &dyn Fn(usize, &[Tensor]) -> Tensor,
        mode: Mode,
        wanted: &[NodeId],
    ) -> Vec<Tensor> {
        let mut inputs = inputs.iter();
        let mut places = 0..;
        let mut pending = self.consumers.clone();
        for &id in wanted {
            pending[id] += 1;
        }
        let last = wanted.iter().copied().max().unwrap_or(0);
        let mut maps: Vec<Option<Tensor>> = Vec::with_capacity(last + 1);
        for (id, node) in self.graph.nodes[..=last].iter().enumerate() {
            let kind = if wanted.contains(&id) { self.precision.wide_kind() } else { self.precision.kind() };
            let output = match node.op {
                Op::Input => inputs.next().map(|input| self.precision.arranged(&input.to_kind(kind))),
                Op::Sampler { .. } => {
                    let read: Vec<Tensor> =
                        node.inputs.iter().filter_map(|&id| Some(maps[id].as_ref()?.shallow_clone())).collect();
                    places.next().map(|place| self.precision.arranged(&sampler(place, &read).to_kind(kind)))
                }
                _ => Some(self.compute(node, kind, &maps, &pending, mode)),
            };
            maps.push(output);
            for &input in &node.inputs {
                pending[input] -= 1;
                if pending[input] == 0 {
                    maps[input] = None;
                }
            }
        }
        wanted.iter().filter_map(|&id| maps[id].as_ref().map(|map| map.to_kind(self.precision.wide_kind()))).collect()
    }

    /// Computes one node; convolutions in numbers of this kind.
    fn compute(&self, node: &Node, kind: Kind, maps: &[Option<Tensor>], pending: &[usize], mode: Mode) -> Tensor {
        // The order of nodes and the count of readers guarantee that every input is still there.
        let input =
            |i: usize| maps[node.inputs[i]].as_ref().unwrap_or_else(|| unreachable!("node reads a map that is gone"));
        let x = input(0);
        let operand = |id: ParameterId| self.tensor(id).to_kind(kind);
        match &node.op {
            Op::Input | Op::Sampler { .. } => x.shallow_clone(),
            Op::Conv { weight, bias, window, groups } => {
                let (stride, padding) = ([window.stride as i64; 2], [window.padding as i64; 2]);
                let dilation = [window.dilation as i64; 2];
                let bias = bias.map(operand);
                let x = window_ended(x, *window).to_kind(kind);
                x.conv2d(&operand(*weight), bias, stride, padding, dilation, *groups as i64)
            }
            Op::DeformConv { weight, bias, window } => {
                let samples = Self::deformed(x, input(1), *window).to_kind(kind);
                let weight = operand(*weight);
                let kernel = weight.reshape([weight.size()[0], -1, 1, 1]);
                samples.conv2d(&kernel, Some(operand(*bias)), [1; 2], [0; 2], [1; 2], 1)
            }
            Op::UpConv { weight, factor } => {
                let factor = *factor as i64;
                let (stride, padding, groups) = ([factor; 2], [factor / 2; 2], node.channels as i64);
                let no_bias = None::<Tensor>;
                let x = x.to_kind(kind);
                x.conv_transpose2d(&operand(*weight), no_bias, stride, padding, [0; 2], groups, [1; 2])
            }
            Op::GroupNorm { groups, weight, bias } => {
                let x = x.to_kind(self.precision.wide_kind());
                x.group_norm(*groups as i64, Some(self.tensor(*weight)), Some(self.tensor(*bias)), NORM_EPSILON, true)
            }
            Op::BatchNorm { weight, bias, mean, variance } => {
                let is_frozen = self.graph.parameters[*mean].role == Role::Frozen;
                let [weight, bias, mean, variance] = [weight, bias, mean, variance].map(|id| Some(self.tensor(*id)));
                let training = mode != Mode::Evaluate && !is_frozen;
                let momentum = if let Mode::Gather { share } = mode { share } else { BATCH_NORM_MOMENTUM };
                x.batch_norm(weight, bias, mean, variance, training, momentum, NORM_EPSILON, true)
            }
            // Nobody else reads this map and nothing that makes it needs its own output for the gradient: no second
            // copy.
            Op::Relu if pending[node.inputs[0]] == 1 && self.may_overwrite(node.inputs[0]) => x.shallow_clone().relu_(),
            Op::Relu => x.relu(),
            Op::Relu6 if pending[node.inputs[0]] == 1 && self.may_overwrite(node.inputs[0]) => {
                x.shallow_clone().relu6_()
            }
            Op::Relu6 => x.relu6(),
            Op::Sigmoid => x.sigmoid(),
            Op::MaxPool { kernel, stride, padding } => {
                let [kernel, stride, padding] = [kernel, stride, padding].map(|side| [*side as i64; 2]);
                x.max_pool2d(kernel, stride, padding, [1; 2], false)
            }
            Op::GlobalAveragePool => x.adaptive_avg_pool2d([1, 1]),
            Op::Upsample { factor } => {
                let size = x.size();
                let size = [size[2] * *factor as i64, size[3] * *factor as i64];
                x.upsample_bilinear2d(size, false, None, None)
            }
            Op::Add => x + input(1),
            Op::Multiply => x * input(1),
            Op::Narrow { start } => x.narrow(1, *start as i64, node.channels as i64),
            Op::Concat => Tensor::cat(&(0..node.inputs.len()).map(input).collect::<Vec<_>>(), 1),
            Op::WeightedSum { weight } => {
                let weights = self.tensor(*weight).relu();
                let weights = &weights / (weights.sum(self.precision.wide_kind()) + FUSION_EPSILON);
                let term = |i: usize| input(i) * weights.select(0, i as i64);
                (1..node.inputs.len()).fold(term(0), |sum, i| sum + term(i))
            }
        }
    }

    /// The samples at the displaced taps, which a 1x1 convolution over channels and taps makes a deformable
    /// convolution.
    fn deformed(x: &Tensor, offsets: &Tensor, window: Window) -> Tensor {
        let [x, offsets] = [x, offsets].map(|map| map.to_kind(wide_kind(map.kind())).contiguous());
        let taps = offsets.size()[1] / 3;
        let offset = offsets.narrow(1, 0, 2 * taps);
        let mask = offsets.narrow(1, 2 * taps, taps).sigmoid();
        deformable_samples(&x, &offset, &mask, window)
    }

    fn may_overwrite(&self, id: NodeId) -> bool {
        matches!(self.graph.nodes[id].op, Op::GroupNorm { .. } | Op::BatchNorm { .. } | Op::Add | Op::Conv { .. })
    }

    fn tensor(&self, id: ParameterId) -> &Tensor {
        &self.parameters[id]
    }
}

/// `x` with the zeros at its right and bottom that a convolution does not add by itself.
fn window_ended(x: &Tensor, window: Window) -> Tensor {
    match window.end_padding as i64 {
        0 => x.shallow_clone(),
        zeros => x.constant_pad_nd([0, zeros, 0, zeros]),
    }
}

/// A tensor's values in main memory.
pub fn weight_from_tensor(tensor: &Tensor) -> WeightTensor {
    let shape = tensor.size().iter().map(|&s| s as usize).collect();
    WeightTensor { shape, values: values_from_tensor(tensor) }
}

/// Copies the tensor of this name into `place`, which keeps the order of its numbers in memory.
///
/// # Errors
/// The name, when there is no such tensor or it has another shape.
pub fn fill(place: &mut Tensor, weights: &Weights, name: &str) -> Result<(), String> {
    let has_its_shape = |tensor: &&WeightTensor| tensor.shape.iter().map(|&s| s as i64).eq(place.size());
    let tensor = weights.tensors.get(name).filter(has_its_shape).ok_or(name)?;
    no_grad(|| place.copy_(&Tensor::from_slice(&tensor.values).view(place.size().as_slice())));
    Ok(())
}

/// A tensor's values, last axis fastest.
pub fn values_from_tensor(tensor: &Tensor) -> Vec<f32> {
    copied(tensor, Kind::Float)
}

/// A tensor's values in double precision, last axis fastest.
pub fn doubles_from_tensor(tensor: &Tensor) -> Vec<f64> {
    copied(tensor, Kind::Double)
}

/// The values of `tensor` as numbers of `kind`, which is that of `T`.
fn copied<T: Element + Default + Clone>(tensor: &Tensor, kind: Kind) -> Vec<T> {
    let flat = no_grad(|| tensor.to_kind(kind).to_device(Device::Cpu).contiguous().view(-1));
    let mut values = vec![T::default(); flat.numel()];
    flat.copy_data(&mut values, flat.numel());
    values
}

//! Runs a graph on libtorch, with gradients.

use std::collections::BTreeMap;

use farsight_net::graph::{FUSION_EPSILON, Graph, NORM_EPSILON, Node, NodeId, Op, ParameterId, Role};
use farsight_net::weights::{WeightTensor, Weights};
use serde::{Deserialize, Serialize};
use tch::{Device, Kind, Tensor, no_grad};
use thiserror::Error;

use crate::deform::deformable_samples;

/// Share of the new batch in the running statistics of batch norm.
const BATCH_NORM_MOMENTUM: f64 = 0.1;

/// What a pass is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// Batch norm uses the batch and updates its running statistics.
    Train,
    /// Batch norm uses its running statistics.
    Evaluate,
}

/// In which numbers convolutions are computed; weights, norms and losses stay in single precision.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// Single precision.
    #[default]
    F32,
    /// bfloat16 convolutions (mixed precision).
    Bf16,
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
        let parameter = |p: &farsight_net::graph::Parameter| {
            let tensor = weights.tensors.get(&p.name).ok_or_else(|| ExecutorError::Missing(p.name.clone()))?;
            if tensor.shape != p.shape {
                let (found, expected) = (tensor.shape.clone(), p.shape.clone());
                return Err(ExecutorError::Shape { name: p.name.clone(), found, expected });
            }
            let shape: Vec<i64> = p.shape.iter().map(|&s| s as i64).collect();
            let tensor = Tensor::from_slice(&tensor.values).view(shape.as_slice()).to_device(device);
            Ok(tensor.set_requires_grad(p.role == Role::Learnt))
        };
        let parameters = graph.parameters.iter().map(parameter).collect::<Result<_, _>>()?;
        let consumers = graph.consumers();
        Ok(Self { graph, parameters, consumers, precision })
    }

    /// The graph.
    pub fn graph(&self) -> &Graph {
        &self.graph
    }

    /// Name and tensor of every learnt parameter, in the order of the graph.
    pub fn learnt(&self) -> impl Iterator<Item = (&str, &Tensor)> {
        let pairs = self.graph.parameters.iter().zip(&self.parameters);
        pairs.filter(|(p, _)| p.role == Role::Learnt).map(|(p, t)| (p.name.as_str(), t))
    }

    /// All parameters, copied to main memory.
    pub fn weights(&self) -> Weights {
        let pairs = self.graph.parameters.iter().zip(&self.parameters);
        let tensors = pairs.map(|(p, t)| (p.name.clone(), weight_from_tensor(t))).collect();
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
        let mut inputs = inputs.iter();
        let mut pending = self.consumers.clone();
        for &id in wanted {
            pending[id] += 1;
        }
        let last = wanted.iter().copied().max().unwrap_or(0);
        let mut maps: Vec<Option<Tensor>> = Vec::with_capacity(last + 1);
        for node in &self.graph.nodes[..=last] {
            let output = match node.op {
                Op::Input => inputs.next().map(Tensor::shallow_clone),
                _ => Some(self.compute(node, &maps, &pending, mode)),
            };
            maps.push(output);
            for &input in &node.inputs {
                pending[input] -= 1;
                if pending[input] == 0 {
                    maps[input] = None;
                }
            }
        }
        wanted.iter().filter_map(|&id| maps[id].as_ref().map(Tensor::shallow_clone)).collect()
    }

    fn compute(&self, node: &Node, maps: &[Option<Tensor>], pending: &[usize], mode: Mode) -> Tensor {
        // The order of nodes and the count of readers guarantee that every input is still there.
        let input =
            |i: usize| maps[node.inputs[i]].as_ref().unwrap_or_else(|| unreachable!("node reads a map that is gone"));
        let x = input(0);
        match &node.op {
            Op::Input => x.shallow_clone(),
            Op::Conv { weight, bias, window, groups } => {
                let (stride, padding) = ([window.stride as i64; 2], [window.padding as i64; 2]);
                let dilation = [window.dilation as i64; 2];
                let bias = bias.map(|id| self.operand(id));
                self.cast(x).conv2d(&self.operand(*weight), bias, stride, padding, dilation, *groups as i64)
            }
            Op::DeformConv { weight, bias, window } => self.deform_conv(x, input(1), *weight, *bias, *window),
            Op::UpConv { weight, factor } => {
                let factor = *factor as i64;
                let (stride, padding, groups) = ([factor; 2], [factor / 2; 2], node.channels as i64);
                let no_bias = None::<Tensor>;
                self.cast(x).conv_transpose2d(&self.operand(*weight), no_bias, stride, padding, [0; 2], groups, [1; 2])
            }
            Op::GroupNorm { groups, weight, bias } => {
                let x = x.to_kind(Kind::Float);
                x.group_norm(*groups as i64, Some(self.tensor(*weight)), Some(self.tensor(*bias)), NORM_EPSILON, true)
            }
            Op::BatchNorm { weight, bias, mean, variance } => {
                let [weight, bias, mean, variance] = [weight, bias, mean, variance].map(|id| Some(self.tensor(*id)));
                let training = mode == Mode::Train;
                let x = x.to_kind(Kind::Float);
                x.batch_norm(weight, bias, mean, variance, training, BATCH_NORM_MOMENTUM, NORM_EPSILON, true)
            }
            // Nobody else reads this map and nothing that makes it needs its own output for the gradient: no second copy.
            Op::Relu if pending[node.inputs[0]] == 1 && self.may_overwrite(node.inputs[0]) => x.shallow_clone().relu_(),
            Op::Relu => x.relu(),
            Op::Sigmoid => x.sigmoid(),
            Op::MaxPool { size } => {
                let size = [*size as i64; 2];
                x.max_pool2d(size, size, [0; 2], [1; 2], false)
            }
            Op::GlobalAveragePool => x.adaptive_avg_pool2d([1, 1]),
            Op::Upsample { factor } => {
                let size = x.size();
                let size = [size[2] * *factor as i64, size[3] * *factor as i64];
                x.upsample_bilinear2d(size, false, None, None)
            }
            Op::Add => x + input(1),
            Op::Multiply => x * input(1),
            Op::Concat => Tensor::cat(&(0..node.inputs.len()).map(input).collect::<Vec<_>>(), 1),
            Op::WeightedSum { weight } => {
                let weights = self.tensor(*weight).relu();
                let weights = &weights / (weights.sum(Kind::Float) + FUSION_EPSILON);
                let term = |i: usize| input(i) * weights.select(0, i as i64);
                (1..node.inputs.len()).fold(term(0), |sum, i| sum + term(i))
            }
        }
    }

    /// Samples at the displaced taps, then an ordinary 1x1 convolution over channels and taps.
    fn deform_conv(
        &self,
        x: &Tensor,
        offsets: &Tensor,
        weight: ParameterId,
        bias: ParameterId,
        window: farsight_net::graph::Window,
    ) -> Tensor {
        let offsets = offsets.to_kind(Kind::Float);
        let taps = offsets.size()[1] / 3;
        let offset = offsets.narrow(1, 0, 2 * taps);
        let mask = offsets.narrow(1, 2 * taps, taps).sigmoid();
        let samples = deformable_samples(&x.to_kind(Kind::Float), &offset, &mask, window);
        let weight = self.operand(weight);
        let channels = weight.size()[0];
        let kernel = weight.view([channels, -1, 1, 1]);
        self.cast(&samples).conv2d(&kernel, Some(self.operand(bias)), [1; 2], [0; 2], [1; 2], 1)
    }

    fn may_overwrite(&self, id: NodeId) -> bool {
        matches!(self.graph.nodes[id].op, Op::GroupNorm { .. } | Op::BatchNorm { .. } | Op::Add | Op::Conv { .. })
    }

    fn tensor(&self, id: ParameterId) -> &Tensor {
        &self.parameters[id]
    }

    /// A parameter as convolutions want it.
    fn operand(&self, id: ParameterId) -> Tensor {
        self.cast(&self.parameters[id])
    }

    fn cast(&self, x: &Tensor) -> Tensor {
        match self.precision {
            Precision::F32 => x.shallow_clone(),
            Precision::Bf16 => x.to_kind(Kind::BFloat16),
        }
    }
}

/// A tensor's values in main memory.
pub fn weight_from_tensor(tensor: &Tensor) -> WeightTensor {
    let shape = tensor.size().iter().map(|&s| s as usize).collect();
    WeightTensor { shape, values: values_from_tensor(tensor) }
}

/// A tensor's values, last axis fastest.
pub fn values_from_tensor(tensor: &Tensor) -> Vec<f32> {
    let flat = no_grad(|| tensor.to_kind(Kind::Float).to_device(Device::Cpu).contiguous().view(-1));
    let mut values = vec![0.0; flat.numel()];
    flat.copy_data(&mut values, flat.numel());
    values
}

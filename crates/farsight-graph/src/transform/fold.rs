//! Batch norm as part of the convolution before it.

use super::Network;
use crate::graph::{Graph, Init, NORM_EPSILON, NodeId, Op, Parameter, ParameterId, Role};
use crate::weights::{WeightTensor, Weights, WeightsError};

/// Folds every batch norm that can be; the convolutions that stood before them are dead afterwards.
pub(super) fn batch_norm_folded(network: Network) -> Result<Network, WeightsError> {
    let Network { mut graph, mut weights, local_head } = network;
    let readers = readers(&graph);
    for id in 0..graph.nodes.len() {
        let Op::BatchNorm { weight, bias, mean, variance } = graph.nodes[id].op else { continue };
        let source = graph.nodes[id].inputs[0];
        if readers[source] > 1 {
            continue;
        }
        let Some((kernel, old_bias)) = convolution(&graph.nodes[source].op) else { continue };
        if uses(&graph, kernel) > 1 || old_bias.is_some_and(|bias| uses(&graph, bias) > 1) {
            continue;
        }
        let [weight, bias, mean, variance] = [weight, bias, mean, variance].map(|id| values(&graph, &weights, id));
        values(&graph, &weights, kernel)?;
        let line = Line::new(weight?, bias?, mean?, variance?);
        let new_bias = old_bias.unwrap_or_else(|| add_bias(&mut graph, &mut weights, kernel));
        scale_kernel(&graph, &mut weights, kernel, &line);
        shift_bias(&graph, &mut weights, new_bias, &line);
        move_convolution(&mut graph, source, id, new_bias);
    }
    Ok(Network { graph, weights, local_head })
}

/// What a batch norm does to each channel: `scale x + shift`.
struct Line {
    scale: Vec<f64>,
    shift: Vec<f64>,
}

impl Line {
    fn new(weight: &[f32], bias: &[f32], mean: &[f32], variance: &[f32]) -> Self {
        let scale: Vec<f64> =
            weight.iter().zip(variance).map(|(w, v)| f64::from(*w) / (f64::from(*v) + NORM_EPSILON).sqrt()).collect();
        let centred = bias.iter().zip(mean).zip(&scale);
        let shift = centred.map(|((bias, mean), scale)| f64::from(*bias) - f64::from(*mean) * scale).collect();
        Self { scale, shift }
    }
}

/// How many nodes and taps read each node.
fn readers(graph: &Graph) -> Vec<usize> {
    let mut readers = graph.consumers();
    graph.taps.iter().for_each(|(_, id)| readers[*id] += 1);
    readers
}

/// Kernel and bias, when this is a convolution that a norm can join.
fn convolution(op: &Op) -> Option<(ParameterId, Option<ParameterId>)> {
    match op {
        Op::Conv { weight, bias, .. } => Some((*weight, *bias)),
        Op::DeformConv { weight, bias, .. } => Some((*weight, Some(*bias))),
        _ => None,
    }
}

fn uses(graph: &Graph, parameter: ParameterId) -> usize {
    graph.nodes.iter().flat_map(|node| node.op.parameters()).filter(|id| *id == parameter).count()
}

fn values<'a>(graph: &Graph, weights: &'a Weights, id: ParameterId) -> Result<&'a [f32], WeightsError> {
    let Parameter { name, shape, .. } = &graph.parameters[id];
    Ok(&weights.tensor(name, shape)?.values)
}

/// A bias of zeros for the convolution with this kernel.
fn add_bias(graph: &mut Graph, weights: &mut Weights, kernel: ParameterId) -> ParameterId {
    let Parameter { name, shape, stage, .. } = &graph.parameters[kernel];
    let (name, shape) = (format!("{}.bias", name.trim_end_matches(".weight")), vec![shape[0]]);
    weights.tensors.insert(name.clone(), WeightTensor { values: vec![0.0; shape[0]], shape: shape.clone() });
    let parameter = Parameter { name, shape, init: Init::Constant(0.0), role: Role::Learnt, stage };
    graph.parameters.push(parameter);
    graph.parameters.len() - 1
}

fn scale_kernel(graph: &Graph, weights: &mut Weights, kernel: ParameterId, line: &Line) {
    let Some(tensor) = weights.tensors.get_mut(&graph.parameters[kernel].name) else { return };
    let fan_in = tensor.values.len() / line.scale.len().max(1);
    for (row, scale) in tensor.values.chunks_exact_mut(fan_in.max(1)).zip(&line.scale) {
        for value in row {
            *value = (f64::from(*value) * scale) as f32;
        }
    }
}

fn shift_bias(graph: &Graph, weights: &mut Weights, bias: ParameterId, line: &Line) {
    let Some(tensor) = weights.tensors.get_mut(&graph.parameters[bias].name) else { return };
    for ((value, scale), shift) in tensor.values.iter_mut().zip(&line.scale).zip(&line.shift) {
        *value = (f64::from(*value) * scale + shift) as f32;
    }
}

/// Puts the convolution where its norm stood, so that the norm's readers now read the convolution.
fn move_convolution(graph: &mut Graph, from: NodeId, to: NodeId, new_bias: ParameterId) {
    let mut node = graph.nodes[from].clone();
    match &mut node.op {
        Op::Conv { bias, .. } => *bias = Some(new_bias),
        Op::DeformConv { bias, .. } => *bias = new_bias,
        _ => {}
    }
    graph.nodes[to] = node;
}

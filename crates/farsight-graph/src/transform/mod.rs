//! Transforms: from a network with its weights to one that computes the same with less.

mod fold;
mod local_head;

use std::ops::Range;

pub use local_head::LocalHead;

use crate::graph::{Graph, NodeId, Op};
use crate::live::{without_dead_nodes, without_dead_parameters};
use crate::model::{Model, NetworkConfig};
use crate::weights::{Weights, WeightsError};

/// A graph with its weights, as the transforms hand it on. It need not be one that a config describes.
#[derive(Debug, Clone, PartialEq)]
pub struct Network {
    /// The nodes.
    pub graph: Graph,
    /// A tensor for every parameter of the graph.
    pub weights: Weights,
    /// The tap whose head may be computed at single cells.
    pub local_head: Option<&'static str>,
}

impl Network {
    /// The network of a model, untouched.
    pub fn new<C: NetworkConfig>(model: &Model<C>) -> Self {
        Self { graph: model.graph.clone(), weights: model.weights.clone(), local_head: C::LOCAL_HEAD }
    }

    /// The form in which a model is deployed: its outputs only, batch norm folded, nothing that no output needs.
    ///
    /// # Errors
    /// When a weight is missing or has another shape.
    pub fn deployable<C: NetworkConfig>(model: &Model<C>) -> Result<Self, WeightsError> {
        Self::new(model).with_outputs(C::OUTPUTS).batch_norm_folded()
    }

    /// Only the taps named in `outputs`, and what they need: dead nodes and parameters go.
    pub fn with_outputs(mut self, outputs: &[&str]) -> Self {
        self.graph.taps.retain(|(name, _)| outputs.contains(&name.as_str()));
        without_dead(self)
    }

    /// The parts that engines run one after the other, for the taps named in `outputs`: the whole network, or what is
    /// before its first sampler and what comes after each. The input of a later part is what its sampler makes. The
    /// taps of a part are the maps in it that samplers behind it read, in their order, then its outputs.
    pub fn parts(self, outputs: &[&str]) -> Vec<Self> {
        let nodes = &self.graph.nodes;
        let samplers = || (0..nodes.len()).filter(|&id| matches!(nodes[id].op, Op::Sampler { .. }));
        let starts: Vec<NodeId> = std::iter::once(0).chain(samplers()).collect();
        if starts.len() == 1 {
            return vec![self.with_outputs(outputs)];
        }
        let ends = starts[1..].iter().copied().chain([nodes.len()]);
        let read: Vec<NodeId> = samplers().flat_map(|id| nodes[id].inputs.iter().copied()).collect();
        let wanted = outputs.iter().filter_map(|name| self.graph.tap(name));
        let shown: Vec<NodeId> = read.into_iter().chain(wanted).collect();
        starts.iter().zip(ends).map(|(&start, end)| self.part(start..end, &shown)).collect()
    }

    /// These nodes, of which the first is an input, with a tap at each node of `shown` that is among them.
    fn part(&self, nodes: Range<NodeId>, shown: &[NodeId]) -> Self {
        let mut part = self.clone();
        part.graph.nodes = part.graph.nodes[nodes.clone()].to_vec();
        part.graph.nodes[0].op = Op::Input;
        part.graph.nodes[0].inputs.clear();
        part.graph.nodes.iter_mut().flat_map(|node| &mut node.inputs).for_each(|id| *id -= nodes.start);
        let tap = |id: NodeId| {
            let (name, _) = self.graph.taps.iter().find(|(_, tapped)| *tapped == id)?;
            Some((name.clone(), id - nodes.start))
        };
        part.graph.taps.clear();
        for tap in shown.iter().filter(|id| nodes.contains(id)).filter_map(|id| tap(*id)) {
            if !part.graph.taps.contains(&tap) {
                part.graph.taps.push(tap);
            }
        }
        without_dead(part)
    }

    /// Batch norms become part of the convolution before them, which gains a bias.
    ///
    /// A norm stays where something else reads the convolution too, or where no convolution is before it.
    ///
    /// # Errors
    /// When a weight is missing or has another shape.
    pub fn batch_norm_folded(self) -> Result<Self, WeightsError> {
        fold::batch_norm_folded(self).map(without_dead)
    }
}

/// The network without nodes that no tap needs, and without parameters and tensors that no node reads. Inputs stay.
fn without_dead(network: Network) -> Network {
    let Network { graph, mut weights, local_head } = network;
    let graph = without_dead_parameters(without_dead_nodes(graph));
    weights.tensors.retain(|name, _| graph.parameters.iter().any(|parameter| parameter.name == *name));
    Network { graph, weights, local_head }
}

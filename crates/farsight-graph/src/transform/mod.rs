//! Transforms: from a network with its weights to one that computes the same with less.

mod fold;
mod local_head;

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
    /// before its sampler and what comes after. Taps of the first of two are the maps that the sampler reads, in its
    /// order; the input of the second is what the sampler makes.
    pub fn parts(self, outputs: &[&str]) -> Vec<Self> {
        let is_sampler = |node: &crate::graph::Node| matches!(node.op, Op::Sampler { .. });
        let Some(sampler) = self.graph.nodes.iter().position(is_sampler) else {
            return vec![self.with_outputs(outputs)];
        };
        let mut second = self.clone();
        second.graph.nodes.drain(..sampler);
        let shifted = |id: &mut NodeId| *id -= sampler;
        second.graph.nodes[0].op = Op::Input;
        second.graph.nodes[0].inputs.clear();
        second.graph.nodes.iter_mut().flat_map(|node| &mut node.inputs).for_each(shifted);
        second.graph.taps.retain(|(_, id)| *id >= sampler);
        second.graph.taps.iter_mut().for_each(|(_, id)| shifted(id));
        let mut first = self;
        let read = std::mem::take(&mut first.graph.nodes[sampler].inputs);
        first.graph.nodes.truncate(sampler);
        let tap = |id: &NodeId| first.graph.taps.iter().find(|(_, tapped)| tapped == id).cloned();
        first.graph.taps = read.iter().filter_map(tap).collect();
        vec![without_dead(first), second.with_outputs(outputs)]
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

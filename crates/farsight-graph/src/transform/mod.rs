//! Transforms: from a network with its weights to one that computes the same with less.

mod fold;
mod local_head;

pub use local_head::LocalHead;

use crate::graph::Graph;
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

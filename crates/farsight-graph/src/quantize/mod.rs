//! Static quantisation: which convolutions compute in 8 bits, and what those 8 bits stand for.
//!
//! A convolution in 8 bits reads a map of 8-bit numbers and has 8-bit weights; its sums are kept in 32 bits. The maps
//! between such convolutions stay in 8 bits wherever all that lies between them (sums, concatenations, pooling,
//! enlargement) can. The regression head and the last layer of the heatmap stay as they are: their answers are what is
//! read.
//!
//! | step | who |
//! |---|---|
//! | which layers and maps there are | [`layers`], [`maps`] |
//! | what values the maps take | [`Histogram`], one a map, filled by running the network on images |
//! | which range each map gets | [`Observer`] |
//! | what of that a model file keeps | [`StoredRanges`] |
//! | all of it together, for `farsight_onnx::write_quantized` | [`Quantization`] |

mod histogram;
mod points;
mod range;
mod stored;

use std::collections::{BTreeMap, BTreeSet};

pub use histogram::{Histogram, Observer};
pub use points::{layers, maps};
pub use range::{QuantizedWeights, Range, WeightRange};
pub use stored::{RANGES_KEY, StoredRanges, layers_of};

use crate::graph::{Graph, NodeId, Op};

/// What of a network is in 8 bits.
#[derive(Debug, Clone, PartialEq)]
pub struct Quantization {
    layers: BTreeSet<NodeId>,
    ranges: BTreeMap<NodeId, Range>,
    weights: WeightRange,
}

impl Quantization {
    /// The convolutions `layers` of `graph` in 8 bits, and the maps that go with them, whose values lie in the ranges
    /// `observed`.
    ///
    /// Maps that are joined or handed on get one range for all, so that an engine can move their bytes as they are. A
    /// map without a range in `observed` stays as it is, and so does a convolution that reads it.
    pub fn new(graph: &Graph, layers: &BTreeSet<NodeId>, observed: &BTreeMap<NodeId, Range>) -> Self {
        let maps = maps(graph, layers);
        let mut ranges: BTreeMap<NodeId, Range> =
            maps.iter().filter_map(|id| Some((*id, *observed.get(id)?))).collect();
        share_ranges(graph, &mut ranges);
        let layers = layers.iter().copied().filter(|&id| ranges.contains_key(&graph.nodes[id].inputs[0])).collect();
        Self { layers, ranges, weights: WeightRange::Full }
    }

    /// The same with the weights in other numbers than [`WeightRange::Full`].
    #[must_use]
    pub fn with_weights(self, weights: WeightRange) -> Self {
        Self { weights, ..self }
    }

    /// Which numbers the weights take.
    pub fn weights(&self) -> WeightRange {
        self.weights
    }

    /// Whether this convolution computes in 8 bits.
    pub fn has_layer(&self, id: NodeId) -> bool {
        self.layers.contains(&id)
    }

    /// The range of the map that node `id` makes, if it is in 8 bits.
    pub fn range(&self, id: NodeId) -> Option<Range> {
        self.ranges.get(&id).copied()
    }

    /// How many convolutions compute in 8 bits.
    pub fn layer_count(&self) -> usize {
        self.layers.len()
    }
}

/// Gives the inputs and the output of every node that only moves or picks values one range, until nothing changes.
fn share_ranges(graph: &Graph, ranges: &mut BTreeMap<NodeId, Range>) {
    loop {
        let before = ranges.clone();
        for (id, node) in graph.nodes.iter().enumerate() {
            let moves = matches!(node.op, Op::Concat | Op::Narrow { .. } | Op::MaxPool { .. } | Op::Upsample { .. });
            if !moves || !ranges.contains_key(&id) {
                continue;
            }
            let members: Vec<NodeId> = node.inputs.iter().copied().chain([id]).collect();
            let joined = members.iter().filter_map(|member| ranges.get(member).copied()).reduce(Range::joined);
            let Some(joined) = joined else { continue };
            for member in members {
                ranges.entry(member).and_modify(|range| *range = joined);
            }
        }
        if *ranges == before {
            return;
        }
    }
}

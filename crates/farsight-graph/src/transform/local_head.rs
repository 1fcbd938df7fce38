//! A head as something that can be computed at single cells.

use super::Network;
use crate::graph::{Graph, NodeId, Op, ParameterId, Window};

/// The nodes and parameters of a head that looks at a small neighbourhood only: a convolution, `ReLU`, a 1x1
/// convolution.
///
/// A decoder needs some heads at the few peaks of a heatmap only; with such a head the network can end at `features`,
/// and the rest is computed there. With a norm between the convolutions that looks at the whole map (group norm) there
/// is no such head.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LocalHead {
    /// The map that the head reads.
    pub features: NodeId,
    /// Weight `[hidden, channels, k, k]` and bias of the first convolution, which has stride 1 and keeps the size.
    pub hidden: [ParameterId; 2],
    /// Weight `[channels, hidden, 1, 1]` and bias of the second.
    pub output: [ParameterId; 2],
}

impl LocalHead {
    /// The head of `network`, when it is of that kind.
    pub fn of(network: &Network) -> Option<Self> {
        let graph = &network.graph;
        let consumers = graph.consumers();
        let only_reader = |id: NodeId| (consumers[id] == 1).then_some(id);
        let last = graph.tap(network.local_head?)?;
        let (before_last, output) = local_convolution(graph, last, Some(1))?;
        let relu = only_reader(before_last).filter(|&id| graph.nodes[id].op == Op::Relu)?;
        let first = only_reader(graph.nodes[relu].inputs[0])?;
        let (features, hidden) = local_convolution(graph, first, None)?;
        Some(Self { features, hidden, output })
    }
}

/// Input and parameters of an ordinary convolution with bias that keeps the size of the map, with this kernel if one is
/// given.
fn local_convolution(graph: &Graph, id: NodeId, kernel: Option<usize>) -> Option<(NodeId, [ParameterId; 2])> {
    let node = &graph.nodes[id];
    let Op::Conv { weight, bias: Some(bias), window, groups: 1 } = node.op else { return None };
    let plain = window == Window::same(window.kernel, 1) && !window.kernel.is_multiple_of(2);
    (plain && kernel.is_none_or(|kernel| kernel == window.kernel)).then_some((node.inputs[0], [weight, bias]))
}

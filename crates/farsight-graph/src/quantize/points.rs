//! Where in a graph 8 bits can be.

use std::collections::BTreeSet;

use crate::graph::{Graph, NodeId, Op};

/// The convolutions that can compute in 8 bits, learnt upsampling among them: all that the output called `output`
/// needs, except for
///
/// - its last: its answers are what is read;
/// - those that see one cell only: they cost nothing;
/// - those that read the image: instructions for 8 bits take four channels or more at once, and three are slower than
///   in float.
pub fn layers(graph: &Graph, output: &str) -> BTreeSet<NodeId> {
    let Some(last) = graph.tap(output) else { return BTreeSet::new() };
    let mut needed = vec![false; graph.nodes.len()];
    needed[last] = true;
    for (id, node) in graph.nodes.iter().enumerate().rev() {
        if needed[id] {
            node.inputs.iter().for_each(|&input| needed[input] = true);
        }
    }
    let single = single_cells(graph);
    let reads_image = |id: NodeId| is_image(graph, graph.nodes[id].inputs[0]);
    let is_layer = |id: &NodeId| {
        let convolution = match graph.nodes[*id].op {
            Op::Conv { .. } => !reads_image(*id),
            Op::UpConv { .. } => true,
            _ => false,
        };
        convolution && needed[*id] && !single[*id] && *id != last
    };
    (0..graph.nodes.len()).filter(is_layer).collect()
}

/// Whether this is the image, or the image at another scale.
fn is_image(graph: &Graph, id: NodeId) -> bool {
    match graph.nodes[id].op {
        Op::Input => true,
        Op::BatchNorm { .. } => is_image(graph, graph.nodes[id].inputs[0]),
        _ => false,
    }
}

/// Which maps have one cell only, whatever the size of the input.
fn single_cells(graph: &Graph) -> Vec<bool> {
    let mut single: Vec<bool> = Vec::with_capacity(graph.nodes.len());
    for node in &graph.nodes {
        let inputs = !node.inputs.is_empty() && node.inputs.iter().all(|&input| single[input]);
        single.push(node.op == Op::GlobalAveragePool || inputs);
    }
    single
}

/// The maps that are in 8 bits when `layers` are: what they read, what they make, and what lies between them as far as
/// it can be.
///
/// A `ReLU` or `ReLU6` is part of the node before it: only what comes out of it counts.
pub fn maps(graph: &Graph, layers: &BTreeSet<NodeId>) -> BTreeSet<NodeId> {
    let relu_after = relu_after(graph);
    let mut maps: BTreeSet<NodeId> = layers.iter().map(|&id| relu_after[id].unwrap_or(id)).collect();
    for (id, node) in graph.nodes.iter().enumerate().rev() {
        let made = maps.contains(&relu_after[id].unwrap_or(id));
        let reads = match node.op {
            Op::Conv { .. } | Op::UpConv { .. } => layers.contains(&id),
            Op::Add | Op::Concat | Op::Multiply | Op::MaxPool { .. } | Op::Upsample { .. } => made,
            _ => false,
        };
        if reads {
            maps.extend(&node.inputs);
        }
    }
    maps
}

/// The `ReLU` or `ReLU6` that is all that reads a node.
fn relu_after(graph: &Graph) -> Vec<Option<NodeId>> {
    let mut consumers = graph.consumers();
    graph.taps.iter().for_each(|(_, id)| consumers[*id] += 1);
    let mut after = vec![None; graph.nodes.len()];
    for (id, node) in graph.nodes.iter().enumerate().filter(|(_, node)| matches!(node.op, Op::Relu | Op::Relu6)) {
        let input = node.inputs[0];
        if consumers[input] == 1 {
            after[input] = Some(id);
        }
    }
    after
}

//! A network as blocks, to be drawn: the nodes of one stage whose maps have one size are one block.

use std::collections::{BTreeMap, BTreeSet};

use crate::count::macs_of_node;
use crate::graph::{Graph, NodeId, Op, Parameter, Role};

/// Stage of the block that is the network's input.
pub const INPUT_STAGE: &str = "input";

/// Nodes of one stage with maps of one size.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Block {
    /// Name of the stage, or [`INPUT_STAGE`].
    pub stage: &'static str,
    /// Channels of the last of its nodes.
    pub channels: usize,
    /// Width and height of its maps, cells.
    pub size: [usize; 2],
    /// Parameters that its nodes read; running statistics are not counted.
    pub parameters: usize,
    /// Multiply-accumulates of its nodes ([`macs_of_node`]).
    pub macs: u64,
    /// How many stages lie between it and the input at most, along the network.
    pub depth: usize,
    /// Blocks that it reads, by their place in the list.
    pub inputs: BTreeSet<usize>,
    /// Names of the network's outputs among its nodes.
    pub outputs: Vec<String>,
}

/// The blocks of `graph` for an input of `width` x `height` pixels, in the order of their first nodes; `None` when the
/// input does not fit the network.
pub fn blocks(graph: &Graph, width: usize, height: usize) -> Option<Vec<Block>> {
    let shapes = graph.shapes(width, height)?;
    let sizes = sizes(graph, &shapes);
    let depths = depths(graph);
    let consumers = graph.consumers();
    let mut places: BTreeMap<(&'static str, [usize; 2]), usize> = BTreeMap::new();
    let mut of_node: Vec<usize> = Vec::with_capacity(graph.nodes.len());
    let mut blocks: Vec<Block> = Vec::new();
    for (id, node) in graph.nodes.iter().enumerate() {
        let (stage, size) = (stage(graph, id), sizes[id]);
        let place = *places.entry((stage, size)).or_insert_with(|| {
            let (inputs, outputs) = (BTreeSet::new(), Vec::new());
            blocks.push(Block {
                stage,
                channels: 0,
                size,
                parameters: 0,
                macs: 0,
                depth: depths[stage],
                inputs,
                outputs,
            });
            blocks.len() - 1
        });
        of_node.push(place);
        let block = &mut blocks[place];
        if sizes[id] == [shapes[id][2], shapes[id][1]] {
            block.channels = node.channels;
        }
        let read = node.op.parameters().into_iter().map(|parameter| &graph.parameters[parameter]);
        block.parameters +=
            read.filter(|parameter| parameter.role != Role::Statistic).map(Parameter::len).sum::<usize>();
        block.macs += macs_of_node(graph, id, shapes[id]);
        block.inputs.extend(node.inputs.iter().map(|&input| of_node[input]).filter(|&input| input != place));
        if consumers[id] == 0 {
            let names = graph.taps.iter().filter(|(_, tapped)| *tapped == id).map(|(name, _)| name.clone());
            block.outputs.extend(names);
        }
    }
    Some(blocks)
}

fn stage(graph: &Graph, id: NodeId) -> &'static str {
    let node = &graph.nodes[id];
    if node.op == Op::Input { INPUT_STAGE } else { node.stage }
}

/// Width and height that each node is drawn at: its own, or for a gate (one cell that a whole map is multiplied by)
/// those of the map.
fn sizes(graph: &Graph, shapes: &[[usize; 3]]) -> Vec<[usize; 2]> {
    let mut sizes: Vec<[usize; 2]> = shapes.iter().map(|&[_, height, width]| [width, height]).collect();
    for (id, node) in graph.nodes.iter().enumerate().rev() {
        for &input in &node.inputs {
            if sizes[input] == [1, 1] && node.op != Op::Input {
                sizes[input] = sizes[id];
            }
        }
    }
    sizes
}

/// The most stages between the input and each stage.
fn depths(graph: &Graph) -> BTreeMap<&'static str, usize> {
    let mut depths = BTreeMap::new();
    for (id, node) in graph.nodes.iter().enumerate() {
        let own = stage(graph, id);
        let before = node.inputs.iter().map(|&input| stage(graph, input)).filter(|&before| before != own);
        let least = before.map(|before| depths.get(before).map_or(0, |depth| depth + 1)).max().unwrap_or(0);
        let depth = depths.entry(own).or_insert(0);
        *depth = least.max(*depth);
    }
    depths
}

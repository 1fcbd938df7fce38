//! Dropping what no tap needs.

use crate::graph::{Graph, Op};

/// The graph without nodes that no tap needs. Inputs stay.
pub(crate) fn without_dead_nodes(graph: Graph) -> Graph {
    let Graph { nodes, parameters, taps } = graph;
    let mut needed = vec![false; nodes.len()];
    for (_, id) in &taps {
        needed[*id] = true;
    }
    for (id, node) in nodes.iter().enumerate().rev() {
        needed[id] |= node.op == Op::Input;
        if needed[id] {
            node.inputs.iter().for_each(|&input| needed[input] = true);
        }
    }
    let new_ids = new_ids(&needed);
    let mut nodes = kept(nodes, &needed);
    nodes.iter_mut().flat_map(|node| &mut node.inputs).for_each(|input| *input = new_ids[*input]);
    let taps = taps.into_iter().map(|(name, id)| (name, new_ids[id])).collect();
    Graph { nodes, parameters, taps }
}

/// The graph without parameters that no node reads.
pub(crate) fn without_dead_parameters(mut graph: Graph) -> Graph {
    let mut needed = vec![false; graph.parameters.len()];
    graph.nodes.iter().flat_map(|node| node.op.parameters()).for_each(|id| needed[id] = true);
    let new_ids = new_ids(&needed);
    graph.parameters = kept(graph.parameters, &needed);
    graph.nodes.iter_mut().flat_map(|node| node.op.parameters_mut()).for_each(|id| *id = new_ids[*id]);
    graph
}

/// Where each item stands once those that are not needed are gone.
fn new_ids(needed: &[bool]) -> Vec<usize> {
    let count_before = |next: &mut usize, needed: &bool| {
        let id = *next;
        *next += usize::from(*needed);
        Some(id)
    };
    needed.iter().scan(0, count_before).collect()
}

fn kept<T>(items: Vec<T>, needed: &[bool]) -> Vec<T> {
    items.into_iter().zip(needed).filter(|(_, needed)| **needed).map(|(item, _)| item).collect()
}

//! Parameters and multiply-accumulates of a network, by stage.

use crate::graph::{Graph, NodeId, Op, Role};

/// What one stage costs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StageCount {
    /// Name of the stage.
    pub stage: &'static str,
    /// Parameters, unused ones included and running statistics not, as every published table counts them.
    pub parameters: usize,
    /// Multiply-accumulates of convolutions; norms, activations and the sampling of deformable convolutions are not
    /// counted.
    pub macs: u64,
}

/// Costs of each stage, in the order of the network, for an input of `width` x `height` pixels; `None` when the input
/// does not fit the network.
pub fn count(graph: &Graph, width: usize, height: usize) -> Option<Vec<StageCount>> {
    let shapes = graph.shapes(width, height)?;
    let mut stages: Vec<StageCount> = Vec::new();
    for (id, node) in graph.nodes.iter().enumerate() {
        stage_mut(&mut stages, node.stage).macs += macs_of_node(graph, id, shapes[id]);
    }
    for parameter in graph.parameters.iter().filter(|p| p.role != Role::Statistic) {
        stage_mut(&mut stages, parameter.stage).parameters += parameter.len();
    }
    stages.retain(|s| s.parameters > 0 || s.macs > 0);
    Some(stages)
}

/// Multiply-accumulates of one node, whose output has this shape (`[channels, height, width]`).
pub fn macs_of_node(graph: &Graph, id: NodeId, [_, height, width]: [usize; 3]) -> u64 {
    let node = &graph.nodes[id];
    let macs_per_cell = match node.op {
        Op::Conv { weight, .. } | Op::DeformConv { weight, .. } => graph.parameters[weight].len(),
        // Each output cell of a depthwise enlargement by f gathers (2 f / f)^2 = 4 taps a channel.
        Op::UpConv { .. } => 4 * node.channels,
        _ => 0,
    };
    (macs_per_cell * height * width) as u64
}

/// The sum of all stages.
pub fn total(stages: &[StageCount]) -> StageCount {
    StageCount {
        stage: "total",
        parameters: stages.iter().map(|s| s.parameters).sum(),
        macs: stages.iter().map(|s| s.macs).sum(),
    }
}

fn stage_mut<'a>(stages: &'a mut Vec<StageCount>, name: &'static str) -> &'a mut StageCount {
    let at = stages.iter().position(|s| s.stage == name).unwrap_or_else(|| {
        stages.push(StageCount { stage: name, parameters: 0, macs: 0 });
        stages.len() - 1
    });
    &mut stages[at]
}

//! Which channels of which nodes are the same channel to a pruner.

use std::collections::BTreeMap;

use crate::graph::{Graph, NodeId, Op};

/// One channel made by some node, before it is joined with others.
pub(super) type ChannelId = usize;

/// A layer that can be pruned.
#[derive(Debug)]
pub(super) struct Layer {
    /// The channels to choose from.
    pub(super) roots: Vec<ChannelId>,
    /// Its channels, those that follow a root included.
    pub(super) width: usize,
}

/// The channels of every node, joined where the network forces them to stand or fall together.
#[derive(Debug)]
pub(super) struct Spaces {
    nodes: Vec<Vec<ChannelId>>,
    parents: Vec<ChannelId>,
    /// Number of the layer in which a channel was made; joined layers share the channels they are pruned from.
    layers: Vec<usize>,
    fixed: Vec<bool>,
}

impl Spaces {
    /// The channels of `graph`; those of `outputs` must all stay.
    pub(super) fn of(graph: &Graph, outputs: &[&str]) -> Self {
        let mut spaces = Self { nodes: Vec::new(), parents: Vec::new(), layers: Vec::new(), fixed: Vec::new() };
        for node in &graph.nodes {
            let inputs: Vec<Vec<ChannelId>> = node.inputs.iter().map(|&i| spaces.nodes[i].clone()).collect();
            let channels = match &node.op {
                Op::Input => spaces.fresh(node.channels, true),
                Op::Conv { groups: 1, .. } => spaces.fresh(node.channels, false),
                Op::DeformConv { .. } => {
                    inputs[1].iter().for_each(|&offset| spaces.fixed[offset] = true);
                    spaces.fresh(node.channels, false)
                }
                Op::Sampler { .. } => {
                    inputs.iter().flatten().for_each(|&read| spaces.fixed[read] = true);
                    spaces.fresh(node.channels, true)
                }
                // Which channels they are must not change.
                Op::Narrow { start } => {
                    inputs[0].iter().for_each(|&read| spaces.fixed[read] = true);
                    inputs[0][*start..start + node.channels].to_vec()
                }
                Op::Concat => inputs.concat(),
                Op::Add | Op::Multiply | Op::WeightedSum { .. } => {
                    for other in &inputs[1..] {
                        inputs[0].iter().zip(other).for_each(|(&a, &b)| spaces.join(a, b));
                    }
                    inputs[0].clone()
                }
                Op::GroupNorm { groups, .. } => {
                    spaces.join_groups(&inputs[0], *groups);
                    inputs[0].clone()
                }
                // Everything else works on each channel by itself.
                _ => inputs[0].clone(),
            };
            spaces.nodes.push(channels);
        }
        for output in outputs.iter().filter_map(|name| graph.tap(name)) {
            for channel in spaces.nodes[output].clone() {
                spaces.fixed[channel] = true;
            }
        }
        spaces
    }

    /// Number of channels before joining; roots are below it.
    pub(super) fn len(&self) -> usize {
        self.parents.len()
    }

    pub(super) fn channels(&self, node: NodeId) -> &[ChannelId] {
        &self.nodes[node]
    }

    /// The channel that stands for all that `channel` is joined with.
    pub(super) fn root(&self, mut channel: ChannelId) -> ChannelId {
        while self.parents[channel] != channel {
            channel = self.parents[channel];
        }
        channel
    }

    /// The layers that channels are pruned from, without those that must stay whole.
    pub(super) fn prunable(&self) -> Vec<Layer> {
        let fixed: Vec<ChannelId> =
            (0..self.len()).filter(|&channel| self.fixed[channel]).map(|channel| self.root(channel)).collect();
        let mut layers: BTreeMap<usize, Vec<ChannelId>> = BTreeMap::new();
        for channel in (0..self.len()).filter(|&channel| self.root(channel) == channel) {
            layers.entry(self.layers[channel]).or_default().push(channel);
        }
        layers
            .into_iter()
            .filter(|(_, roots)| !roots.iter().any(|root| fixed.contains(root)))
            .map(|(layer, roots)| Layer { roots, width: self.layers.iter().filter(|&&of| of == layer).count() })
            .collect()
    }

    fn fresh(&mut self, count: usize, fixed: bool) -> Vec<ChannelId> {
        let first = self.parents.len();
        let layer = self.layers.last().map_or(0, |last| last + 1);
        self.parents.extend(first..first + count);
        self.layers.resize(first + count, layer);
        self.fixed.resize(first + count, fixed);
        (first..first + count).collect()
    }

    /// The older channel becomes the root, so that its layer decides.
    fn join(&mut self, a: ChannelId, b: ChannelId) {
        let (a, b) = (self.root(a), self.root(b));
        self.parents[a.max(b)] = a.min(b);
    }

    /// Every group must keep as many channels as the others: the j-th channels of all groups are joined.
    fn join_groups(&mut self, channels: &[ChannelId], groups: usize) {
        let size = channels.len() / groups.max(1);
        for (position, &channel) in channels.iter().enumerate().skip(size) {
            self.join(channels[position % size], channel);
        }
    }
}

//! Structured pruning: whole channels leave the network, and what remains is a smaller network of the same kind.
//!
//! Channels that are added to each other, gated or normalised in groups stand or fall together (`spaces`). Within each
//! such space the channels with the largest weights stay: each is worth the L1 norm of the filters that make it, times
//! the scale that the norm behind it gives it.

mod spaces;

use std::collections::BTreeMap;

use thiserror::Error;

use crate::graph::{Graph, Op, ParameterId};
use crate::model::{Model, ModelError, NetworkConfig};
use crate::weights::{WeightTensor, Weights};
use spaces::{Layer, Spaces};

/// Widths stay multiples of this where the share allows: what the vector units of processors like.
const WIDTH_STEP: usize = 8;

/// A network that cannot be pruned as asked.
#[derive(Debug, Error)]
pub enum PruneError {
    /// The share is not one.
    #[error("the share to keep is {0}; expected a number above 0 and at most 1")]
    Share(f64),
    /// The pruned tensors make no network: a defect.
    #[error(transparent)]
    Model(#[from] ModelError),
}

/// `model` with about the share `keep` of the channels of every layer; inputs, heads' outputs and offsets of deformable
/// convolutions stay whole. Scores and error bars that were fitted to `model` are not kept: they say nothing about
/// another network.
///
/// # Errors
/// When the share is not above 0 and at most 1.
pub fn prune<C: NetworkConfig>(model: &Model<C>, keep: f64) -> Result<Model<C>, PruneError> {
    if !(keep > 0.0 && keep <= 1.0) {
        return Err(PruneError::Share(keep));
    }
    let spaces = Spaces::of(&model.graph, C::OUTPUTS);
    let kept = kept_channels(&spaces, &model.graph, &model.weights, keep);
    let positions = |node: usize| -> Vec<usize> {
        let channels = spaces.channels(node).iter().enumerate();
        channels.filter(|(_, channel)| kept[spaces.root(**channel)]).map(|(position, _)| position).collect()
    };
    let mut weights = model.weights.clone();
    let mut slice = |parameter: ParameterId, axis: usize, positions: &[usize]| {
        let name = &model.graph.parameters[parameter].name;
        if let Some(tensor) = weights.tensors.get_mut(name) {
            *tensor = selected(tensor, axis, positions);
        }
    };
    for (id, node) in model.graph.nodes.iter().enumerate() {
        let outputs = positions(id);
        match &node.op {
            Op::Conv { weight, bias, groups, .. } => {
                slice(*weight, 0, &outputs);
                if *groups == 1 {
                    slice(*weight, 1, &positions(node.inputs[0]));
                }
                if let Some(bias) = bias {
                    slice(*bias, 0, &outputs);
                }
            }
            Op::DeformConv { weight, bias, .. } => {
                slice(*weight, 0, &outputs);
                slice(*weight, 1, &positions(node.inputs[0]));
                slice(*bias, 0, &outputs);
            }
            Op::UpConv { weight, .. } => slice(*weight, 0, &outputs),
            Op::GroupNorm { .. } | Op::BatchNorm { .. } => {
                for parameter in node.op.parameters() {
                    slice(parameter, 0, &outputs);
                }
            }
            _ => {}
        }
    }
    Ok(Model::pruned(model.config.clone().without_fit(), weights)?)
}

/// For every channel's root, whether it stays.
fn kept_channels(spaces: &Spaces, graph: &Graph, weights: &Weights, keep: f64) -> Vec<bool> {
    let worth = worth(spaces, graph, weights);
    let mut kept = vec![true; spaces.len()];
    for Layer { roots, width } in spaces.prunable() {
        // With group norm a root stands for one channel of every group.
        let channels_each = width / roots.len();
        let step = WIDTH_STEP.div_ceil(channels_each).min(roots.len());
        let wanted = (roots.len() as f64 * keep / step as f64).round().max(1.0) as usize * step;
        let mut ranked = roots;
        ranked.sort_by(|a, b| worth[*b].total_cmp(&worth[*a]).then(a.cmp(b)));
        for channel in ranked.into_iter().skip(wanted) {
            kept[channel] = false;
        }
    }
    kept
}

/// What each channel's root is worth: relative to the mean of its layer, summed over the layers that make it.
fn worth(spaces: &Spaces, graph: &Graph, weights: &Weights) -> Vec<f64> {
    let scales = norm_scales(graph, weights);
    let mut worth = vec![0.0; spaces.len()];
    for (id, node) in graph.nodes.iter().enumerate() {
        let (Op::Conv { weight, groups: 1, .. } | Op::DeformConv { weight, .. }) = node.op else { continue };
        let Some(tensor) = weights.tensors.get(&graph.parameters[weight].name) else { continue };
        let filter = tensor.values.len() / node.channels.max(1);
        let norms: Vec<f64> = (0..node.channels)
            .map(|channel| {
                let values = &tensor.values[channel * filter..][..filter];
                let scale = scales.get(&id).map_or(1.0, |scales| f64::from(scales[channel].abs()));
                scale * values.iter().map(|v| f64::from(v.abs())).sum::<f64>()
            })
            .collect();
        let mean = norms.iter().sum::<f64>() / norms.len().max(1) as f64;
        for (channel, norm) in spaces.channels(id).iter().zip(norms) {
            worth[spaces.root(*channel)] += if mean > 0.0 { norm / mean } else { 0.0 };
        }
    }
    worth
}

/// The scale of the norm that follows each convolution.
fn norm_scales<'a>(graph: &Graph, weights: &'a Weights) -> BTreeMap<usize, &'a [f32]> {
    let norms = graph.nodes.iter().filter_map(|node| match node.op {
        Op::BatchNorm { weight, .. } | Op::GroupNorm { weight, .. } => Some((node.inputs[0], weight)),
        _ => None,
    });
    norms
        .filter_map(|(id, weight)| {
            let tensor = weights.tensors.get(&graph.parameters[weight].name)?;
            Some((id, tensor.values.as_slice()))
        })
        .collect()
}

/// The slices of `tensor` at `positions` along `axis`.
fn selected(tensor: &WeightTensor, axis: usize, positions: &[usize]) -> WeightTensor {
    let inner: usize = tensor.shape[axis + 1..].iter().product();
    let rows = tensor.shape[axis];
    let outer: usize = tensor.shape[..axis].iter().product();
    let mut values = Vec::with_capacity(outer * positions.len() * inner);
    for block in 0..outer {
        for position in positions {
            values.extend_from_slice(&tensor.values[(block * rows + position) * inner..][..inner]);
        }
    }
    let mut shape = tensor.shape.clone();
    shape[axis] = positions.len();
    WeightTensor { shape, values }
}

//! The two heads (spec section 4), and one for training.

use farsight_graph::graph::{Init, NodeId};
use farsight_graph::layers::Builder;

use super::codec::CHANNELS;

/// Logit at which the heatmap starts: a probability near 0.1, so that the first steps are not drowned by the
/// background.
const PRIOR_LOGIT: f32 = -2.19;

/// Appends the heatmap head; returns its logits, one channel a class.
pub(super) fn class_head(b: &mut Builder, x: NodeId, width: usize, classes: usize) -> NodeId {
    head(b, x, "class_head", width, classes, None, Init::Constant(PRIOR_LOGIT))
}

/// Appends the regression head; returns its raw channels.
pub(super) fn regression_head(b: &mut Builder, x: NodeId, width: usize) -> NodeId {
    let zero = Init::Constant(0.0);
    head(b, x, "regression_head", width, CHANNELS, Some(zero), zero)
}

/// Appends the head that the features alone are for: no wider than they are, one channel.
pub(super) fn surface_head(b: &mut Builder, x: NodeId) -> NodeId {
    let (width, zero) = (b.channels(x), Init::Constant(0.0));
    head(b, x, "surface_head", width, 1, Some(zero), zero)
}

fn head(
    b: &mut Builder,
    x: NodeId,
    name: &'static str,
    width: usize,
    channels: usize,
    hidden_bias: Option<Init>,
    bias: Init,
) -> NodeId {
    b.stage(name);
    let part = |layer: usize| format!("heads.predictor.{name}.{layer}");
    let x = b.conv_with_bias(x, &part(0), width, 3, hidden_bias);
    let x = b.norm(x, &part(1));
    let x = b.relu(x);
    b.conv_with_bias(x, &part(3), channels, 1, Some(bias))
}

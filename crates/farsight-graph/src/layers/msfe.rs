//! Multi-scale feature enhancement (MSFE, also called cross-layer feature fusion): three designs (MSFE/DGH spec section
//! 3).
//!
//! Each starts as the identity: the norm that closes its residual branch has scale zero.

use serde::{Deserialize, Serialize};

use super::Builder;
use crate::graph::{NodeId, Op, Window};

/// Which multi-scale feature enhancement the network has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Msfe {
    /// None: the SMOKE baseline.
    #[default]
    None,
    /// Residual pyramid with channel attention before the neck.
    A,
    /// Cross-layer concatenation, added to the neck's output.
    B,
    /// Bidirectional pyramid before the neck.
    C,
    /// Not the paper's: what design A costs without its idea, for experiments. Levels keep to themselves and nothing
    /// weighs channels.
    Control,
}

/// Prefix of the parameter names in a whole network.
pub const PREFIX: &str = "backbone.body.msfe.";

/// Squeeze ratio of the channel attention.
const REDUCTION: usize = 8;

/// Pyramid levels by their KITTI-era names C3, C4, C5.
const LEVELS: [usize; 3] = [3, 4, 5];

/// Design A: a top-down pyramid with channel attention at each level, added to C3, C4, C5. `pyramid` and the answer are
/// C3, C4, C5.
pub fn residual_pyramid(b: &mut Builder, prefix: &str, pyramid: [NodeId; 3], width: usize) -> [NodeId; 3] {
    b.stage("msfe");
    let laterals = [0, 1, 2].map(|i| lateral(b, prefix, i, pyramid[i], width));
    let p5 = laterals[2];
    let up5 = b.map(Op::Upsample { factor: 2 }, p5);
    let p4 = b.add(laterals[1], up5);
    let up4 = b.map(Op::Upsample { factor: 2 }, p4);
    let p3 = b.add(laterals[0], up4);
    for (name, node) in [("p3", p3), ("p4", p4)] {
        b.tap(&format!("{prefix}tap.{name}.topdown"), node);
    }
    let fused = [p3, p4, p5];
    let smoothed = [0, 1, 2].map(|i| smooth(b, prefix, i, fused[i], width));
    [0, 1, 2].map(|i| {
        let gated = b.channel_attention(smoothed[i], &level_name(prefix, i, "se"), REDUCTION);
        write_back(b, prefix, i, gated, pyramid[i])
    })
}

/// The control of design A: the same convolutions at each level, but no level hears of another and there is no channel
/// attention. The few parameters of the attention are not made up for.
pub fn separate_levels(b: &mut Builder, prefix: &str, pyramid: [NodeId; 3], width: usize) -> [NodeId; 3] {
    b.stage("msfe");
    [0, 1, 2].map(|i| {
        let x = lateral(b, prefix, i, pyramid[i], width);
        let x = smooth(b, prefix, i, x, width);
        write_back(b, prefix, i, x, pyramid[i])
    })
}

/// Design B: C3, C4, C5 side by side at stride 8, weighed by one channel attention, added to the neck's output
/// `features` at stride 4.
pub fn concat_fusion(b: &mut Builder, prefix: &str, pyramid: [NodeId; 3], features: NodeId, width: usize) -> NodeId {
    b.stage("msfe");
    let laterals = [0, 1, 2].map(|i| {
        let x = lateral(b, prefix, i, pyramid[i], width);
        if i == 0 { x } else { b.map(Op::Upsample { factor: 1 << i }, x) }
    });
    let x = b.concat(&laterals);
    let x = b.channel_attention(x, &format!("{prefix}se"), REDUCTION);
    let conv = |b: &mut Builder, x: NodeId, name: &str, kernel: usize| {
        let (conv, norm) = (format!("{prefix}{name}"), format!("{prefix}{name}_norm"));
        b.conv_norm_relu(x, &conv, &norm, width, Window::same(kernel, 1))
    };
    let x = conv(b, x, "reduce", 1);
    let x = conv(b, x, "fuse1", 3);
    let x = conv(b, x, "fuse2", 3);
    let channels = b.channels(features);
    let x = b.conv(x, &format!("{prefix}back"), channels, Window::same(1, 1));
    let x = b.norm_scaled(x, &format!("{prefix}back_norm"), 0.0);
    let x = b.map(Op::Upsample { factor: 2 }, x);
    b.add(features, x)
}

/// Design C: one round of a bidirectional pyramid of separable convolutions, added to C3, C4, C5.
pub fn bifpn(b: &mut Builder, prefix: &str, pyramid: [NodeId; 3], width: usize) -> [NodeId; 3] {
    b.stage("msfe");
    let [p3, p4, p5] = [0, 1, 2].map(|i| {
        let x = lateral(b, prefix, i, pyramid[i], width);
        b.channel_attention(x, &level_name(prefix, i, "se"), REDUCTION)
    });
    let up = Op::Upsample { factor: 2 };
    let down = Op::max_of_tiles(2);
    let up5 = b.map(up.clone(), p5);
    let top_down4 = fusion(b, prefix, "td4", &[p4, up5]);
    let up4 = b.map(up, top_down4);
    let out3 = fusion(b, prefix, "out3", &[p3, up4]);
    let down3 = b.map(down.clone(), out3);
    let out4 = fusion(b, prefix, "out4", &[p4, top_down4, down3]);
    let down4 = b.map(down, out4);
    let out5 = fusion(b, prefix, "out5", &[p5, down4]);
    let outputs = [out3, out4, out5];
    [0, 1, 2].map(|i| write_back(b, prefix, i, outputs[i], pyramid[i]))
}

/// What design A does at a level after the levels have met. The coarsest has few cells; a separable convolution is
/// enough there.
fn smooth(b: &mut Builder, prefix: &str, i: usize, x: NodeId, width: usize) -> NodeId {
    let norm = level_name(prefix, i, "smooth_norm");
    if i < 2 {
        return b.conv_norm_relu(x, &level_name(prefix, i, "smooth"), &norm, width, Window::same(3, 1));
    }
    let x = b.depthwise_conv(x, &level_name(prefix, i, "smooth_dw"), Window::same(3, 1));
    b.conv_norm_relu(x, &level_name(prefix, i, "smooth_pw"), &norm, width, Window::same(1, 1))
}

/// One node of the bidirectional pyramid: weighted sum, separable convolution, norm, `ReLU`.
fn fusion(b: &mut Builder, prefix: &str, name: &str, inputs: &[NodeId]) -> NodeId {
    let sum = b.weighted_sum(inputs, &format!("{prefix}{name}.fusion_weight"));
    let x = b.depthwise_conv(sum, &format!("{prefix}{name}.dw"), Window::same(3, 1));
    let width = b.channels(x);
    b.conv_norm_relu(x, &format!("{prefix}{name}.pw"), &format!("{prefix}{name}.norm"), width, Window::same(1, 1))
}

fn lateral(b: &mut Builder, prefix: &str, i: usize, x: NodeId, width: usize) -> NodeId {
    let (conv, norm) = (level_name(prefix, i, "lat"), level_name(prefix, i, "lat_norm"));
    b.conv_norm_relu(x, &conv, &norm, width, Window::same(1, 1))
}

/// Projects `x` to the width of `original` and adds it there; silent at the start.
fn write_back(b: &mut Builder, prefix: &str, i: usize, x: NodeId, original: NodeId) -> NodeId {
    let channels = b.channels(original);
    let x = b.conv(x, &level_name(prefix, i, "back"), channels, Window::same(1, 1));
    let x = b.norm_scaled(x, &level_name(prefix, i, "back_norm"), 0.0);
    b.add(original, x)
}

fn level_name(prefix: &str, i: usize, part: &str) -> String {
    format!("{prefix}p{}.{part}", LEVELS[i])
}

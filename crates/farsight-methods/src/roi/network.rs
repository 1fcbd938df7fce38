//! The network of a second stage: a backbone over one crop, whose last map is read whole.

use farsight_graph::graph::{NodeId, Op, Window};
use farsight_graph::layers::inverted_residuals::Convention;
use farsight_graph::layers::{Builder, mobilenet_v2};
use serde::{Deserialize, Serialize};

/// Name of the answer among the taps.
pub const ANSWER: &str = "answer";

/// What makes features of a crop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RoiBackbone {
    /// Four residual levels.
    #[default]
    Residual,
    /// `MobileNetV2`, for weights that have seen photographs. It sees the colours only; what else the input has comes
    /// in after it.
    MobilenetV2,
}

impl RoiBackbone {
    /// The sides of a crop are multiples of this.
    pub(crate) fn stride(self, levels: usize) -> usize {
        match self {
            Self::Residual => 1 << levels,
            Self::MobilenetV2 => MOBILENET_STRIDE,
        }
    }

    /// Its name in configs.
    pub fn name(self) -> &'static str {
        match self {
            Self::Residual => "residual",
            Self::MobilenetV2 => "mobilenet_v2",
        }
    }
}

/// Of the last map of `MobileNetV2`.
const MOBILENET_STRIDE: usize = 32;

/// Red, green, blue.
const COLOURS: usize = 3;

/// Channels of what the finer maps of `MobileNetV2` become, by stride: 8 and 16.
const FINE_CHANNELS: [usize; 2] = [64, 128];

/// The first convolution's window, half the size.
const STEM: Window = Window::same(5, 2);

/// What is wrong with the sizes of [`features`], if anything is; `name` is that of the config's table.
pub(crate) fn problem_of_sizes(
    name: &str,
    side: usize,
    multiple: usize,
    channels: &[usize],
    hidden: usize,
) -> Option<String> {
    if side == 0 || !side.is_multiple_of(multiple) || side > 1024 {
        return Some(format!("{name}.side is {side}; expected a multiple of {multiple}, at most 1024"));
    }
    let named = channels.iter().map(|count| ("channels", *count)).chain([("hidden", hidden)]);
    let mut wrong = named.filter(|(_, count)| !(1..=4096).contains(count));
    wrong.next().map(|(field, count)| format!("{name}.{field} has {count}; expected 1 to 4096"))
}

/// From a cut-out of `side` x `side` pixels to `[batch, hidden, 1, 1]`: every level halves the map, and the last one is
/// read whole.
pub(crate) fn features(b: &mut Builder, input: NodeId, side: usize, channels: &[usize], hidden: usize) -> NodeId {
    let mut x = b.conv_norm_relu(input, "stem.conv", "stem.norm", channels[0], STEM);
    for (level, &channels) in channels.iter().enumerate().skip(1) {
        x = residual_level(b, x, &format!("level{level}"), channels);
    }
    whole(b, x, side >> channels.len(), hidden)
}

/// From a cut-out of `side` x `side` pixels to `[batch, hidden, 1, 1]` with the backbone that `MobileNetV2` is.
///
/// Where things are in the crop is in the maps of strides 8 and 16 rather than in the last one, so these go down to its
/// size beside it. The channels after the colours are even or rise along a side, so the maximum of each tile has all of
/// them.
pub(crate) fn mobilenet_features(b: &mut Builder, input: NodeId, side: usize, hidden: usize) -> NodeId {
    let colours = b.narrow(input, 0, COLOURS);
    let [.., eighth, sixteenth, last] = mobilenet_v2(b, colours, 1.0, Convention::Torchvision);
    b.stage("refiner");
    let half = Window::same(3, 2);
    let fine = b.conv_norm_relu(eighth, "fine8.conv", "fine8.norm", FINE_CHANNELS[0], half);
    let fine = b.concat(&[fine, sixteenth]);
    let fine = b.conv_norm_relu(fine, "fine16.conv", "fine16.norm", FINE_CHANNELS[1], half);
    let others = b.channels(input) - COLOURS;
    let others = b.narrow(input, COLOURS, others);
    let others = b.map(Op::max_of_tiles(MOBILENET_STRIDE), others);
    let all = b.concat(&[last, fine, others]);
    whole(b, all, side / MOBILENET_STRIDE, hidden)
}

/// A map of `cells` x `cells` read whole.
fn whole(b: &mut Builder, x: NodeId, cells: usize, hidden: usize) -> NodeId {
    let whole = Window { kernel: cells, stride: 1, padding: 0, end_padding: 0, dilation: 1 };
    let x = b.conv_norm_relu(x, "whole.conv", "whole.norm", hidden, whole);
    let x = b.conv_with_bias(x, "hidden", hidden, 1, None);
    b.relu(x)
}

/// Half the size: two convolutions beside a pooled projection.
fn residual_level(b: &mut Builder, x: NodeId, name: &str, channels: usize) -> NodeId {
    let first = b.conv_norm_relu(x, &format!("{name}.conv1"), &format!("{name}.norm1"), channels, Window::same(3, 2));
    let second = b.conv(first, &format!("{name}.conv2"), channels, Window::same(3, 1));
    let second = b.norm(second, &format!("{name}.norm2"));
    let pooled = b.map(Op::max_of_tiles(2), x);
    let beside = b.conv(pooled, &format!("{name}.project"), channels, Window::same(1, 1));
    let beside = b.norm(beside, &format!("{name}.project_norm"));
    let sum = b.add(second, beside);
    b.relu(sum)
}

//! The network of a second stage: residual levels over one crop, read whole at the end.

use farsight_graph::graph::{NodeId, Op, Window};
use farsight_graph::layers::Builder;

/// Name of the answer among the taps.
pub const ANSWER: &str = "answer";

/// The first convolution's window, half the size.
const STEM: Window = Window::same(5, 2);

/// What is wrong with the sizes of [`features`], if anything is; `name` is that of the config's table.
pub(crate) fn problem_of_sizes(name: &str, side: usize, channels: &[usize], hidden: usize) -> Option<String> {
    let multiple = 1 << channels.len();
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
    let whole = Window { kernel: side >> channels.len(), stride: 1, padding: 0, end_padding: 0, dilation: 1 };
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

//! The DLA-34 backbone (spec section 2).

use serde::{Deserialize, Serialize};

use super::Builder;
use crate::graph::{NodeId, Op, Window};

const BASE: &str = "backbone.body.base";

/// The first convolutions, down to stride 2.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stem {
    /// DLA's: two convolutions at the input's full size before the first step down.
    #[default]
    Full,
    /// Steps down at once. At small widths DLA's stem costs more time than any other stage, most of it for moving
    /// full-size maps.
    Half,
}

/// Appends DLA-34 with these channels a level; returns levels 0 to 5, strides 1 to 32 (2 to 32 with the half-size
/// stem).
pub fn dla34(b: &mut Builder, image: NodeId, channels: [usize; 6], stem: Stem) -> [NodeId; 6] {
    b.stage("base");
    let (base, level0, level1) = match stem {
        Stem::Full => {
            let base = stem_conv(b, image, "base_layer", channels[0], Window::same(7, 1));
            let level0 = stem_conv(b, base, "level0", channels[0], Window::same(3, 1));
            (base, level0, stem_conv(b, level0, "level1", channels[1], Window::same(3, 2)))
        }
        Stem::Half => {
            let base = stem_conv(b, image, "base_layer", channels[0], Window::same(3, 2));
            (base, base, stem_conv(b, base, "level1", channels[1], Window::same(3, 1)))
        }
    };
    let level2 = tree(b, level1, &format!("{BASE}.level2"), channels[2], 2, &[]);
    let level3 = deep_tree(b, level2, &format!("{BASE}.level3"), channels[3]);
    let level4 = deep_tree(b, level3, &format!("{BASE}.level4"), channels[4]);
    // Level 5 has a level root: its pooled input joins the root.
    let low = b.map(Op::max_of_tiles(2), level4);
    let level5 = tree(b, level4, &format!("{BASE}.level5"), channels[5], 2, &[low]);
    let levels = [level0, level1, level2, level3, level4, level5];
    b.tap("base_layer", base);
    for (i, &level) in levels.iter().enumerate() {
        b.tap(&format!("level{i}"), level);
    }
    levels
}

fn stem_conv(b: &mut Builder, x: NodeId, name: &str, channels: usize, window: Window) -> NodeId {
    b.conv_norm_relu(x, &format!("{BASE}.{name}.0"), &format!("{BASE}.{name}.1"), channels, window)
}

/// A tree of depth 1: two blocks and the root that joins them with `extra`.
fn tree(b: &mut Builder, x: NodeId, name: &str, channels: usize, stride: usize, extra: &[NodeId]) -> NodeId {
    let low = if stride > 1 { b.map(Op::max_of_tiles(stride), x) } else { x };
    let skip = if b.channels(low) == channels {
        low
    } else {
        let projected = b.conv(low, &format!("{name}.project.0"), channels, Window::same(1, 1));
        b.norm(projected, &format!("{name}.project.1"))
    };
    let first = block(b, x, &format!("{name}.tree1"), channels, stride, skip);
    let second = block(b, first, &format!("{name}.tree2"), channels, 1, first);
    let joined: Vec<NodeId> = [second, first].iter().chain(extra).copied().collect();
    let joined = b.concat(&joined);
    let (conv, norm) = (format!("{name}.root.conv"), format!("{name}.root.norm"));
    b.conv_norm_relu(joined, &conv, &norm, channels, Window::same(1, 1))
}

/// A tree of depth 2 with level root (levels 3 and 4).
fn deep_tree(b: &mut Builder, x: NodeId, name: &str, channels: usize) -> NodeId {
    let low = b.map(Op::max_of_tiles(2), x);
    b.unused_projection(&format!("{name}.project"), b.channels(x), channels);
    let first = tree(b, x, &format!("{name}.tree1"), channels, 2, &[]);
    tree(b, first, &format!("{name}.tree2"), channels, 1, &[low, first])
}

/// The basic residual block; `skip` is added before the last `ReLU`.
fn block(b: &mut Builder, x: NodeId, name: &str, channels: usize, stride: usize, skip: NodeId) -> NodeId {
    let (conv, norm) = (format!("{name}.conv1"), format!("{name}.norm1"));
    let x = b.conv_norm_relu(x, &conv, &norm, channels, Window::same(3, stride));
    let x = b.conv(x, &format!("{name}.conv2"), channels, Window::same(3, 1));
    let x = b.norm(x, &format!("{name}.norm2"));
    let sum = b.add(x, skip);
    b.relu(sum)
}

//! The `MobileNetV2` backbone (Sandler et al. 2018, arXiv 1801.04381) as torchvision builds it, names included, without its last
//! convolution and its classifier.

use super::Builder;
use crate::graph::{NodeId, Op, Window};

/// What torchvision's names are put behind.
pub const PREFIX: &str = "backbone.body.";

/// The scale of the image, behind the prefix.
pub const INPUT: &str = "input";

/// Channels of the first convolution.
const STEM_CHANNELS: usize = 32;

/// The groups of blocks: expansion, channels, blocks, stride of the first of them (table 2 of the paper).
const GROUPS: [[usize; 4]; 7] =
    [[1, 16, 1, 1], [6, 24, 2, 2], [6, 32, 3, 2], [6, 64, 4, 2], [6, 96, 3, 1], [6, 160, 3, 2], [6, 320, 1, 1]];

/// Whose conventions a network follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Convention {
    /// Zeros on all sides; the image as our networks get it.
    Torchvision,
    /// The odd zero at the end ([`Window::tensorflow_same`]), and a scale of its own for the image, which comes with
    /// the weights.
    Tensorflow,
}

impl Convention {
    fn window(self, kernel: usize, stride: usize) -> Window {
        match self {
            Self::Torchvision => Window::same(kernel, stride),
            Self::Tensorflow => Window::tensorflow_same(kernel, stride),
        }
    }
}

/// Widths are multiples of this.
const WIDTH_STEP: usize = 8;

/// Appends the backbone with `width` times its channels; returns levels 0 to 5, of strides 2, 2, 4, 8, 16, 32: the last block of each stride.
pub fn mobilenet_v2(b: &mut Builder, image: NodeId, width: f64, convention: Convention) -> [NodeId; 6] {
    b.stage("base");
    let image = match convention {
        Convention::Torchvision => image,
        Convention::Tensorflow => b.fixed_scale(image, &format!("{PREFIX}{INPUT}")),
    };
    let stem = convention.window(3, 2);
    let mut x = conv_norm_relu6(b, image, &format!("{PREFIX}features.0"), scaled(STEM_CHANNELS, width), stem);
    // The stem, the map before each step down, and the last one.
    let mut levels = vec![x];
    let mut index = 0;
    for [expansion, channels, blocks, first_stride] in GROUPS {
        for block in 0..blocks {
            index += 1;
            let stride = if block == 0 { first_stride } else { 1 };
            if stride > 1 {
                levels.push(x);
            }
            let name = format!("{PREFIX}features.{index}.conv");
            x = inverted_residual(b, x, &name, expansion, scaled(channels, width), convention.window(3, stride));
        }
    }
    levels.push(x);
    let levels: [NodeId; 6] = std::array::from_fn(|i| levels[i]);
    for (i, level) in levels.into_iter().enumerate() {
        b.tap(&format!("level{i}"), level);
    }
    levels
}

/// Expansion, depthwise convolution, linear projection; a shortcut around them where the shapes allow it.
fn inverted_residual(
    b: &mut Builder,
    x: NodeId,
    name: &str,
    expansion: usize,
    channels: usize,
    window: Window,
) -> NodeId {
    let inputs = b.channels(x);
    let mut y = x;
    let mut part = 0;
    if expansion > 1 {
        y = conv_norm_relu6(b, y, &format!("{name}.0"), inputs * expansion, Window::same(1, 1));
        part = 1;
    }
    y = b.depthwise_conv(y, &format!("{name}.{part}.0"), window);
    y = b.norm(y, &format!("{name}.{part}.1"));
    y = b.map(Op::Relu6, y);
    y = b.conv(y, &format!("{name}.{}", part + 1), channels, Window::same(1, 1));
    y = b.norm(y, &format!("{name}.{}", part + 2));
    if window.stride == 1 && inputs == channels { b.add(x, y) } else { y }
}

fn conv_norm_relu6(b: &mut Builder, x: NodeId, name: &str, channels: usize, window: Window) -> NodeId {
    let x = b.conv(x, &format!("{name}.0"), channels, window);
    let x = b.norm(x, &format!("{name}.1"));
    b.map(Op::Relu6, x)
}

/// `width` times the channels, rounded to a multiple of eight but never down by more than a tenth (torchvision's `_make_divisible`).
fn scaled(channels: usize, width: f64) -> usize {
    let wanted = channels as f64 * width;
    let rounded = ((wanted + WIDTH_STEP as f64 / 2.0) as usize / WIDTH_STEP).max(1) * WIDTH_STEP;
    if (rounded as f64) < 0.9 * wanted { rounded + WIDTH_STEP } else { rounded }
}

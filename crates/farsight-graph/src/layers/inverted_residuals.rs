//! Backbones of inverted residuals (Sandler et al. 2018, arXiv 1801.04381): what `MobileNetV2` and `EfficientNet-Lite`
//! have in common. Names are those of torchvision's `MobileNetV2`.

use super::Builder;
use crate::graph::{NodeId, Op, Window};

/// What torchvision's names are put behind.
pub const PREFIX: &str = "backbone.body.";

/// The scale of the image, behind the prefix.
pub const INPUT: &str = "input";

/// Channels of the first convolution.
const STEM_CHANNELS: usize = 32;

/// Widths are multiples of this.
const WIDTH_STEP: usize = 8;

/// Blocks with the same output.
#[derive(Debug, Clone, Copy)]
pub struct Group {
    /// Channels inside a block, for each of its input.
    pub expansion: usize,
    /// Channels of the output.
    pub channels: usize,
    /// How many.
    pub blocks: usize,
    /// Stride of the first of them.
    pub stride: usize,
    /// Side of the depthwise convolutions.
    pub kernel: usize,
}

/// Whose conventions a network follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Convention {
    /// Zeros on all sides; the image as our networks get it.
    Torchvision,
    /// The odd zero at the end ([`Window::tensorflow_same`]), and a scale of its own for the image, which comes with
    /// the weights.
    Tensorflow,
    /// The same, where zeros are as in an image of 300 pixels, whatever the size: maps of odd sides are halved with as
    /// many zeros on both sides.
    Tensorflow300,
}

impl Convention {
    /// The window of a convolution that brings the map from `before` times the image's stride to `stride` times that.
    pub fn window(self, kernel: usize, before: usize, stride: usize) -> Window {
        let is_odd = 300_usize.div_ceil(before) % 2 == 1;
        match self {
            Self::Tensorflow300 if is_odd => Window::same(kernel, stride),
            Self::Torchvision => Window::same(kernel, stride),
            Self::Tensorflow | Self::Tensorflow300 => Window::tensorflow_same(kernel, stride),
        }
    }
}

/// Maps of the backbone.
#[derive(Debug, Clone)]
pub struct Maps {
    /// Of strides 2, 2, 4, 8, 16, 32: the last block of each stride.
    pub levels: [NodeId; 6],
    /// What each block with an expansion starts with, by the block's index (torchvision's `features.N`, from 2).
    pub expansions: Vec<(usize, NodeId)>,
}

impl Maps {
    /// The levels, as taps `level0` to `level5`.
    pub(super) fn tapped(self, b: &mut Builder) -> [NodeId; 6] {
        for (i, level) in self.levels.into_iter().enumerate() {
            b.tap(&format!("level{i}"), level);
        }
        self.levels
    }
}

/// Appends the first convolution, with `width` times its channels, and `groups`, which take the image's stride to 32.
pub(super) fn inverted_residuals(
    b: &mut Builder,
    image: NodeId,
    width: f64,
    groups: &[Group],
    convention: Convention,
) -> Maps {
    b.stage("base");
    let image = match convention {
        Convention::Torchvision => image,
        Convention::Tensorflow | Convention::Tensorflow300 => b.fixed_scale(image, &format!("{PREFIX}{INPUT}")),
    };
    let stem = convention.window(3, 1, 2);
    let mut x = conv_norm_relu6(b, image, &format!("{PREFIX}features.0"), scaled(STEM_CHANNELS, width), stem);
    // The stem, the map before each step down, and the last one.
    let mut levels = vec![x];
    let mut expansions = Vec::new();
    let (mut index, mut image_stride) = (0, 2);
    for group in groups {
        for block in 0..group.blocks {
            index += 1;
            let stride = if block == 0 { group.stride } else { 1 };
            if stride > 1 {
                levels.push(x);
            }
            let name = format!("{PREFIX}features.{index}.conv");
            let window = convention.window(group.kernel, image_stride, stride);
            let block = inverted_residual(b, x, &name, group, window);
            x = block.output;
            image_stride *= stride;
            expansions.extend(block.expansion.map(|expansion| (index, expansion)));
        }
    }
    levels.push(x);
    Maps { levels: std::array::from_fn(|i| levels[i]), expansions }
}

/// What a block makes.
struct Block {
    expansion: Option<NodeId>,
    output: NodeId,
}

/// Expansion, depthwise convolution, linear projection; a shortcut around them where the shapes allow it.
fn inverted_residual(b: &mut Builder, x: NodeId, name: &str, group: &Group, window: Window) -> Block {
    let (inputs, Group { expansion, channels, .. }) = (b.channels(x), *group);
    let expanded =
        (expansion > 1).then(|| conv_norm_relu6(b, x, &format!("{name}.0"), inputs * expansion, Window::same(1, 1)));
    let (mut y, part) = (expanded.unwrap_or(x), usize::from(expansion > 1));
    y = b.depthwise_conv(y, &format!("{name}.{part}.0"), window);
    y = b.norm(y, &format!("{name}.{part}.1"));
    y = b.map(Op::Relu6, y);
    y = b.conv(y, &format!("{name}.{}", part + 1), channels, Window::same(1, 1));
    y = b.norm(y, &format!("{name}.{}", part + 2));
    let output = if window.stride == 1 && inputs == channels { b.add(x, y) } else { y };
    Block { expansion: expanded, output }
}

/// Convolution `name.0`, norm `name.1`, `ReLU6`.
pub fn conv_norm_relu6(b: &mut Builder, x: NodeId, name: &str, channels: usize, window: Window) -> NodeId {
    let x = b.conv(x, &format!("{name}.0"), channels, window);
    let x = b.norm(x, &format!("{name}.1"));
    b.map(Op::Relu6, x)
}

/// `width` times the channels, rounded to a multiple of eight but never down by more than a tenth (torchvision's
/// `_make_divisible`, `EfficientNet`'s `round_filters`).
pub(super) fn scaled(channels: usize, width: f64) -> usize {
    let wanted = channels as f64 * width;
    let rounded = ((wanted + WIDTH_STEP as f64 / 2.0) as usize / WIDTH_STEP).max(1) * WIDTH_STEP;
    if (rounded as f64) < 0.9 * wanted { rounded + WIDTH_STEP } else { rounded }
}

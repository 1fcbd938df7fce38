//! The convolutions of `VGG-16` with batch norm (Simonyan and Zisserman 2015, arXiv 1409.1556) as torchvision builds it
//! (`vgg16_bn`), names included, without its classifier.

use super::Builder;
use crate::graph::{Init, NodeId, Op, Window};

/// Convolutions and channels of each stage.
const STAGES: [(usize, usize); 5] = [(2, 64), (2, 128), (3, 256), (3, 512), (3, 512)];

/// Widths are multiples of this.
const WIDTH_STEP: usize = 16;

/// Appends it over `image`, names behind `prefix`, with `width` times its channels; returns the maps of strides 1 to
/// 32: the last of each stage, and the last one pooled.
pub fn vgg16(b: &mut Builder, image: NodeId, prefix: &str, width: f64) -> [NodeId; 6] {
    b.stage("base");
    let mut levels = [image; 6];
    let (mut x, mut layer) = (image, 0);
    for (stage, (convolutions, channels)) in STAGES.into_iter().enumerate() {
        let steps = (channels as f64 * width / WIDTH_STEP as f64).round().max(1.0);
        let channels = steps as usize * WIDTH_STEP;
        for _ in 0..convolutions {
            let start = [Init::Normal((2.0 / (9 * channels) as f32).sqrt()), Init::Constant(0.0)];
            x = b.conv_started(x, &format!("{prefix}features.{layer}"), channels, Window::same(3, 1), start);
            x = b.norm(x, &format!("{prefix}features.{}", layer + 1));
            x = b.relu(x);
            // Convolution, norm and `ReLU` are a layer each.
            layer += 3;
        }
        levels[stage] = x;
        x = b.map(Op::max_of_tiles(2), x);
        layer += 1;
    }
    levels[5] = x;
    for (i, level) in levels.into_iter().enumerate() {
        b.tap(&format!("level{i}"), level);
    }
    levels
}

//! The `MobileNetV2` backbone (Sandler et al. 2018, arXiv 1801.04381) as torchvision builds it, names included, without
//! its last convolution and its classifier.

use super::Builder;
use super::inverted_residuals::{Convention, Group, Maps, inverted_residuals, scaled};
use crate::graph::NodeId;

/// Expansion, channels, blocks, stride of the first of them (table 2 of the paper).
const GROUPS: [[usize; 4]; 7] =
    [[1, 16, 1, 1], [6, 24, 2, 2], [6, 32, 3, 2], [6, 64, 4, 2], [6, 96, 3, 1], [6, 160, 3, 2], [6, 320, 1, 1]];

/// Appends the backbone with `width` times its channels; returns levels 0 to 5, of strides 2, 2, 4, 8, 16, 32: the last
/// block of each stride.
pub fn mobilenet_v2(b: &mut Builder, image: NodeId, width: f64, convention: Convention) -> [NodeId; 6] {
    mobilenet_v2_maps(b, image, width, convention).tapped(b)
}

/// As [`mobilenet_v2`], with the maps inside the blocks and without taps.
pub fn mobilenet_v2_maps(b: &mut Builder, image: NodeId, width: f64, convention: Convention) -> Maps {
    let groups = GROUPS.map(|[expansion, channels, blocks, stride]| {
        let channels = scaled(channels, width);
        Group { expansion, channels, blocks, stride, kernel: 3 }
    });
    inverted_residuals(b, image, width, &groups, convention)
}

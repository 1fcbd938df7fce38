//! The `EfficientNet-Lite` backbones (Tan and Le 2019, arXiv 1905.11946, without squeeze-and-excitation and with
//! `ReLU6`), without their last convolution and their classifier. Blocks have the names of
//! [`mobilenet_v2`](super::mobilenet_v2).

use super::Builder;
use super::inverted_residuals::{Convention, Group, inverted_residuals, scaled};
use crate::graph::NodeId;

/// Expansion, channels, blocks, stride of the first of them, side of the depthwise convolutions, of the smallest
/// network (table 1 of the paper).
const GROUPS: [[usize; 5]; 7] = [
    [1, 16, 1, 1, 3],
    [6, 24, 2, 2, 3],
    [6, 40, 2, 2, 5],
    [6, 80, 3, 2, 3],
    [6, 112, 3, 1, 5],
    [6, 192, 4, 2, 5],
    [6, 320, 1, 1, 3],
];

/// Which of the networks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EfficientnetLite {
    /// 16 blocks.
    Lite0,
    /// 21 blocks of the same channels.
    Lite1,
    /// 21 blocks of 1.1 times the channels.
    Lite2,
}

impl EfficientnetLite {
    /// Factors on channels and on blocks.
    fn factors(self) -> [f64; 2] {
        match self {
            Self::Lite0 => [1.0, 1.0],
            Self::Lite1 => [1.0, 1.1],
            Self::Lite2 => [1.1, 1.2],
        }
    }

    /// Appends the backbone with `width` times its channels; returns levels 0 to 5, of strides 2, 2, 4, 8, 16, 32: the
    /// last block of each stride. Zeros and the scale of the image are TensorFlow's.
    pub fn append(self, b: &mut Builder, image: NodeId, width: f64) -> [NodeId; 6] {
        let [wider, deeper] = self.factors();
        let groups = GROUPS.map(|[expansion, channels, blocks, stride, kernel]| {
            // The first and the last group have one block in all of these networks.
            let blocks = if blocks > 1 { (deeper * blocks as f64).ceil() as usize } else { blocks };
            Group { expansion, channels: scaled(channels, wider * width), blocks, stride, kernel }
        });
        inverted_residuals(b, image, width, &groups, Convention::Tensorflow).tapped(b)
    }
}

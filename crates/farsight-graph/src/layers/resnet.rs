//! `ResNet` of basic blocks (He et al. 2016, arXiv 1512.03385) as torchvision builds it, names included, without its
//! classifier.

use serde::{Deserialize, Serialize};

use super::Builder;
use crate::graph::{NodeId, Op, Window};

/// How many layers it has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Resnet {
    /// Two blocks a stage.
    #[default]
    Resnet18,
    /// 3, 4, 6 and 3 blocks.
    Resnet34,
}

impl Resnet {
    /// Its name in configs.
    pub fn name(self) -> &'static str {
        match self {
            Self::Resnet18 => "resnet18",
            Self::Resnet34 => "resnet34",
        }
    }

    /// Blocks of each stage.
    fn blocks(self) -> [usize; 4] {
        match self {
            Self::Resnet18 => [2; 4],
            Self::Resnet34 => [3, 4, 6, 3],
        }
    }

    /// Appends it over `image`, names behind `prefix`; returns the maps of strides 4, 8, 16 and 32, which have these
    /// channels.
    pub fn append(self, b: &mut Builder, image: NodeId, prefix: &str, channels: [usize; 4]) -> [NodeId; 4] {
        b.stage("base");
        let stem = Window { padding: 3, ..Window::same(7, 2) };
        let x = b.conv_norm_relu(image, &format!("{prefix}conv1"), &format!("{prefix}bn1"), channels[0], stem);
        let mut x = b.map(Op::MaxPool { kernel: 3, stride: 2, padding: 1 }, x);
        let mut maps = [x; 4];
        for (stage, blocks) in self.blocks().into_iter().enumerate() {
            for block in 0..blocks {
                let stride = if stage > 0 && block == 0 { 2 } else { 1 };
                x = basic_block(b, x, &format!("{prefix}layer{}.{block}", stage + 1), channels[stage], stride);
            }
            maps[stage] = x;
        }
        maps
    }
}

/// Two 3x3 convolutions with norms and a shortcut, which is projected where the shapes differ.
pub fn basic_block(b: &mut Builder, x: NodeId, name: &str, channels: usize, stride: usize) -> NodeId {
    let (conv, norm) = (format!("{name}.conv1"), format!("{name}.bn1"));
    let y = b.conv_norm_relu(x, &conv, &norm, channels, Window::same(3, stride));
    let y = b.conv(y, &format!("{name}.conv2"), channels, Window::same(3, 1));
    let y = b.norm(y, &format!("{name}.bn2"));
    let shortcut = if stride == 1 && b.channels(x) == channels {
        x
    } else {
        let projected = b.conv(x, &format!("{name}.downsample.0"), channels, Window::same(1, stride));
        b.norm(projected, &format!("{name}.downsample.1"))
    };
    let sum = b.add(y, shortcut);
    b.relu(sum)
}

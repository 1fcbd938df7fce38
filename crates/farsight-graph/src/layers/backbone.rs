//! The choice of a backbone, the same for every detector.

use serde::{Deserialize, Serialize};

use super::inverted_residuals::Convention;
use super::{Builder, EfficientnetLite, NeckKind, Resnet, Stem, dla_up, dla34, fpn, mobilenet_v2, vgg16};
use crate::graph::NodeId;

/// What makes the features of strides 4 to 32, and how they come together at stride 4.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Backbone {
    /// DLA-34 with its iterative neck, as SMOKE.
    #[default]
    Dla34,
    /// `MobileNetV2` with a feature pyramid. Weights that have seen photographs can be imported.
    MobilenetV2,
    /// The same with TensorFlow's padding, and its own scale of the image: for weights that learnt there.
    MobilenetV2Tensorflow,
    /// `EfficientNet-Lite0` with a feature pyramid. Weights that have seen photographs can be imported.
    EfficientnetLite0,
    /// The same with more blocks.
    EfficientnetLite1,
    /// The same with more blocks and channels.
    EfficientnetLite2,
    /// `ResNet-18` with a feature pyramid.
    Resnet18,
    /// `ResNet-34` with a feature pyramid.
    Resnet34,
    /// `VGG-16` with batch norm and a feature pyramid.
    Vgg16,
}

/// What torchvision's names are put behind.
const PREFIX: &str = "backbone.body.";

/// Channels of a `ResNet`'s stages.
const RESNET_CHANNELS: [usize; 4] = [64, 128, 256, 512];

/// Widths of a `ResNet` are multiples of this.
const WIDTH_STEP: usize = 16;

/// A `ResNet`'s levels; those of strides 1 and 2, which no pyramid reads, are that of stride 4.
fn resnet(kind: Resnet, b: &mut Builder, image: NodeId, width: f64) -> [NodeId; 6] {
    let scaled = |channels: usize| {
        let steps = (channels as f64 * width / WIDTH_STEP as f64).round().max(1.0);
        steps as usize * WIDTH_STEP
    };
    let [first, others @ ..] = kind.append(b, image, PREFIX, RESNET_CHANNELS.map(scaled));
    let [eighth, sixteenth, last] = others;
    let levels = [first, first, first, eighth, sixteenth, last];
    for (i, level) in levels.into_iter().enumerate().skip(2) {
        b.tap(&format!("level{i}"), level);
    }
    levels
}

impl Backbone {
    /// Its name in configs.
    pub fn name(self) -> &'static str {
        match self {
            Self::Dla34 => "dla34",
            Self::MobilenetV2 => "mobilenet_v2",
            Self::MobilenetV2Tensorflow => "mobilenet_v2_tensorflow",
            Self::EfficientnetLite0 => "efficientnet_lite0",
            Self::EfficientnetLite1 => "efficientnet_lite1",
            Self::EfficientnetLite2 => "efficientnet_lite2",
            Self::Resnet18 => "resnet18",
            Self::Resnet34 => "resnet34",
            Self::Vgg16 => "vgg16",
        }
    }

    /// Features at the strides 1 to 32 of `image`. `channels` and `stem` are DLA-34's, `width` is the factor on those
    /// of the others.
    pub fn levels(self, b: &mut Builder, image: NodeId, channels: [usize; 6], stem: Stem, width: f64) -> [NodeId; 6] {
        match self {
            Self::Dla34 => dla34(b, image, channels, stem),
            Self::MobilenetV2 => mobilenet_v2(b, image, width, Convention::Torchvision),
            Self::MobilenetV2Tensorflow => mobilenet_v2(b, image, width, Convention::Tensorflow),
            Self::EfficientnetLite0 => EfficientnetLite::Lite0.append(b, image, width),
            Self::EfficientnetLite1 => EfficientnetLite::Lite1.append(b, image, width),
            Self::EfficientnetLite2 => EfficientnetLite::Lite2.append(b, image, width),
            Self::Resnet18 => resnet(Resnet::Resnet18, b, image, width),
            Self::Resnet34 => resnet(Resnet::Resnet34, b, image, width),
            Self::Vgg16 => vgg16(b, image, PREFIX, width),
        }
    }

    /// The levels together at stride 4. `channels` are those of DLA-34's levels, `width` those of the feature pyramid
    /// of the others.
    pub fn neck(
        self,
        b: &mut Builder,
        levels: &[NodeId; 6],
        channels: [usize; 6],
        width: usize,
        kind: NeckKind,
    ) -> NodeId {
        match self {
            Self::Dla34 => dla_up(b, levels, channels, kind),
            _ => fpn(b, levels, width, kind),
        }
    }
}

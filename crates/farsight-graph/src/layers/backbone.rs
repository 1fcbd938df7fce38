//! The choice of a backbone, the same for every detector.

use serde::{Deserialize, Serialize};

use super::mobilenet_v2::Convention;
use super::{Builder, NeckKind, Stem, dla_up, dla34, fpn, mobilenet_v2};
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
}

impl Backbone {
    /// Its name in configs.
    pub fn name(self) -> &'static str {
        match self {
            Self::Dla34 => "dla34",
            Self::MobilenetV2 => "mobilenet_v2",
            Self::MobilenetV2Tensorflow => "mobilenet_v2_tensorflow",
        }
    }

    /// Features at the strides 1 to 32 of `image`. `channels` and `stem` are DLA-34's, `width` is the factor on those
    /// of the others.
    pub fn levels(self, b: &mut Builder, image: NodeId, channels: [usize; 6], stem: Stem, width: f64) -> [NodeId; 6] {
        match self {
            Self::Dla34 => dla34(b, image, channels, stem),
            Self::MobilenetV2 => mobilenet_v2(b, image, width, Convention::Torchvision),
            Self::MobilenetV2Tensorflow => mobilenet_v2(b, image, width, Convention::Tensorflow),
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
            Self::MobilenetV2 | Self::MobilenetV2Tensorflow => fpn(b, levels, width, kind),
        }
    }
}

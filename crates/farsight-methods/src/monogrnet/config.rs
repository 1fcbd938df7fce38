//! What a `MonoGRNet` is made of.

use farsight_core::ClassReference;
use farsight_core::input::{ChannelOrder, InputRules, Sampling};
use farsight_graph::layers::{Backbone, NormKind, Stem};
use serde::{Deserialize, Serialize};

use super::codec::Codec;
use crate::checks::{problem_of_classes, problem_of_focals, problem_of_input, problem_of_width};
use crate::input_spec::InputSpec;

/// Channels of DLA-34's levels.
const DLA_CHANNELS: [usize; 6] = [16, 32, 64, 128, 256, 512];

/// Channels of the backbone and of the rest are multiples of these.
const WIDTH_STEP: usize = 16;
const HEAD_STEP: usize = 8;

/// A network's description, as it stands in a config file and in the header of its weights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MonoGrNetConfig {
    /// Width and height of the network's input, pixels; multiples of 32.
    pub input: [usize; 2],
    /// Factor on all channels.
    pub width: f64,
    /// Factor on the channels behind the backbone instead of `width`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub head_width: Option<f64>,
    /// What makes the features; those of strides 8 and 32 are read.
    pub backbone: Backbone,
    /// The first convolutions of DLA-34.
    pub stem: Stem,
    /// Normalisation of the backbone.
    pub norm: NormKind,
    /// Focal length, pixels of the network's input, for which depths are learnt ([`farsight_core::DepthReference`]);
    /// without it they are the true ones under any camera.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_focal_px: Option<f64>,
    /// Whether each output pixel of a shrunken image is a mean over what it covers.
    pub antialias: bool,
    /// Classes in the order of the scores' channels, after the background.
    pub classes: Vec<ClassReference>,
    /// Smallest and largest focal length, pixels of the network's input, that the model was trained with.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub focal_range_px: Option<[f64; 2]>,
}

impl Default for MonoGrNetConfig {
    /// The authors': cars alone, 1248x384, VGG-16.
    fn default() -> Self {
        let mut classes = ClassReference::smoke();
        classes.truncate(1);
        classes[0].dimensions_lhw = [3.88, 1.53, 1.63];
        Self {
            input: [1248, 384],
            width: 1.0,
            head_width: None,
            backbone: Backbone::Vgg16,
            stem: Stem::Full,
            norm: NormKind::Batch,
            depth_focal_px: None,
            antialias: false,
            classes,
            focal_range_px: None,
        }
    }
}

impl MonoGrNetConfig {
    /// Channels of DLA-34's levels.
    pub(super) fn dla_channels(&self) -> [usize; 6] {
        DLA_CHANNELS.map(|channels| scaled(channels, self.width, WIDTH_STEP))
    }

    /// So many channels behind the backbone times their width.
    pub(super) fn head_channels(&self, channels: usize) -> usize {
        scaled(channels, self.head_width.unwrap_or(self.width), HEAD_STEP)
    }

    /// Scores of a cell or box: the background, then the classes.
    pub(super) fn scores(&self) -> usize {
        self.classes.len() + 1
    }

    /// How objects become the numbers that the network gives, and back.
    pub fn codec(&self) -> Codec {
        Codec { depth_focal_px: self.depth_focal_px }
    }

    /// How images become inputs.
    pub fn input_spec(&self) -> InputSpec {
        let sampling = if self.antialias { Sampling::Antialias } else { Sampling::PixelExact };
        let rules = InputRules { size: self.input, channels: ChannelOrder::Rgb, sampling };
        InputSpec { rules, camera_3x3: false, focal_range_px: self.focal_range_px }
    }

    /// What is wrong with the fields, if anything is.
    pub(super) fn problem_of_fields(&self) -> Option<String> {
        let backbone = || {
            let is_other = self.backbone != Backbone::Dla34;
            let wrong = is_other && (self.norm != NormKind::Batch || self.stem != Stem::Full);
            let name = self.backbone.name();
            wrong.then(|| format!("model.norm or model.stem does not fit {name}; expected batch and no choice of stem"))
        };
        problem_of_input(self.input)
            .or_else(|| problem_of_width("width", self.width))
            .or_else(|| problem_of_width("head_width", self.head_width?))
            .or_else(backbone)
            .or_else(|| problem_of_focals(self.depth_focal_px, self.focal_range_px))
            .or_else(|| problem_of_classes(&self.classes))
    }
}

/// So many channels times a width, in whole steps.
fn scaled(channels: usize, width: f64, step: usize) -> usize {
    let steps = (channels as f64 * width / step as f64).round().max(1.0);
    steps as usize * step
}

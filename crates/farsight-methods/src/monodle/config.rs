//! What a `MonoDLE` is made of.

use farsight_core::ClassReference;
use farsight_core::heatmap::HeatmapRule;
use farsight_core::input::{ChannelOrder, InputRules, Sampling};
use farsight_graph::layers::{Backbone, NeckKind, NormKind, Stem};
use serde::{Deserialize, Serialize};

use super::codec::Codec;
use crate::center_map::CenterMethod;
use crate::checks::{problem_of_classes, problem_of_focals};
use crate::input_spec::InputSpec;

/// A network's description, as it stands in a config file and in the header of its weights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MonoDleConfig {
    /// Width and height of the network's input, pixels; multiples of 32.
    pub input: [usize; 2],
    /// Factor on all channels.
    pub width: f64,
    /// What makes the features.
    pub backbone: Backbone,
    /// Channels between the two convolutions of a head, instead of 256 times `width`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub head_channels: Option<usize>,
    /// The first convolutions of DLA-34.
    pub stem: Stem,
    /// Normalisation.
    pub norm: NormKind,
    /// Convolutions of the neck.
    pub neck: NeckKind,
    /// Width of the target Gaussians.
    pub heatmap: HeatmapRule,
    /// Whether each output pixel of a shrunken image is a mean over what it covers.
    pub antialias: bool,
    /// Classes in the order of the heatmap's channels. Their sizes play no part: this network says metres.
    pub classes: Vec<ClassReference>,
    /// Virtual depth: the focal length, pixels of the network's input, under which the network's depth is the true
    /// depth. Without it the depth is taken as it is, as by the authors.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_focal_px: Option<f64>,
    /// Whether scores are multiplied by the probability, by the error bar, that the distance is right
    /// ([`farsight_core::Detection::place_score`]): the order that AP in space wants. The authors multiply by the
    /// inverse of the variance, which has no upper bound.
    pub certainty_in_score: bool,
    /// Smallest and largest focal length, pixels of the network's input, that the model was trained with.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub focal_range_px: Option<[f64; 2]>,
}

impl Default for MonoDleConfig {
    fn default() -> Self {
        Self {
            input: [1280, 384],
            width: 1.0,
            backbone: Backbone::Dla34,
            head_channels: None,
            stem: Stem::Full,
            norm: NormKind::Batch,
            neck: NeckKind::Concat,
            heatmap: HeatmapRule::CornerNetOriginal { min_overlap: 0.7, min_radius: 0.0 },
            antialias: false,
            classes: ClassReference::smoke(),
            depth_focal_px: None,
            certainty_in_score: false,
            focal_range_px: None,
        }
    }
}

impl MonoDleConfig {
    /// How images become inputs.
    pub fn input_spec(&self) -> InputSpec {
        let sampling = if self.antialias { Sampling::Antialias } else { Sampling::PixelExact };
        let rules = InputRules { size: self.input, channels: ChannelOrder::Rgb, sampling };
        InputSpec { rules, camera_3x3: false, focal_range_px: self.focal_range_px }
    }

    /// Encode and decode.
    pub fn codec(&self) -> Codec {
        Codec { depth_focal_px: self.depth_focal_px }
    }

    /// What is wrong with the fields, if anything is.
    pub(super) fn problem_of_fields(&self) -> Option<String> {
        let heatmap = || self.heatmap.problem().map(|problem| format!("model.heatmap: {problem}"));
        let features = self.features().problem();
        features
            .or_else(heatmap)
            .or_else(|| problem_of_focals(self.depth_focal_px, self.focal_range_px))
            .or_else(|| problem_of_classes(&self.classes))
    }
}

//! What a CenterNet for 3D boxes is made of.

use farsight_core::heatmap::HeatmapRule;
use farsight_core::input::{ChannelOrder, InputRules, Sampling};
use farsight_core::references::MAX_FOCAL_PX;
use farsight_core::{ClassReference, RangeError};
use farsight_graph::layers::{Backbone, NeckKind, NormKind, Stem};
use serde::{Deserialize, Serialize};

use super::codec::Codec;
use crate::input_spec::{InputSpec, SIZE_STEP};

/// Channels of DLA-34's levels, and between the convolutions of a head.
const CHANNELS: [usize; 6] = [16, 32, 64, 128, 256, 512];
const HEAD_CHANNELS: usize = 256;

/// Channels of the feature pyramid of other backbones.
const FPN_CHANNELS: usize = 64;

/// Widths are multiples of this.
const WIDTH_STEP: usize = 16;

/// The longest side of an input, pixels; a description from a stranger must not ask for all memory.
const MAX_SIDE: usize = 8192;

/// A network's description, as it stands in a config file and in the header of its weights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CenterNet3dConfig {
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
    /// Width of the target Gaussians; of the authors' code by default, with its larger radius.
    pub heatmap: HeatmapRule,
    /// Classes in the order of the heatmap's channels. Their sizes play no part: this network says metres.
    pub classes: Vec<ClassReference>,
    /// Virtual depth: the focal length, pixels of the network's input, under which the network's depth is the true
    /// depth. Without it the depth is taken as it is, as by the authors.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_focal_px: Option<f64>,
    /// Error bars, where they were fitted.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<RangeError>,
    /// Smallest and largest focal length, pixels of the network's input, that the model was trained with.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub focal_range_px: Option<[f64; 2]>,
}

impl Default for CenterNet3dConfig {
    fn default() -> Self {
        Self {
            input: [1280, 384],
            width: 1.0,
            backbone: Backbone::Dla34,
            head_channels: None,
            stem: Stem::Full,
            norm: NormKind::Batch,
            neck: NeckKind::Deformable,
            heatmap: HeatmapRule::CornerNetOriginal { min_overlap: 0.7, min_radius: 0.0 },
            classes: ClassReference::smoke(),
            depth_focal_px: None,
            error: None,
            focal_range_px: None,
        }
    }
}

impl CenterNet3dConfig {
    /// Channels of the six levels.
    pub fn channels(&self) -> [usize; 6] {
        CHANNELS.map(|channels| self.scaled(channels))
    }

    /// Channels between the two convolutions of a head.
    pub fn head_width(&self) -> usize {
        self.head_channels.unwrap_or_else(|| self.scaled(HEAD_CHANNELS))
    }

    /// Channels of the feature pyramid of a backbone other than DLA-34.
    pub fn neck_width(&self) -> usize {
        self.scaled(FPN_CHANNELS)
    }

    fn scaled(&self, channels: usize) -> usize {
        let steps = (channels as f64 * self.width / WIDTH_STEP as f64).round().max(1.0);
        steps as usize * WIDTH_STEP
    }

    /// How images become inputs.
    pub fn input_spec(&self) -> InputSpec {
        let rules = InputRules { size: self.input, channels: ChannelOrder::Rgb, sampling: Sampling::PixelExact };
        InputSpec { rules, camera_3x3: false, focal_range_px: self.focal_range_px }
    }

    /// Encode and decode.
    pub fn codec(&self) -> Codec {
        Codec { depth_focal_px: self.depth_focal_px }
    }

    /// What is wrong with the fields, if anything is.
    pub(super) fn problem_of_fields(&self) -> Option<String> {
        let [width, height] = self.input;
        if self.input.iter().any(|&side| side == 0 || !side.is_multiple_of(SIZE_STEP) || side > MAX_SIDE) {
            return Some(format!(
                "model.input is {width}x{height}; expected multiples of {SIZE_STEP} pixels, at most {MAX_SIDE}"
            ));
        }
        if !(self.width.is_finite() && self.width > 0.0 && self.width <= 8.0) {
            return Some(format!("model.width is {}; expected a factor above 0 and at most 8", self.width));
        }
        if self.head_channels.is_some_and(|channels| !(1..=4096).contains(&channels)) {
            return Some("model.head_channels is out of range; expected 1 to 4096".to_owned());
        }
        if self.backbone != Backbone::Dla34 && (self.norm != NormKind::Batch || self.stem != Stem::Full) {
            let name = self.backbone.name();
            return Some(format!("model.norm or model.stem does not fit {name}; expected batch and no choice of stem"));
        }
        if let Some(problem) = self.heatmap.problem() {
            return Some(format!("model.heatmap: {problem}"));
        }
        if let Some(focal_px) = self.depth_focal_px.filter(|focal_px| !(*focal_px > 0.0 && *focal_px <= MAX_FOCAL_PX)) {
            return Some(format!("model.depth_focal_px is {focal_px}; expected a positive number of pixels"));
        }
        if self.error.is_some_and(|fit| !fit.is_usable()) {
            return Some("model.error has numbers that no fit gives".to_owned());
        }
        if let Some([low, high]) = self.focal_range_px
            && !(low > 0.0 && low <= high && high <= MAX_FOCAL_PX)
        {
            let expected = format!("expected 0 < smallest <= largest <= {MAX_FOCAL_PX}");
            return Some(format!("model.focal_range_px is {low} to {high}; {expected}"));
        }
        self.problem_of_classes()
    }

    /// What is wrong with the classes, if anything is.
    fn problem_of_classes(&self) -> Option<String> {
        if self.classes.is_empty() {
            return Some("model.classes is empty; expected at least one class".to_owned());
        }
        let unusable = |class: &ClassReference| {
            let wrong = class.score.is_some_and(|score| !score.is_usable());
            wrong.then(|| format!("model.classes has {} with a score that no fit gives", class.class))
        };
        let names = ClassReference::problem_of_names(&self.classes).map(|problem| format!("model.classes {problem}"));
        let sizes = ClassReference::problem_of_sizes(&self.classes).map(|problem| format!("model.classes {problem}"));
        names.or(sizes).or_else(|| self.classes.iter().find_map(unusable))
    }
}

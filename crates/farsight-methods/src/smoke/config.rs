//! What a model is made of and what it was trained to see: the switches of the project, independent of each other.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use farsight_core::heatmap::HeatmapRule;
use farsight_core::input::{ChannelOrder, InputRules, Sampling};
use farsight_core::references::{MAX_FOCAL_PX, MAX_M};
use farsight_core::{Camera, ClassReference, DepthReference, RangeError};
use farsight_graph::layers::{Backbone, Msfe, NeckKind, NormKind, Stem};

use super::codec::Codec;
use super::targets::{HeatmapBox, TargetRules};
use crate::input_spec::{InputSpec, SIZE_STEP};

/// The longest side of an input, pixels; a description from a stranger must not ask for all memory.
pub const MAX_SIDE: usize = 8192;

/// Channels of SMOKE's levels 0 to 5.
const SMOKE_CHANNELS: [usize; 6] = [16, 32, 64, 128, 256, 512];

/// Channels between the two convolutions of SMOKE's heads.
const SMOKE_HEAD_WIDTH: usize = 256;

/// Channels of the feature pyramid that `MobileNetV2` has for a neck.
const FPN_CHANNELS: usize = 64;

/// Channels inside each MSFE design of the full-width network (MSFE/DGH spec section 3).
const MSFE_WIDTHS: [(Msfe, usize); 4] = [(Msfe::A, 128), (Msfe::B, 128), (Msfe::C, 192), (Msfe::Control, 128)];

/// Widths are multiples of this, so that group normalisation always has its groups.
const WIDTH_STEP: usize = 16;

/// The widest layer; like [`MAX_SIDE`], because a description may come from a stranger.
const MAX_WIDTH: usize = 4096;

/// What widths may be, for messages.
const WIDTHS: &str = "multiples of 16 from 16 to 4096";

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

fn is_width(channels: usize) -> bool {
    (WIDTH_STEP..=MAX_WIDTH).contains(&channels) && channels.is_multiple_of(WIDTH_STEP)
}

/// Habits of the official code that its checkpoints rely on; all off by default.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Quirks {
    /// Drop the fourth column of the projection (spec 5.6).
    pub camera_3x3: bool,
    /// Order of the input's colour channels.
    pub channels: ChannelOrder,
    /// Convention of the input warp.
    pub sampling: Sampling,
}

impl Quirks {
    /// The camera as the model sees it: complete, or without its fourth column for official checkpoints.
    pub fn camera(&self, camera: &Camera) -> Camera {
        if self.camera_3x3 { camera.without_fourth_column() } else { *camera }
    }
}

/// A model's description, as it stands in a config file and in the header of its weights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SmokeConfig {
    /// Width and height of the network's input, pixels; multiples of 32.
    pub input: [usize; 2],
    /// What makes the features. One other than DLA-34 has no `level_channels` and no choice of `stem`.
    #[serde(skip_serializing_if = "is_default")]
    pub backbone: Backbone,
    /// Factor on all channels.
    pub width: f64,
    /// Channels of the six levels, instead of SMOKE's times `width`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub level_channels: Option<[usize; 6]>,
    /// Channels of the feature pyramid (a backbone other than DLA-34), instead of 64 times `width`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub neck_channels: Option<usize>,
    /// Channels between the two convolutions of a head, instead of SMOKE's times `width`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub head_channels: Option<usize>,
    /// The first convolutions.
    pub stem: Stem,
    /// Normalisation.
    pub norm: NormKind,
    /// Convolutions of the neck.
    pub neck: NeckKind,
    /// Multi-scale feature enhancement.
    pub msfe: Msfe,
    /// Width of the target Gaussians.
    #[serde(alias = "heat_map")]
    pub heatmap: HeatmapRule,
    /// The box that the heatmap rule looks at.
    #[serde(alias = "heat_map_box")]
    pub heatmap_box: HeatmapBox,
    /// Classes in the order of the heatmap's channels; official SMOKE's is car, cyclist, pedestrian.
    pub classes: Vec<ClassReference>,
    /// Centres the depth.
    pub depth: DepthReference,
    /// Smallest and largest focal length, pixels of the network's input, that the model was trained with. Images of
    /// other cameras are scaled into this range, and users are told when that cannot be done.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub focal_range_px: Option<[f64; 2]>,
    /// Whether images that become smaller are freed of what is too fine for the input, instead of sampled
    /// (`Sampling::Antialias`).
    #[serde(skip_serializing_if = "is_default")]
    pub antialias: bool,
    /// Habits of the official code.
    pub quirks: Quirks,
}

impl Default for SmokeConfig {
    /// SMOKE.
    fn default() -> Self {
        Self {
            input: [1280, 384],
            backbone: Backbone::Dla34,
            width: 1.0,
            level_channels: None,
            neck_channels: None,
            head_channels: None,
            stem: Stem::Full,
            norm: NormKind::Group,
            neck: NeckKind::Deformable,
            msfe: Msfe::None,
            heatmap: HeatmapRule::SMOKE,
            heatmap_box: HeatmapBox::Projected,
            classes: ClassReference::smoke(),
            depth: DepthReference::KITTI,
            focal_range_px: None,
            antialias: false,
            quirks: Quirks::default(),
        }
    }
}

/// A model description that describes no model.
#[derive(Debug, Clone, PartialEq, Error)]
#[error("model.{field} {problem}")]
pub struct ConfigError {
    /// The field of the config.
    pub field: &'static str,
    /// What was found and what was expected.
    pub problem: String,
}

impl SmokeConfig {
    /// Checks every field.
    ///
    /// # Errors
    /// The first field that cannot be used, with what was found and what was expected.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let error = |field, problem| Err(ConfigError { field, problem });
        if self.input.iter().any(|&side| side == 0 || !side.is_multiple_of(SIZE_STEP)) {
            let [width, height] = self.input;
            return error("input", format!("is {width}x{height}; expected multiples of {SIZE_STEP} pixels"));
        }
        if self.input.iter().any(|&side| side > MAX_SIDE) {
            let [width, height] = self.input;
            return error("input", format!("is {width}x{height}; expected at most {MAX_SIDE} pixels a side"));
        }
        if !(self.width.is_finite() && self.width > 0.0 && self.width <= 8.0) {
            return error("width", format!("is {}; expected a factor above 0 and at most 8", self.width));
        }
        if let Some(channels) = self.level_channels
            && !channels.iter().all(|c| is_width(*c))
        {
            return error("level_channels", format!("is {channels:?}; expected six {WIDTHS}"));
        }
        for (field, channels) in [("head_channels", self.head_channels), ("neck_channels", self.neck_channels)] {
            if let Some(channels) = channels.filter(|channels| !is_width(*channels)) {
                return error(field, format!("is {channels}; expected one of the {WIDTHS}"));
            }
        }
        if let Some((field, problem)) = self.misfit_of_backbone() {
            return error(field, problem.to_owned());
        }
        if self.antialias && self.quirks.sampling != Sampling::default() {
            return error("antialias", "is true; expected quirks.sampling to be pixel_exact with it".to_owned());
        }
        if let Some(problem) = self.heatmap.problem() {
            return error("heatmap", problem);
        }
        if !self.depth.is_usable() {
            let DepthReference { mean_m, std_m, .. } = self.depth;
            let found = format!("has a mean of {mean_m} m and a deviation of {std_m} m");
            return error("depth", format!("{found}; expected a positive deviation and at most {MAX_M} m of each"));
        }
        if let Some(focal_px) = self.depth.focal_px
            && !(focal_px > 0.0 && focal_px <= MAX_FOCAL_PX)
        {
            let expected = format!("expected a positive number of pixels, at most {MAX_FOCAL_PX}");
            return error("depth.focal_px", format!("is {focal_px}; {expected}"));
        }
        if let Some(fit) = self.depth.error.filter(|fit| !fit.is_usable()) {
            let RangeError { bias, depth, score, cut } = fit;
            let found = format!("has bias {bias}, depth {depth}, score {score} and cut {cut}");
            return error("depth.error", format!("{found}; expected the numbers of a fit"));
        }
        if let Some([low, high]) = self.focal_range_px
            && !(low > 0.0 && low <= high && high <= MAX_FOCAL_PX)
        {
            let expected = format!("expected 0 < smallest <= largest <= {MAX_FOCAL_PX}");
            return error("focal_range_px", format!("is {low} to {high}; {expected}"));
        }
        self.validate_classes()
    }

    /// A field that the backbone has no use for, or that it asks for and has not.
    fn misfit_of_backbone(&self) -> Option<(&'static str, &'static str)> {
        let of_dla34 = "is for the backbone dla34; expected none";
        match self.backbone {
            Backbone::Dla34 => self.neck_channels.map(|_| ("neck_channels", "is for other backbones than dla34")),
            _ => [
                (self.level_channels.is_some(), ("level_channels", of_dla34)),
                (self.stem != Stem::Full, ("stem", of_dla34)),
                // Many of its layers have 24 channels, which are no 16 groups.
                (self.norm != NormKind::Batch, ("norm", "is group; expected batch with this backbone")),
            ]
            .into_iter()
            .find_map(|(wrong, problem)| wrong.then_some(problem)),
        }
    }

    fn validate_classes(&self) -> Result<(), ConfigError> {
        let error = |problem| Err(ConfigError { field: "classes", problem });
        if self.classes.is_empty() {
            return error("is empty; expected at least one class".to_owned());
        }
        if let Some(problem) = ClassReference::problem_of_names(&self.classes) {
            return error(problem);
        }
        if let Some(problem) = ClassReference::problem_of_sizes(&self.classes) {
            return error(problem);
        }
        for class in &self.classes {
            if class.score.is_some_and(|score| !score.is_usable()) {
                let expected = "expected finite numbers and heights_px with 0 < smallest <= largest";
                return error(format!("has {} with a score that no fit gives; {expected}", class.class));
            }
        }
        Ok(())
    }

    /// Channels of DLA-34's six levels.
    pub fn channels(&self) -> [usize; 6] {
        self.level_channels.unwrap_or_else(|| SMOKE_CHANNELS.map(|c| self.scaled(c)))
    }

    /// Channels of the feature pyramid.
    pub fn neck_width(&self) -> usize {
        self.neck_channels.unwrap_or_else(|| self.scaled(FPN_CHANNELS))
    }

    /// Channels between the two convolutions of a head.
    pub fn head_width(&self) -> usize {
        self.head_channels.unwrap_or_else(|| self.scaled(SMOKE_HEAD_WIDTH))
    }

    /// Channels inside the MSFE block; 0 without one.
    pub fn msfe_width(&self) -> usize {
        MSFE_WIDTHS.iter().find(|(msfe, _)| *msfe == self.msfe).map_or(0, |&(_, width)| self.scaled(width))
    }

    /// How images become inputs.
    pub fn input_spec(&self) -> InputSpec {
        InputSpec { rules: self.input_rules(), camera_3x3: self.quirks.camera_3x3, focal_range_px: self.focal_range_px }
    }

    /// What the network expects of its input.
    pub fn input_rules(&self) -> InputRules {
        let sampling = if self.antialias { Sampling::Antialias } else { self.quirks.sampling };
        InputRules { size: self.input, channels: self.quirks.channels, sampling }
    }

    /// Whether scores or error bars were fitted on labelled frames; such answers belong to the size of the input.
    pub fn has_fitted_answers(&self) -> bool {
        self.depth.error.is_some() || self.classes.iter().any(|class| class.score.is_some())
    }

    /// Encode and decode.
    pub fn codec(&self) -> Codec {
        Codec { classes: self.classes.clone(), depth: self.depth }
    }

    /// How targets are made.
    pub fn target_rules(&self) -> TargetRules {
        TargetRules { codec: self.codec(), heatmap: self.heatmap, heatmap_box: self.heatmap_box }
    }

    fn scaled(&self, channels: usize) -> usize {
        let steps = (channels as f64 * self.width / WIDTH_STEP as f64).round().max(1.0);
        steps as usize * WIDTH_STEP
    }
}

//! What an `OFTNet` is made of.

use farsight_core::input::{ChannelOrder, InputRules, Sampling};
use farsight_core::{ClassReference, ObjectClass};
use farsight_graph::layers::Resnet;
use serde::{Deserialize, Serialize};

use super::codec::Codec;
use super::grid::Grid;
use crate::checks::{problem_of_classes, problem_of_focals, problem_of_input, problem_of_width};
use crate::input_spec::InputSpec;

/// Channels of the `ResNet`'s stages, and of the maps and the grid.
const BACKBONE_CHANNELS: [usize; 4] = [64, 128, 256, 512];
const CHANNELS: usize = 256;

/// Groups of the group norms (authors' code); widths are multiples of this.
pub(super) const GROUPS: usize = 16;

/// No network has more blocks on its grid.
const MAX_BLOCKS: usize = 64;

/// A network's description, as it stands in a config file and in the header of its weights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OftNetConfig {
    /// Width and height of the network's input, pixels; multiples of 32.
    pub input: [usize; 2],
    /// What looks at the image.
    pub backbone: Resnet,
    /// Factor on all channels.
    pub width: f64,
    /// Residual blocks on the grid.
    pub blocks: usize,
    /// The grid on the ground.
    pub grid: Grid,
    /// Whether each output pixel of a shrunken image is a mean over what it covers.
    pub antialias: bool,
    /// Classes in the order of the output's channels. Sizes are learnt relative to theirs.
    pub classes: Vec<ClassReference>,
    /// Smallest and largest focal length, pixels of the network's input, that the model was trained with.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub focal_range_px: Option<[f64; 2]>,
}

impl Default for OftNetConfig {
    fn default() -> Self {
        // exp(1.35), exp(0.42) and exp(0.48) m, the authors' means.
        let dimensions_lhw = [3.857, 1.522, 1.616];
        let car = ClassReference { class: ObjectClass::Car, dimensions_lhw, heatmap_factor: 1.0, score: None };
        Self {
            input: [1280, 384],
            backbone: Resnet::default(),
            width: 1.0,
            blocks: 8,
            grid: Grid::default(),
            antialias: false,
            classes: vec![car],
            focal_range_px: None,
        }
    }
}

impl OftNetConfig {
    /// Channels of the maps and of the grid.
    pub fn channels(&self) -> usize {
        self.scaled(CHANNELS)
    }

    /// Channels of the backbone's stages.
    pub fn backbone_channels(&self) -> [usize; 4] {
        BACKBONE_CHANNELS.map(|channels| self.scaled(channels))
    }

    fn scaled(&self, channels: usize) -> usize {
        let groups = (channels as f64 * self.width / GROUPS as f64).round().max(1.0);
        groups as usize * GROUPS
    }

    /// How images become inputs.
    pub fn input_spec(&self) -> InputSpec {
        let sampling = if self.antialias { Sampling::Antialias } else { Sampling::PixelExact };
        let rules = InputRules { size: self.input, channels: ChannelOrder::Rgb, sampling };
        InputSpec { rules, camera_3x3: false, focal_range_px: self.focal_range_px }
    }

    /// Encode and decode.
    pub fn codec(&self) -> Codec<'_> {
        Codec { grid: &self.grid, classes: &self.classes }
    }

    /// What is wrong with the fields, if anything is.
    pub(super) fn problem_of_fields(&self) -> Option<String> {
        let problem = problem_of_input(self.input).or_else(|| problem_of_width("width", self.width));
        if problem.is_some() {
            return problem;
        }
        if !(1..=MAX_BLOCKS).contains(&self.blocks) {
            return Some(format!("model.blocks is {}; expected 1 to {MAX_BLOCKS}", self.blocks));
        }
        let grid = self.grid.problem().map(|problem| format!("model.grid {problem}"));
        grid.or_else(|| problem_of_focals(None, self.focal_range_px)).or_else(|| problem_of_classes(&self.classes))
    }
}

//! What a GS3D is made of.

use farsight_core::ClassReference;
use farsight_core::heatmap::HeatmapRule;
use farsight_core::input::{ChannelOrder, InputRules, Sampling};
use farsight_graph::layers::{Backbone, NeckKind, NormKind, Stem};
use serde::{Deserialize, Serialize};

use super::refinement::{NUMBERS, Refinement};
use crate::center_map::Features;
use crate::checks::{problem_of_classes, problem_of_focals};
use crate::input_spec::InputSpec;

/// No network has more channels there.
const MAX_CHANNELS: usize = 4096;

/// Standard deviations of the guidance's errors on the 7,834 cars of KITTI's training split that are Moderate or
/// easier, from their annotated boxes and angles: x, y, z, height, width and length, metres. An annotated angle has no
/// error; that of the yaw, radians, is of a detector's.
const KITTI_WIDTHS: [f64; NUMBERS] = [0.96, 0.15, 2.57, 0.15, 0.10, 0.44, 0.15];

/// A network's description, as it stands in a config file and in the header of its weights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Gs3dConfig {
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
    /// Channels of what is read at surfaces.
    pub surface_channels: usize,
    /// Channels between surfaces and bins.
    pub hidden: usize,
    /// Width of the bins of x, y, z, height, width, length (metres) and yaw (radians): the standard deviation of the
    /// guidance's errors.
    pub bin_widths: [f64; NUMBERS],
    /// Width of the target Gaussians.
    pub heatmap: HeatmapRule,
    /// Whether each output pixel of a shrunken image is a mean over what it covers.
    pub antialias: bool,
    /// Classes in the order of the heatmap's channels, with the mean sizes that the guidance goes by.
    pub classes: Vec<ClassReference>,
    /// Smallest and largest focal length, pixels of the network's input, that the model was trained with.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub focal_range_px: Option<[f64; 2]>,
}

impl Default for Gs3dConfig {
    fn default() -> Self {
        let mut classes = ClassReference::smoke();
        // Official SMOKE has height and width of cars exchanged; here they count.
        classes[0].dimensions_lhw = [3.88, 1.53, 1.63];
        Self {
            input: [1280, 384],
            width: 1.0,
            backbone: Backbone::Vgg16,
            head_channels: None,
            stem: Stem::Full,
            norm: NormKind::Batch,
            neck: NeckKind::Plain,
            surface_channels: 64,
            hidden: 256,
            bin_widths: KITTI_WIDTHS,
            heatmap: HeatmapRule::CornerNetOriginal { min_overlap: 0.7, min_radius: 0.0 },
            antialias: false,
            classes,
            focal_range_px: None,
        }
    }
}

impl Gs3dConfig {
    /// What makes the features.
    pub(super) fn features(&self) -> Features {
        let Self { input, width, backbone, head_channels, stem, norm, neck, .. } = *self;
        Features { input, width, backbone, head_channels, stem, norm, neck }
    }

    /// How images become inputs.
    pub fn input_spec(&self) -> InputSpec {
        let sampling = if self.antialias { Sampling::Antialias } else { Sampling::PixelExact };
        let rules = InputRules { size: self.input, channels: ChannelOrder::Rgb, sampling };
        InputSpec { rules, camera_3x3: false, focal_range_px: self.focal_range_px }
    }

    /// What refines guidances.
    pub fn refinement(&self) -> Refinement {
        Refinement { widths: self.bin_widths }
    }

    /// Height, width and length, metres, of a class.
    pub(super) fn mean_size(&self, class: usize) -> [f64; 3] {
        let [length, height, width] = self.classes[class].dimensions_lhw;
        [height, width, length]
    }

    /// What is wrong with the fields, if anything is.
    pub(super) fn problem_of_fields(&self) -> Option<String> {
        let counts = [("surface_channels", self.surface_channels), ("hidden", self.hidden)];
        let count = || {
            let wrong = counts.iter().find(|(_, count)| !(1..=MAX_CHANNELS).contains(count));
            wrong.map(|(name, count)| format!("model.{name} is {count}; expected 1 to {MAX_CHANNELS}"))
        };
        let widths = || {
            let wrong = self.bin_widths.iter().find(|width| !(**width > 0.0 && **width < 100.0));
            wrong.map(|width| format!("model.bin_widths has {width}; expected positive numbers below 100"))
        };
        let heatmap = || self.heatmap.problem().map(|problem| format!("model.heatmap: {problem}"));
        let features = self.features().problem();
        features
            .or_else(count)
            .or_else(widths)
            .or_else(heatmap)
            .or_else(|| problem_of_focals(None, self.focal_range_px))
            .or_else(|| problem_of_classes(&self.classes))
    }
}

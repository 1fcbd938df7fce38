//! Backbone, neck and heads.

use farsight_graph::graph::{Init, NodeId, Window};
use farsight_graph::layers::{Backbone, Builder, NeckKind, NormKind, Stem};

use crate::checks::{problem_of_input, problem_of_width};

/// Channels of DLA-34's levels, and between the convolutions of a head.
const CHANNELS: [usize; 6] = [16, 32, 64, 128, 256, 512];
const HEAD_CHANNELS: usize = 256;

/// Channels of the feature pyramid of other backbones.
const FPN_CHANNELS: usize = 64;

/// Widths are multiples of this.
const WIDTH_STEP: usize = 16;

/// Logit at which a heatmap starts: a probability near 0.1.
pub(crate) const PRIOR_LOGIT: f32 = -2.19;

/// What makes the features, as the configs of these methods say it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Features {
    /// Width and height of the network's input, pixels.
    pub input: [usize; 2],
    /// Factor on all channels.
    pub width: f64,
    /// What makes the levels.
    pub backbone: Backbone,
    /// Channels between the two convolutions of a head, instead of 256 times `width`.
    pub head_channels: Option<usize>,
    /// The first convolutions of DLA-34.
    pub stem: Stem,
    /// Normalisation.
    pub norm: NormKind,
    /// Convolutions of the neck.
    pub neck: NeckKind,
}

impl Features {
    /// Channels of the six levels.
    pub(crate) fn channels(&self) -> [usize; 6] {
        CHANNELS.map(|channels| self.scaled(channels))
    }

    /// Channels between the two convolutions of a head.
    pub(crate) fn head_width(&self) -> usize {
        self.head_channels.unwrap_or_else(|| self.scaled(HEAD_CHANNELS))
    }

    fn scaled(&self, channels: usize) -> usize {
        let steps = (channels as f64 * self.width / WIDTH_STEP as f64).round().max(1.0);
        steps as usize * WIDTH_STEP
    }

    /// Appends them to a graph; returns the map at stride 4.
    pub(crate) fn append(&self, b: &mut Builder) -> NodeId {
        let channels = self.channels();
        let image = b.input(3);
        let levels = self.backbone.levels(b, image, channels, self.stem, self.width);
        self.backbone.neck(b, &levels, channels, self.scaled(FPN_CHANNELS), self.neck)
    }

    /// What is wrong with them, if anything is.
    pub(crate) fn problem(&self) -> Option<String> {
        if let Some(problem) = problem_of_input(self.input) {
            return Some(problem);
        }
        if let Some(problem) = problem_of_width("width", self.width) {
            return Some(problem);
        }
        if self.head_channels.is_some_and(|channels| !(1..=4096).contains(&channels)) {
            return Some("model.head_channels is out of range; expected 1 to 4096".to_owned());
        }
        if self.backbone != Backbone::Dla34 && (self.norm != NormKind::Batch || self.stem != Stem::Full) {
            let name = self.backbone.name();
            return Some(format!("model.norm or model.stem does not fit {name}; expected batch and no choice of stem"));
        }
        if self.backbone != Backbone::Dla34 && self.neck == NeckKind::Concat {
            let name = self.backbone.name();
            return Some(format!("model.neck is concat, which does not fit {name}; expected plain or deformable"));
        }
        None
    }
}

/// A 3x3 convolution, `ReLU`, a 1x1 convolution, biases from zero. Weights start as `weights` says, `PyTorch`'s way
/// without it; the last bias starts at `bias`.
pub(crate) fn head(
    b: &mut Builder,
    x: NodeId,
    name: &'static str,
    [width, channels]: [usize; 2],
    weights: Option<Init>,
    bias: f32,
) -> NodeId {
    b.stage(name);
    let conv = |b: &mut Builder, x: NodeId, part: usize, [channels, kernel]: [usize; 2], bias: f32| {
        let (name, bias) = (format!("heads.{name}.{part}"), Init::Constant(bias));
        match weights {
            Some(weights) => b.conv_started(x, &name, channels, Window::same(kernel, 1), [weights, bias]),
            None => b.conv_with_bias(x, &name, channels, kernel, Some(bias)),
        }
    };
    let x = conv(b, x, 0, [width, 3], 0.0);
    let x = b.relu(x);
    conv(b, x, 2, [channels, 1], bias)
}

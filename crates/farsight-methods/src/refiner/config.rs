//! The refining network: its config and its graph.

use farsight_graph::graph::Graph;
use farsight_graph::layers::{Builder, NormKind};
use farsight_graph::model::NetworkConfig;
use serde::{Deserialize, Serialize};

use super::Cascade;
use super::geometry::{INPUT_CHANNELS, KINDS, PLACE_CHANNELS, StageFusion};
use crate::method::Method;
use crate::roi::ANSWER;
use crate::roi::network::{RoiBackbone, features, mobilenet_features, problem_of_sizes};

/// A refining network.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RefinerConfig {
    /// Pixels a side of the cut-out; a multiple of 16, of 32 for `MobileNetV2`.
    pub side: usize,
    /// What makes the features.
    #[serde(skip_serializing_if = "is_residual")]
    pub backbone: RoiBackbone,
    /// Channels of the four residual levels.
    pub channels: [usize; 4],
    /// Channels between the last map and the answer.
    pub hidden: usize,
    /// How its answers and the detector's go together.
    #[serde(alias = "looks")]
    pub fusion: StageFusion,
    /// Which objects another iteration pays for.
    #[serde(skip_serializing_if = "is_unfitted")]
    pub cascade: Cascade,
}

impl Default for RefinerConfig {
    fn default() -> Self {
        let (backbone, channels) = (RoiBackbone::default(), [24, 48, 96, 160]);
        let (fusion, cascade) = (StageFusion::default(), Cascade::default());
        Self { side: 96, backbone, channels, hidden: 192, fusion, cascade }
    }
}

/// Files of before there was a choice do not name it.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_residual(backbone: &RoiBackbone) -> bool {
    *backbone == RoiBackbone::Residual
}

/// Files of before there was a cascade do not name it.
fn is_unfitted(cascade: &Cascade) -> bool {
    *cascade == Cascade::default()
}

impl NetworkConfig for RefinerConfig {
    const METHOD: &'static str = "refiner";
    const NAME: &'static str = "a refiner";
    const OUTPUTS: &'static [&'static str] = &[ANSWER];

    fn problem(&self) -> Option<String> {
        let Self { side, backbone, channels, hidden, fusion, cascade } = self;
        let multiple = backbone.stride(channels.len());
        let unusable = || format!("model.fusion is {fusion:?}; expected the numbers of a fit");
        let no_cascade = || format!("model.cascade is {cascade:?}; expected scores of a fit");
        problem_of_sizes("model", *side, multiple, channels, *hidden)
            .or_else(|| (!fusion.is_usable()).then(unusable))
            .or_else(|| (!cascade.is_usable()).then(no_cascade))
    }

    /// # Shapes
    /// From `[batch, 6, side, side]` to `[batch, 16, 1, 1]`: the place, then the kinds.
    fn graph(&self) -> Graph {
        let mut b = Builder::new(NormKind::Batch);
        let input = b.input(INPUT_CHANNELS);
        b.stage("refiner");
        let x = match self.backbone {
            RoiBackbone::Residual => features(&mut b, input, self.side, &self.channels, self.hidden),
            RoiBackbone::MobilenetV2 => mobilenet_features(&mut b, input, self.side, self.hidden),
        };
        let place = b.conv_with_bias(x, "answer", PLACE_CHANNELS, 1, None);
        let kinds = b.conv_with_bias(x, "kinds", KINDS, 1, None);
        let answer = b.concat(&[place, kinds]);
        b.tap(ANSWER, answer);
        b.finish()
    }
}

impl Method for RefinerConfig {
    fn counted_input(&self) -> [usize; 2] {
        [self.side; 2]
    }

    fn facts(&self) -> Vec<(&'static str, String)> {
        let Self { side, backbone, channels, fusion, .. } = self;
        let backbone = match backbone {
            RoiBackbone::Residual => format!("{}, channels {channels:?}", backbone.name()),
            RoiBackbone::MobilenetV2 => backbone.name().to_owned(),
        };
        let depths = if fusion.depths.is_second_alone {
            "distances are the refiner's alone".to_owned()
        } else {
            format!("errors correlated by {:.2}", fusion.depths.correlation)
        };
        vec![
            ("refiner", format!("refines each object, cut out at {side} x {side} pixels")),
            ("backbone", backbone),
            ("detector and refiner", depths),
        ]
    }
}

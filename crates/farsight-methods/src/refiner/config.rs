//! The refining network: its config and its graph.

use farsight_graph::graph::Graph;
use farsight_graph::layers::{Builder, NormKind};
use farsight_graph::model::NetworkConfig;
use serde::{Deserialize, Serialize};

use super::geometry::{INPUT_CHANNELS, KINDS, PLACE_CHANNELS, StageFusion};
use crate::method::Method;
use crate::roi::ANSWER;
use crate::roi::network::{features, problem_of_sizes};

/// A refining network.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RefinerConfig {
    /// Pixels a side of the cut-out; a multiple of 16.
    pub side: usize,
    /// Channels of the four levels.
    pub channels: [usize; 4],
    /// Channels between the last map and the answer.
    pub hidden: usize,
    /// How its answers and the detector's go together.
    #[serde(alias = "looks")]
    pub fusion: StageFusion,
}

impl Default for RefinerConfig {
    fn default() -> Self {
        Self { side: 96, channels: [24, 48, 96, 160], hidden: 192, fusion: StageFusion::default() }
    }
}

impl NetworkConfig for RefinerConfig {
    const METHOD: &'static str = "refiner";
    const NAME: &'static str = "a refiner";
    const OUTPUTS: &'static [&'static str] = &[ANSWER];

    fn problem(&self) -> Option<String> {
        let Self { side, channels, hidden, fusion } = self;
        let unusable = || format!("model.fusion is {fusion:?}; expected the numbers of a fit");
        problem_of_sizes("model", *side, channels, *hidden).or_else(|| (!fusion.is_usable()).then(unusable))
    }

    /// # Shapes
    /// From `[batch, 6, side, side]` to `[batch, 16, 1, 1]`: the place, then the kinds.
    fn graph(&self) -> Graph {
        let mut b = Builder::new(NormKind::Batch);
        let input = b.input(INPUT_CHANNELS);
        b.stage("refiner");
        let x = features(&mut b, input, self.side, &self.channels, self.hidden);
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
        let Self { side, channels, fusion, .. } = self;
        vec![
            ("refiner", format!("refines each object, cut out at {side} x {side} pixels")),
            ("channels", format!("{channels:?}")),
            ("detector and refiner", format!("errors correlated by {:.2}", fusion.depths.correlation)),
        ]
    }
}

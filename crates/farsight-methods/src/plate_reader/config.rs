//! The network that reads number plates: its config and its graph.

use farsight_core::DepthFusion;
use farsight_graph::graph::Graph;
use farsight_graph::layers::{Builder, NormKind};
use farsight_graph::model::NetworkConfig;
use serde::{Deserialize, Serialize};

use super::geometry::{ANSWER_CHANNELS, INPUT_CHANNELS};
use crate::method::Method;
use crate::roi::ANSWER;
use crate::roi::network::{features, problem_of_sizes};

/// A plate reader.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PlateReaderConfig {
    /// Pixels a side of the cut-out; a multiple of 8.
    pub side: usize,
    /// Channels of the three levels.
    pub channels: [usize; 3],
    /// Channels between the last map and the answer.
    pub hidden: usize,
    /// How its depths and those known before go together.
    pub depths: DepthFusion,
}

impl Default for PlateReaderConfig {
    fn default() -> Self {
        Self { side: 72, channels: [24, 48, 96], hidden: 128, depths: DepthFusion::default() }
    }
}

impl NetworkConfig for PlateReaderConfig {
    const METHOD: &'static str = "plate_reader";
    const NAME: &'static str = "a plate reader";
    const OUTPUTS: &'static [&'static str] = &[ANSWER];

    fn problem(&self) -> Option<String> {
        let Self { side, channels, hidden, depths } = self;
        let unusable = || format!("model.depths is {depths:?}; expected the numbers of a fit");
        problem_of_sizes("model", *side, 1 << channels.len(), channels, *hidden)
            .or_else(|| (!depths.is_usable()).then(unusable))
    }

    /// # Shapes
    /// From `[batch, 3, side, side]` to `[batch, 3, 1, 1]`.
    fn graph(&self) -> Graph {
        let mut b = Builder::new(NormKind::Batch);
        let input = b.input(INPUT_CHANNELS);
        b.stage("plate reader");
        let x = features(&mut b, input, self.side, &self.channels, self.hidden);
        let answer = b.conv_with_bias(x, "answer", ANSWER_CHANNELS, 1, None);
        b.tap(ANSWER, answer);
        b.finish()
    }
}

impl Method for PlateReaderConfig {
    fn counted_input(&self) -> [usize; 2] {
        [self.side; 2]
    }

    fn facts(&self) -> Vec<(&'static str, String)> {
        let Self { side, channels, depths, .. } = self;
        vec![
            ("plate reader", format!("measures cars by their number plates, cut out at {side} x {side} pixels")),
            ("channels", format!("{channels:?}")),
            ("plates and boxes", format!("errors correlated by {:.2}", depths.correlation)),
        ]
    }
}

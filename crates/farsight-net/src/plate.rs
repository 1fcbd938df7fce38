//! The plate reader: a small network that says how wide a number plate is ([`farsight_core::plate`]).

use farsight_core::Agreement;
use farsight_core::plate::{ANSWER_CHANNELS, INPUT_CHANNELS};
use serde::{Deserialize, Serialize};

use crate::build::{Builder, NormKind};
use crate::graph::Graph;
use crate::part::{ANSWER, PartConfig, PartModel, features, problem_of_sizes};

/// A plate reader with its weights.
pub type PlateModel = PartModel<PlateConfig>;

/// A plate reader.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PlateConfig {
    /// Pixels a side of the cut-out; a multiple of 8.
    pub side: usize,
    /// Channels of the three levels.
    pub channels: [usize; 3],
    /// Channels between the last map and the answer.
    pub hidden: usize,
    /// How its depths and those known before go together.
    pub depths: Agreement,
}

impl Default for PlateConfig {
    fn default() -> Self {
        Self { side: 72, channels: [24, 48, 96], hidden: 128, depths: Agreement::default() }
    }
}

impl PartConfig for PlateConfig {
    const NAME: &'static str = "a plate reader";
    const KEY: &'static str = "farsight.plates";

    fn problem(&self) -> Option<String> {
        let Self { side, channels, hidden, depths } = self;
        let unusable = || format!("plates.depths is {depths:?}; expected the numbers of a fit");
        problem_of_sizes("plates", *side, channels, *hidden).or_else(|| (!depths.is_usable()).then(unusable))
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

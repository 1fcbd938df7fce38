//! The refining network: a small one that looks at one object at a time ([`farsight_core::refine`]).

use farsight_core::refine::{INPUT_CHANNELS, KINDS, PLACE_CHANNELS, TwoLooks};
use serde::{Deserialize, Serialize};

use crate::build::{Builder, NormKind};
use crate::graph::Graph;
use crate::part::{ANSWER, PartConfig, PartModel, features, problem_of_sizes};

/// A refining network with its weights.
pub type RefinerModel = PartModel<RefinerConfig>;

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
    pub looks: TwoLooks,
}

impl Default for RefinerConfig {
    fn default() -> Self {
        Self { side: 96, channels: [24, 48, 96, 160], hidden: 192, looks: TwoLooks::default() }
    }
}

impl PartConfig for RefinerConfig {
    const NAME: &'static str = "a refiner";
    const KEY: &'static str = "farsight.refiner";

    fn problem(&self) -> Option<String> {
        let Self { side, channels, hidden, looks } = self;
        let unusable = || format!("refiner.looks is {looks:?}; expected the numbers of a fit");
        problem_of_sizes("refiner", *side, channels, *hidden).or_else(|| (!looks.is_usable()).then(unusable))
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

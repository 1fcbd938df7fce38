//! The refining network: a small one that looks at one object at a time ([`farsight_core::refine`]), and its file.

use std::path::{Path, PathBuf};

use farsight_core::refine::{INPUT_CHANNELS, KINDS, PLACE_CHANNELS, TwoLooks};
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::build::{Builder, NormKind};
use crate::graph::{Graph, NodeId, Op, Window};
use crate::onnx::{Facts, Target, write};
use crate::transform::Network;
use crate::weights::{Weights, WeightsError};

/// Key of the header under which the config stands as JSON.
const CONFIG_KEY: &str = "farsight.refiner";

/// Name of the answer among the taps.
pub const ANSWER: &str = "refined";

/// Every level halves the map; the last one is read whole.
const LEVELS: usize = 4;

/// The first convolution's window, half the size.
const STEM: Window = Window::same(5, 2);

/// A refining network.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RefinerConfig {
    /// Pixels a side of the cut-out; a multiple of 16.
    pub side: usize,
    /// Channels of the four levels.
    pub channels: [usize; LEVELS],
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

impl RefinerConfig {
    /// Why no network can be built of this, if none can.
    pub fn problem(&self) -> Option<String> {
        let Self { side, channels, hidden, looks } = self;
        if *side == 0 || !side.is_multiple_of(1 << LEVELS) || *side > 1024 {
            return Some(format!("refiner.side is {side}; expected a multiple of 16, at most 1024"));
        }
        if !looks.is_usable() {
            return Some(format!("refiner.looks is {looks:?}; expected the numbers of a fit"));
        }
        let counts = channels.iter().chain([hidden]);
        let mut wrong = counts.filter(|count| !(1..=4096).contains(*count));
        wrong.next().map(|count| format!("refiner.channels or refiner.hidden has {count}; expected 1 to 4096"))
    }

    /// The network.
    ///
    /// # Shapes
    /// From `[batch, 6, side, side]` to `[batch, 16, 1, 1]`: the place, then the kinds.
    pub fn graph(&self) -> Graph {
        let mut b = Builder::new(NormKind::Batch);
        let input = b.input(INPUT_CHANNELS);
        b.stage("refiner");
        let mut x = b.conv_norm_relu(input, "stem.conv", "stem.norm", self.channels[0], STEM);
        for (level, &channels) in self.channels.iter().enumerate().skip(1) {
            x = residual_level(&mut b, x, &format!("level{level}"), channels);
        }
        let whole = Window { kernel: self.side >> LEVELS, stride: 1, padding: 0, dilation: 1 };
        let x = b.conv_norm_relu(x, "whole.conv", "whole.norm", self.hidden, whole);
        let x = b.conv_with_bias(x, "hidden", self.hidden, 1, None);
        let x = b.relu(x);
        let place = b.conv_with_bias(x, "answer", PLACE_CHANNELS, 1, None);
        let kinds = b.conv_with_bias(x, "kinds", KINDS, 1, None);
        let answer = b.concat(&[place, kinds]);
        b.tap(ANSWER, answer);
        b.finish()
    }
}

/// Half the size: two convolutions beside a pooled projection.
fn residual_level(b: &mut Builder, x: NodeId, name: &str, channels: usize) -> NodeId {
    let first = b.conv_norm_relu(x, &format!("{name}.conv1"), &format!("{name}.norm1"), channels, Window::same(3, 2));
    let second = b.conv(first, &format!("{name}.conv2"), channels, Window::same(3, 1));
    let second = b.norm(second, &format!("{name}.norm2"));
    let pooled = b.map(Op::MaxPool { size: 2 }, x);
    let beside = b.conv(pooled, &format!("{name}.project"), channels, Window::same(1, 1));
    let beside = b.norm(beside, &format!("{name}.project_norm"));
    let sum = b.add(second, beside);
    b.relu(sum)
}

/// A refining network with its weights.
#[derive(Debug, Clone)]
pub struct RefinerModel {
    /// What it is.
    pub config: RefinerConfig,
    /// A tensor for every parameter, and what else the file says.
    pub weights: Weights,
}

/// A file that is no refiner.
#[derive(Debug, Error)]
pub enum RefinerError {
    /// The weights could not be read or written, or one of them is missing or has another shape.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// The header has no config, or none that can be used.
    #[error("{}: \"{CONFIG_KEY}\" in the header: {problem}", path.display())]
    Config {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: String,
    },
}

impl RefinerModel {
    /// Whether the file at `path` says that it is a refiner.
    pub fn is_one(path: &Path) -> bool {
        Weights::read_metadata(path).is_ok_and(|metadata| metadata.contains_key(CONFIG_KEY))
    }

    /// Reads a file.
    ///
    /// # Errors
    /// When the file cannot be read or is no refiner.
    pub fn read(path: &Path) -> Result<Self, RefinerError> {
        Self::from_weights(Weights::read(path)?, path)
    }

    /// Reads a file that is in memory already; `source` is only what errors call it.
    ///
    /// # Errors
    /// As [`RefinerModel::read`].
    pub fn from_safetensors(bytes: &[u8], source: &Path) -> Result<Self, RefinerError> {
        Self::from_weights(Weights::from_safetensors(bytes, source)?, source)
    }

    fn from_weights(weights: Weights, path: &Path) -> Result<Self, RefinerError> {
        let bad = |problem: String| RefinerError::Config { path: path.into(), problem };
        let text = weights.metadata.get(CONFIG_KEY);
        let text = text.ok_or_else(|| bad("missing; expected a refiner that `farsight train` wrote".to_owned()))?;
        let config: RefinerConfig = serde_json::from_str(text).map_err(|error| bad(error.to_string()))?;
        if let Some(problem) = config.problem() {
            return Err(bad(problem));
        }
        for parameter in config.graph().parameters {
            weights.tensor(&parameter.name, &parameter.shape)?;
        }
        Ok(Self { config, weights })
    }

    /// Writes the file with half-precision numbers, whole or not at all.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), RefinerError> {
        let bad = |error: serde_json::Error| RefinerError::Config { path: path.into(), problem: error.to_string() };
        let mut weights = self.weights.clone();
        weights.metadata.insert(CONFIG_KEY.to_owned(), serde_json::to_string(&self.config).map_err(bad)?);
        Ok(weights.write_half(path)?)
    }

    /// The network as an ONNX file in memory: input [`crate::onnx::INPUT`], output [`ANSWER`], batch norm folded.
    ///
    /// # Errors
    /// When a weight is missing or has another shape.
    pub fn onnx(&self) -> Result<Vec<u8>, WeightsError> {
        let network = Network { graph: self.config.graph(), weights: self.weights.clone() };
        write(&network.batch_norm_folded()?, &Facts::default(), Target::Portable)
    }
}

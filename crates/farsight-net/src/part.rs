//! Small networks that work beside a detector, one cut-out at a time, and their files.

use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;
use thiserror::Error;

use crate::build::Builder;
use crate::graph::{Graph, NodeId, Op, Window};
use crate::onnx::{Facts, Target, write};
use crate::transform::Network;
use crate::weights::{Weights, WeightsError};

/// Name of the answer among the taps.
pub const ANSWER: &str = "answer";

/// The first convolution's window, half the size.
const STEM: Window = Window::same(5, 2);

/// Config of a small network: it stands in the header of the network's file, as JSON, and tells what the file is.
pub trait PartConfig: Clone + Serialize + DeserializeOwned {
    /// What such a network is called, with its article.
    const NAME: &'static str;
    /// Key of the header under which the config stands.
    const KEY: &'static str;

    /// Why no network can be built of this, if none can.
    fn problem(&self) -> Option<String>;

    /// The network, with a tap named [`ANSWER`].
    fn graph(&self) -> Graph;
}

/// A small network with its weights.
#[derive(Debug, Clone)]
pub struct PartModel<C> {
    /// What it is.
    pub config: C,
    /// A tensor for every parameter, and what else the file says.
    pub weights: Weights,
}

/// A file that is not the small network that was expected.
#[derive(Debug, Error)]
pub enum PartError {
    /// The weights could not be read or written, or one of them is missing or has another shape.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// The header has no config, or none that can be used.
    #[error("{}: \"{key}\" in the header: {problem}", path.display())]
    Config {
        /// The file.
        path: PathBuf,
        /// The header's key.
        key: &'static str,
        /// What is wrong with it.
        problem: String,
    },
}

impl<C: PartConfig> PartModel<C> {
    /// Whether the file at `path` says that it is one.
    pub fn is_one(path: &Path) -> bool {
        Weights::read_metadata(path).is_ok_and(|metadata| metadata.contains_key(C::KEY))
    }

    /// Reads a file.
    ///
    /// # Errors
    /// When the file cannot be read or is no such network.
    pub fn read(path: &Path) -> Result<Self, PartError> {
        Self::from_weights(Weights::read(path)?, path)
    }

    /// Reads a file that is in memory already; `source` is only what errors call it.
    ///
    /// # Errors
    /// As [`PartModel::read`].
    pub fn from_safetensors(bytes: &[u8], source: &Path) -> Result<Self, PartError> {
        Self::from_weights(Weights::from_safetensors(bytes, source)?, source)
    }

    fn from_weights(weights: Weights, path: &Path) -> Result<Self, PartError> {
        let bad = |problem: String| PartError::Config { path: path.into(), key: C::KEY, problem };
        let text = weights.metadata.get(C::KEY);
        let text = text.ok_or_else(|| bad(format!("missing; expected {} that `farsight train` wrote", C::NAME)))?;
        let config: C = serde_json::from_str(text).map_err(|error| bad(error.to_string()))?;
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
    pub fn write(&self, path: &Path) -> Result<(), PartError> {
        let bad =
            |error: serde_json::Error| PartError::Config { path: path.into(), key: C::KEY, problem: error.to_string() };
        let mut weights = self.weights.clone();
        weights.metadata.insert(C::KEY.to_owned(), serde_json::to_string(&self.config).map_err(bad)?);
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

/// What is wrong with the sizes of [`features`], if anything is; `name` is that of the config's table.
pub(crate) fn problem_of_sizes(name: &str, side: usize, channels: &[usize], hidden: usize) -> Option<String> {
    let multiple = 1 << channels.len();
    if side == 0 || !side.is_multiple_of(multiple) || side > 1024 {
        return Some(format!("{name}.side is {side}; expected a multiple of {multiple}, at most 1024"));
    }
    let mut wrong = channels.iter().chain([&hidden]).filter(|count| !(1..=4096).contains(*count));
    wrong.next().map(|count| format!("{name}.channels or {name}.hidden has {count}; expected 1 to 4096"))
}

/// From a cut-out of `side` x `side` pixels to `[batch, hidden, 1, 1]`: every level halves the map, and the last one is read whole.
pub(crate) fn features(b: &mut Builder, input: NodeId, side: usize, channels: &[usize], hidden: usize) -> NodeId {
    let mut x = b.conv_norm_relu(input, "stem.conv", "stem.norm", channels[0], STEM);
    for (level, &channels) in channels.iter().enumerate().skip(1) {
        x = residual_level(b, x, &format!("level{level}"), channels);
    }
    let whole = Window { kernel: side >> channels.len(), stride: 1, padding: 0, end_padding: 0, dilation: 1 };
    let x = b.conv_norm_relu(x, "whole.conv", "whole.norm", hidden, whole);
    let x = b.conv_with_bias(x, "hidden", hidden, 1, None);
    b.relu(x)
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

//! A model in one file: weights, and in the header the method that they belong to and its config.

use std::fmt::Debug;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;
use thiserror::Error;

use crate::graph::{Graph, Role, ShapeMismatch};
use crate::live::without_dead_parameters;
use crate::weights::{WeightTensor, Weights, WeightsError};

/// Key of the header under which the method's tag stands.
pub const METHOD_KEY: &str = "farsight.method";

/// Key of the header under which the network's config stands as JSON.
pub const CONFIG_KEY: &str = "farsight.model";

/// Key of the header that says that the tensors, not the config, decide how wide the layers are.
pub const PRUNED_KEY: &str = "farsight.narrowed";

/// Key of the header that says whose weights a model was made from, and under which licence.
pub const ATTRIBUTION_KEY: &str = "farsight.source.attribution";

/// The method of files that have no tag: there was no other when they were written.
pub const FIRST_METHOD: &str = "smoke";

/// Config of a network: it stands in the header of the network's file, as JSON.
pub trait NetworkConfig: Clone + Debug + Default + PartialEq + Serialize + DeserializeOwned {
    /// Tag of the method, as it stands in files and configs.
    const METHOD: &'static str;
    /// What such a network is called, with its article.
    const NAME: &'static str;
    /// Taps of the graph that are the network's outputs.
    const OUTPUTS: &'static [&'static str];
    /// The output whose head a decoder may compute at single cells, if there is one ([`crate::transform::LocalHead`]).
    const LOCAL_HEAD: Option<&'static str> = None;

    /// Why no network can be built of this, if none can.
    fn problem(&self) -> Option<String>;

    /// The network, with a tap for every one of [`NetworkConfig::OUTPUTS`].
    fn graph(&self) -> Graph;

    /// Without what was fitted on labelled frames: scores and error bars of another network are none of this one's.
    #[must_use]
    fn without_fit(self) -> Self {
        self
    }
}

/// A network with its weights and its description.
#[derive(Debug, Clone)]
pub struct Model<C> {
    /// What it is.
    pub config: C,
    /// The network made from the config.
    pub graph: Graph,
    /// A tensor for every parameter of the graph, and what else the file says.
    pub weights: Weights,
}

/// A file that is not the model that was expected.
#[derive(Debug, Error)]
pub enum ModelError {
    /// The weights could not be read or written.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// The header has no config.
    #[error("{}: the header has no \"{CONFIG_KEY}\"; expected {expected} written by `farsight train` or `farsight import`", path.display())]
    NoConfig {
        /// The file.
        path: PathBuf,
        /// What was expected, with its article.
        expected: &'static str,
    },
    /// It is a model of another method.
    #[error("{}: a model of the method \"{found}\"; expected {expected} (\"{method}\")", path.display())]
    Method {
        /// The file.
        path: PathBuf,
        /// Its tag.
        found: String,
        /// What was expected, with its article.
        expected: &'static str,
        /// The tag that was expected.
        method: &'static str,
    },
    /// The config in the header is not one.
    #[error("{}: \"{CONFIG_KEY}\" in the header: {problem}", path.display())]
    BadConfig {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: String,
    },
    /// A tensor is missing or has another shape.
    #[error("tensor \"{name}\" {found}; the model's config asks for shape {expected:?}")]
    Tensor {
        /// Its name.
        name: String,
        /// What was found.
        found: String,
        /// The shape that the network has there.
        expected: Vec<usize>,
    },
    /// As [`ModelError::Tensor`], of a file.
    #[error("{}: tensor \"{name}\" {found}; the model's config asks for shape {expected:?}", path.display())]
    TensorOf {
        /// The file.
        path: PathBuf,
        /// Its name.
        name: String,
        /// What was found.
        found: String,
        /// The shape that the network has there.
        expected: Vec<usize>,
    },
}

/// The tag of the method that a file with this header is of.
pub fn method_of(weights: &Weights) -> &str {
    weights.metadata.get(METHOD_KEY).map_or(FIRST_METHOD, String::as_str)
}

impl<C: NetworkConfig> Model<C> {
    /// The model of `config` with `weights`; tensors that the network does not have are dropped.
    ///
    /// # Errors
    /// When a tensor of the network is missing or has another shape.
    pub fn new(config: C, mut weights: Weights) -> Result<Self, ModelError> {
        let graph = config.graph();
        for parameter in &graph.parameters {
            let found = match weights.tensors.get(&parameter.name) {
                Some(tensor) if tensor.shape == parameter.shape => continue,
                Some(tensor) => format!("has shape {:?}", tensor.shape),
                None if parameter.role == Role::Unused => {
                    // A file may leave out what no forward pass reads.
                    let zeros = WeightTensor { shape: parameter.shape.clone(), values: vec![0.0; parameter.len()] };
                    weights.tensors.insert(parameter.name.clone(), zeros);
                    continue;
                }
                None => "is missing".to_owned(),
            };
            return Err(ModelError::Tensor { name: parameter.name.clone(), found, expected: parameter.shape.clone() });
        }
        weights.tensors.retain(|name, _| graph.parameters.iter().any(|p| p.name == *name));
        Ok(Self { config, graph, weights })
    }

    /// The model of `config` whose layers are as wide as `weights` says: a pruned one.
    ///
    /// # Errors
    /// When a tensor is missing or does not fit the others, or the outputs have not the channels that the config asks
    /// for.
    pub fn pruned(config: C, mut weights: Weights) -> Result<Self, ModelError> {
        let whole = config.graph();
        let shape_of = |name: &str| weights.tensors.get(name).map(|tensor| tensor.shape.clone());
        let misfit = |ShapeMismatch { parameter, expected }: ShapeMismatch| {
            let found = shape_of(&parameter).map_or("is missing".to_owned(), |shape| format!("has shape {shape:?}"));
            ModelError::Tensor { name: parameter, found, expected }
        };
        let graph = whole.with_shapes(shape_of).map_err(misfit)?;
        for output in C::OUTPUTS.iter().filter_map(|name| graph.tap(name)) {
            let (found, expected) = (graph.nodes[output].channels, whole.nodes[output].channels);
            if found != expected {
                let found = format!("has {found} channels");
                return Err(ModelError::Tensor { name: "the head".to_owned(), found, expected: vec![expected] });
            }
        }
        let graph = without_dead_parameters(graph);
        weights.tensors.retain(|name, _| graph.parameters.iter().any(|p| p.name == *name));
        weights.metadata.insert(PRUNED_KEY.to_owned(), "true".to_owned());
        Ok(Self { config, graph, weights })
    }

    /// Whether layers are narrower than the config says.
    pub fn is_pruned(&self) -> bool {
        is_pruned(&self.weights)
    }

    /// Whether the file at `path` says that it is one.
    pub fn is_one(path: &Path) -> bool {
        Weights::read_metadata(path).is_ok_and(|metadata| {
            metadata.contains_key(CONFIG_KEY)
                && metadata.get(METHOD_KEY).map_or(FIRST_METHOD, String::as_str) == C::METHOD
        })
    }

    /// Reads a model file.
    ///
    /// # Errors
    /// When the file cannot be read, is no safetensors file, is of another method, has no config, or does not fit its
    /// config.
    pub fn read(path: &Path) -> Result<Self, ModelError> {
        Self::from_weights(Weights::read(path)?, path)
    }

    /// Reads a model file that is in memory already; `source` is only what errors call it.
    ///
    /// # Errors
    /// As [`Model::read`].
    pub fn from_safetensors(bytes: &[u8], source: &Path) -> Result<Self, ModelError> {
        Self::from_weights(Weights::from_safetensors(bytes, source)?, source)
    }

    /// The model whose weights, with method and config in their header, are in memory; `path` is only what errors call
    /// it.
    ///
    /// # Errors
    /// As [`Model::read`].
    pub fn from_weights(weights: Weights, path: &Path) -> Result<Self, ModelError> {
        weights.check_finite(path)?;
        let Some(text) = weights.metadata.get(CONFIG_KEY) else {
            return Err(ModelError::NoConfig { path: path.into(), expected: C::NAME });
        };
        let found = method_of(&weights);
        if found != C::METHOD {
            let (found, expected, method) = (found.to_owned(), C::NAME, C::METHOD);
            return Err(ModelError::Method { path: path.into(), found, expected, method });
        }
        let bad = |problem: String| ModelError::BadConfig { path: path.into(), problem };
        let config: C = serde_json::from_str(text).map_err(|error| bad(error.to_string()))?;
        if let Some(problem) = config.problem() {
            return Err(bad(problem));
        }
        let made = if is_pruned(&weights) { Self::pruned(config, weights) } else { Self::new(config, weights) };
        made.map_err(|error| match error {
            ModelError::Tensor { name, found, expected } => {
                ModelError::TensorOf { path: path.into(), name, found, expected }
            }
            error => error,
        })
    }

    /// Writes the model file, whole or not at all.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), ModelError> {
        Ok(self.described_weights(path)?.write(path)?)
    }

    /// [`Model::write`] with half-precision numbers, without those that no forward pass reads.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write_half(&self, path: &Path) -> Result<(), ModelError> {
        let mut weights = self.described_weights(path)?;
        let unused = self.graph.parameters.iter().filter(|parameter| parameter.role == Role::Unused);
        for parameter in unused {
            weights.tensors.remove(&parameter.name);
        }
        Ok(weights.write_half(path)?)
    }

    /// The weights with method and config in their header.
    fn described_weights(&self, path: &Path) -> Result<Weights, ModelError> {
        let mut weights = self.weights.clone();
        let config = serde_json::to_string(&self.config)
            .map_err(|e| ModelError::BadConfig { path: path.into(), problem: e.to_string() })?;
        weights.metadata.insert(CONFIG_KEY.to_owned(), config);
        weights.metadata.insert(METHOD_KEY.to_owned(), C::METHOD.to_owned());
        Ok(weights)
    }
}

/// Whether these are the weights of a model whose layers are narrower than its config says.
pub fn is_pruned(weights: &Weights) -> bool {
    weights.metadata.contains_key(PRUNED_KEY)
}

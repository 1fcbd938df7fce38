//! A model in one file: weights, and in the header what they are weights of.

use std::path::{Path, PathBuf};

use thiserror::Error;

use crate::build::network;
use crate::config::{ConfigError, ModelConfig};
use crate::graph::{Graph, LOGITS, Misfit, REGRESSION, Role};
use crate::transform::without_dead_parameters;
use crate::weights::{WeightTensor, Weights, WeightsError};

/// Key of the header under which the model's config stands as JSON.
pub(crate) const CONFIG_KEY: &str = "farsight.model";

/// Key of the header that says that the tensors, not the config, decide how wide the layers are.
pub(crate) const NARROWED_KEY: &str = "farsight.narrowed";

/// A network with its weights and its description.
#[derive(Debug, Clone)]
pub struct Model {
    /// What it is.
    pub config: ModelConfig,
    /// The network made from the config.
    pub graph: Graph,
    /// A tensor for every parameter of the graph.
    pub weights: Weights,
}

/// A file that is not a model.
#[derive(Debug, Error)]
pub enum ModelError {
    /// The weights could not be read or written.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// The header has no config.
    #[error("{}: the header has no \"{CONFIG_KEY}\"; expected a model written by `farsight train` or `farsight import`", path.display())]
    NoConfig {
        /// The file.
        path: PathBuf,
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
}

impl Model {
    /// The model of `config` with `weights`; tensors that the network does not have are dropped.
    ///
    /// # Errors
    /// When a tensor of the network is missing or has another shape.
    pub fn new(config: ModelConfig, mut weights: Weights) -> Result<Self, ModelError> {
        let graph = network(&config);
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
    /// When a tensor is missing or does not fit the others, or the heads have not the channels that the config asks for.
    pub fn narrowed(config: ModelConfig, mut weights: Weights) -> Result<Self, ModelError> {
        let whole = network(&config);
        let shape_of = |name: &str| weights.tensors.get(name).map(|tensor| tensor.shape.clone());
        let misfit = |Misfit { parameter, expected }: Misfit| {
            let found = shape_of(&parameter).map_or("is missing".to_owned(), |shape| format!("has shape {shape:?}"));
            ModelError::Tensor { name: parameter, found, expected }
        };
        let graph = whole.with_shapes(shape_of).map_err(misfit)?;
        for output in [LOGITS, REGRESSION].iter().filter_map(|name| graph.tap(name)) {
            let (found, expected) = (graph.nodes[output].channels, whole.nodes[output].channels);
            if found != expected {
                let found = format!("has {found} channels");
                return Err(ModelError::Tensor { name: "the head".to_owned(), found, expected: vec![expected] });
            }
        }
        let graph = without_dead_parameters(graph);
        weights.tensors.retain(|name, _| graph.parameters.iter().any(|p| p.name == *name));
        weights.metadata.insert(NARROWED_KEY.to_owned(), "true".to_owned());
        Ok(Self { config, graph, weights })
    }

    /// Whether layers are narrower than the config says.
    pub fn is_narrowed(&self) -> bool {
        Self::marks_narrowed(&self.weights)
    }

    /// Whether these are the weights of a model whose layers are narrower than its config says.
    pub fn marks_narrowed(weights: &Weights) -> bool {
        weights.metadata.contains_key(NARROWED_KEY)
    }

    /// Reads a model file.
    ///
    /// # Errors
    /// When the file cannot be read, is no safetensors file, has no config, or does not fit its config.
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

    fn from_weights(weights: Weights, path: &Path) -> Result<Self, ModelError> {
        let text = weights.metadata.get(CONFIG_KEY).ok_or_else(|| ModelError::NoConfig { path: path.into() })?;
        let bad = |problem: String| ModelError::BadConfig { path: path.into(), problem };
        let config: ModelConfig = serde_json::from_str(text).map_err(|e| bad(e.to_string()))?;
        config.validate().map_err(|e: ConfigError| bad(e.to_string()))?;
        if Self::marks_narrowed(&weights) { Self::narrowed(config, weights) } else { Self::new(config, weights) }
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

    /// The weights with the config in their header.
    fn described_weights(&self, path: &Path) -> Result<Weights, ModelError> {
        let mut weights = self.weights.clone();
        let config = serde_json::to_string(&self.config)
            .map_err(|e| ModelError::BadConfig { path: path.into(), problem: e.to_string() })?;
        weights.metadata.insert(CONFIG_KEY.to_owned(), config);
        Ok(weights)
    }
}

//! A model in one file: weights, and in the header what they are weights of.

use std::path::{Path, PathBuf};

use thiserror::Error;

use crate::build::network;
use crate::config::{ConfigError, ModelConfig};
use crate::graph::{Graph, Role};
use crate::weights::{WeightTensor, Weights, WeightsError};

/// Key of the header under which the model's config stands as JSON.
pub(crate) const CONFIG_KEY: &str = "farsight.model";

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

    /// Reads a model file.
    ///
    /// # Errors
    /// When the file cannot be read, is no safetensors file, has no config, or does not fit its config.
    pub fn read(path: &Path) -> Result<Self, ModelError> {
        let weights = Weights::read(path)?;
        let text = weights.metadata.get(CONFIG_KEY).ok_or_else(|| ModelError::NoConfig { path: path.into() })?;
        let bad = |problem: String| ModelError::BadConfig { path: path.into(), problem };
        let config: ModelConfig = serde_json::from_str(text).map_err(|e| bad(e.to_string()))?;
        config.validate().map_err(|e: ConfigError| bad(e.to_string()))?;
        Self::new(config, weights)
    }

    /// Writes the model file, whole or not at all.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), ModelError> {
        let mut weights = self.weights.clone();
        let config = serde_json::to_string(&self.config)
            .map_err(|e| ModelError::BadConfig { path: path.into(), problem: e.to_string() })?;
        weights.metadata.insert(CONFIG_KEY.to_owned(), config);
        Ok(weights.write(path)?)
    }
}

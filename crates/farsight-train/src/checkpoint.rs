//! Checkpoints: all that a run needs to go on as if it had never stopped.

use std::path::{Path, PathBuf};

use farsight_data::Position;
use farsight_graph::weights::{Weights, WeightsError};
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Key of the header under which the progress stands as JSON.
const PROGRESS_KEY: &str = farsight_onnx::key::PROGRESS;

/// Key of the header under which the run's config stands as JSON.
const RUN_KEY: &str = "farsight.run";

/// How far a run has come. All its randomness follows from the seed and the position, so this is also its random state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Progress {
    /// Optimiser steps done.
    pub steps: u64,
    /// The next batch.
    pub position: Position,
}

/// A checkpoint that cannot be used.
#[derive(Debug, Error)]
pub enum CheckpointError {
    /// The file could not be read or written.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// The header misses an entry or has one that cannot be read.
    #[error("{}: \"{key}\" in the header: {problem}", path.display())]
    Header {
        /// The file.
        path: PathBuf,
        /// Which entry.
        key: &'static str,
        /// What is wrong with it.
        problem: String,
    },
    /// A tensor is missing or has another shape.
    #[error("{}: tensor \"{name}\" is missing or has another shape than the network's", path.display())]
    Tensor {
        /// The file.
        path: PathBuf,
        /// Its name.
        name: String,
    },
    /// The run was started with another config.
    #[error("{}: the run was started with another config; expected the same (use another --out for a new run)", path.display())]
    OtherRun {
        /// The file.
        path: PathBuf,
    },
}

/// Writes a checkpoint, whole or not at all: `weights` (parameters, optimiser and what else there is), progress, and the `identity` of the run: what of its
/// config changes its steps.
///
/// # Errors
/// When the file cannot be written.
pub fn write(
    path: &Path,
    mut weights: Weights,
    progress: Progress,
    identity: &impl Serialize,
) -> Result<(), CheckpointError> {
    for (key, json) in [(PROGRESS_KEY, serde_json::to_string(&progress)), (RUN_KEY, serde_json::to_string(identity))] {
        let json = json.map_err(|e| CheckpointError::Header { path: path.into(), key, problem: e.to_string() })?;
        weights.metadata.insert(key.to_owned(), json);
    }
    Ok(weights.write(path)?)
}

/// Reads a checkpoint of the run with this `identity`: its tensors, parameters and optimiser together, and its progress.
///
/// # Errors
/// When the file cannot be read or belongs to a run with another config.
pub fn read(path: &Path, identity: &impl Serialize) -> Result<(Weights, Progress), CheckpointError> {
    let weights = Weights::read(path)?;
    let entry = |key: &'static str| {
        let problem = |problem: String| CheckpointError::Header { path: path.into(), key, problem };
        let text = weights
            .metadata
            .get(key)
            .ok_or_else(|| problem("missing; expected a checkpoint of `farsight train`".into()))?;
        serde_json::from_str::<serde_json::Value>(text).map_err(|e| problem(e.to_string()))
    };
    let same_run = serde_json::to_value(identity).is_ok_and(|value| entry(RUN_KEY).is_ok_and(|stored| stored == value));
    let progress = serde_json::from_value(entry(PROGRESS_KEY)?).map_err(|e| CheckpointError::Header {
        path: path.into(),
        key: PROGRESS_KEY,
        problem: e.to_string(),
    })?;
    if !same_run {
        return Err(CheckpointError::OtherRun { path: path.into() });
    }
    Ok((weights, progress))
}

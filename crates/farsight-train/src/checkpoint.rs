//! Checkpoints: all that a run needs to go on as if it had never stopped.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use farsight_data::Position;
use farsight_graph::weights::{FILE_SHA256_KEY, Weights, WeightsError};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use thiserror::Error;

use crate::fingerprint::Fingerprint;

/// Key of the header under which the progress stands as JSON.
const PROGRESS_KEY: &str = farsight_onnx::key::PROGRESS;

/// Key of the header under which the fingerprint of the data stands as JSON.
const DATA_KEY: &str = "farsight.data";

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
    #[error("{}: the run was started with another config: {}; expected the same (use another --out for a new run)", path.display(), differences.join(", "))]
    OtherRun {
        /// The file.
        path: PathBuf,
        /// What differs: field, its value then and now.
        differences: Vec<String>,
    },
    /// The file has no hash, which every checkpoint has.
    #[error("{}: no hash in its header; the file was damaged, or written by an older farsight: begin the run anew (another --out)", path.display())]
    NoHash {
        /// The file.
        path: PathBuf,
    },
}

/// Writes a checkpoint, whole or not at all: `weights` (parameters, optimiser and what else there is), progress, the
/// `identity` of the run: what of its config changes its steps, and the fingerprint of its `data`.
///
/// # Errors
/// When the file cannot be written.
pub fn write(
    path: &Path,
    mut weights: Weights,
    progress: Progress,
    identity: &impl Serialize,
    data: &Fingerprint,
) -> Result<(), CheckpointError> {
    let entries = [
        (PROGRESS_KEY, serde_json::to_string(&progress)),
        (RUN_KEY, serde_json::to_string(identity)),
        (DATA_KEY, serde_json::to_string(data)),
    ];
    for (key, json) in entries {
        let json = json.map_err(|e| CheckpointError::Header { path: path.into(), key, problem: e.to_string() })?;
        weights.metadata.insert(key.to_owned(), json);
    }
    Ok(weights.write(path)?)
}

/// Reads a checkpoint of the run with this `identity`: its tensors, parameters and optimiser together, and its
/// progress.
///
/// # Errors
/// When the file cannot be read, is not as it was written, or belongs to a run with another config.
pub fn read(path: &Path, identity: &impl Serialize) -> Result<(Weights, Progress), CheckpointError> {
    if !Weights::read_metadata(path)?.contains_key(FILE_SHA256_KEY) {
        return Err(CheckpointError::NoHash { path: path.into() });
    }
    let weights = Weights::read(path)?;
    let entry = |key: &'static str| {
        let problem = |problem: String| CheckpointError::Header { path: path.into(), key, problem };
        let text = weights
            .metadata
            .get(key)
            .ok_or_else(|| problem("missing; expected a checkpoint of `farsight train`".into()))?;
        serde_json::from_str::<serde_json::Value>(text).map_err(|e| problem(e.to_string()))
    };
    let now = serde_json::to_value(identity).unwrap_or_default();
    let differences = differences("", &entry(RUN_KEY).unwrap_or_default(), &now);
    let progress = serde_json::from_value(entry(PROGRESS_KEY)?).map_err(|e| CheckpointError::Header {
        path: path.into(),
        key: PROGRESS_KEY,
        problem: e.to_string(),
    })?;
    if !differences.is_empty() {
        return Err(CheckpointError::OtherRun { path: path.into(), differences });
    }
    Ok((weights, progress))
}

/// The fingerprint of the data that the run of a checkpoint learns from.
///
/// # Errors
/// When the file cannot be read or has none.
pub fn data_of(path: &Path) -> Result<Fingerprint, CheckpointError> {
    let header = |problem: String| CheckpointError::Header { path: path.into(), key: DATA_KEY, problem };
    let metadata = Weights::read_metadata(path)?;
    let text =
        metadata.get(DATA_KEY).ok_or_else(|| header("missing; expected a checkpoint of `farsight train`".into()))?;
    serde_json::from_str(text).map_err(|error| header(error.to_string()))
}

/// Fields that differ, as `train.seed was 1 and is 2`.
fn differences(name: &str, then: &Value, now: &Value) -> Vec<String> {
    if then == now {
        return Vec::new();
    }
    let (Value::Object(then), Value::Object(now)) = (then, now) else {
        let shown = |value: &Value| if value.is_null() { "not there".to_owned() } else { value.to_string() };
        return vec![format!("{name} was {} and is {}", shown(then), shown(now))];
    };
    let keys: BTreeSet<&String> = then.keys().chain(now.keys()).collect();
    let field = |key: &String| if name.is_empty() { key.clone() } else { format!("{name}.{key}") };
    let of = |values: &Map<String, Value>, key: &String| values.get(key).cloned().unwrap_or_default();
    keys.into_iter().flat_map(|key| differences(&field(key), &of(then, key), &of(now, key))).collect()
}

//! Why there is no model.

use std::io;
use std::path::PathBuf;

use farsight_data::DatasetError;
use farsight_data::loader::{ItemError, LoaderError};
use farsight_files::WriteError;
use farsight_graph::model::ModelError;
use farsight_graph::weights::WeightsError;
use thiserror::Error;

use crate::checkpoint::CheckpointError;
use crate::executor::ExecutorError;

/// A run that cannot be started as described.
#[derive(Debug, Error)]
pub enum RunConfigError {
    /// The file could not be read.
    #[error("{}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's answer.
        source: std::io::Error,
    },
    /// The file is no valid config; the text says line and column.
    #[error("{}: {source}", path.display())]
    Parse {
        /// The file.
        path: PathBuf,
        /// What is wrong, and where.
        source: toml::de::Error,
    },
    /// A value cannot be used.
    #[error("{}: {problem}", path.display())]
    Value {
        /// The file.
        path: PathBuf,
        /// The field, what was found and what was expected.
        problem: String,
    },
}

/// Why a training ended before its time.
#[derive(Debug, Error)]
pub enum TrainError {
    /// The config cannot be used.
    #[error(transparent)]
    RunConfig(#[from] RunConfigError),
    /// No data was named.
    #[error("no data; expected --data DIR, or data.root or [data.rendered] in the config")]
    NoData,
    /// The data could not be opened.
    #[error(transparent)]
    Data(#[from] DatasetError),
    /// The loader could not start.
    #[error(transparent)]
    Loader(#[from] LoaderError),
    /// A sample could not be prepared.
    #[error("step {step}: {source}")]
    Sample {
        /// The step that needed it.
        step: u64,
        /// Why.
        source: ItemError<DatasetError>,
    },
    /// The split has no frames.
    #[error("split {} has no frames; expected at least one", .0.display())]
    NoFrames(PathBuf),
    /// The data set does not list the number plates that its images show.
    #[error(
        "no plates in the data set; expected data that `farsight synth` rendered, which a plate reader learns from"
    )]
    NoPlates,
    /// The start weights could not be read.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// The start weights are those of another network.
    #[error("{}: train.start_from: none of its tensors has a place in the network; expected weights of the same kind of network", .0.display())]
    NothingFits(PathBuf),
    /// The start weights lack a tensor that is not to start anew.
    #[error(
        "{}: tensor \"{name}\" {found}; expected shape {expected:?}, or the start of its name in train.start_without",
        path.display()
    )]
    StartTensor {
        /// The file.
        path: PathBuf,
        /// The tensor.
        name: String,
        /// What was found.
        found: String,
        /// Its shape in the network.
        expected: Vec<usize>,
    },
    /// A part of the network is named that it does not have.
    #[error("train.{field} names \"{prefix}\"; expected how the name of a tensor of the network starts")]
    Prefix {
        /// The field of the config.
        field: &'static str,
        /// What it names.
        prefix: String,
    },
    /// Every tensor is frozen.
    #[error("train.freeze names the whole network; expected something left to learn")]
    AllFrozen,
    /// The weights do not fit the network.
    #[error(transparent)]
    Network(#[from] ExecutorError),
    /// The model could not be written.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The checkpoint could not be read or written.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// A file of the run could not be written.
    #[error("{}: {source}", path.display())]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// The system's answer.
        source: io::Error,
    },
    /// A file of the run could not be written whole.
    #[error(transparent)]
    Durable(#[from] WriteError),
    /// The config cannot be written as TOML.
    #[error("the resolved config: {0}")]
    Config(#[from] toml::ser::Error),
    /// There is a run in the folder already.
    #[error("{}: there is a run here already; use --resume to go on with it, or another --out", .0.display())]
    Occupied(PathBuf),
    /// The callback asked to stop. The checkpoint is of this step; the run goes on from there.
    #[error("stopped after step {step}; a run that resumes goes on from there")]
    Stopped {
        /// Steps that are done.
        step: u64,
    },
    /// Another training writes to the folder.
    #[error("{}: another training is going on in this folder; expected another --out", .0.display())]
    Locked(PathBuf),
    /// The run would go on with other data than it began with.
    #[error(
        "{}: the run would go on with other data: {}; expected the same data, or --accept-other-data, or another --out for a new run",
        path.display(), differences.join(", ")
    )]
    OtherData {
        /// The checkpoint.
        path: PathBuf,
        /// What differs, in words.
        differences: Vec<String>,
    },
    /// The model so far could not be measured.
    #[error("validation: {0}")]
    Validate(String),
    /// The run's task cannot be done with this network.
    #[error("{0}")]
    Task(String),
    /// A number is not finite. The last checkpoint is older than this and intact.
    #[error(
        "step {step}: {what} is {value}; the batch was {frames:?}. The last checkpoint is from before this step and intact"
    )]
    NotFinite {
        /// The step.
        step: u64,
        /// The loss term or the gradient.
        what: String,
        /// What it is.
        value: f64,
        /// Names of the frames in the batch.
        frames: Vec<String>,
    },
}

//! Why a checkpoint could not be imported.

use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

use super::pickle::PickleError;

/// A file that could not be imported, and why.
#[derive(Debug, Error)]
#[error("{}: {problem}", path.display())]
pub struct CheckpointError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it; boxed to keep results small.
    pub problem: Box<CheckpointProblem>,
}

impl CheckpointError {
    /// `problem` of the file at `path`.
    pub fn new(path: &Path, problem: CheckpointProblem) -> Self {
        Self { path: path.to_path_buf(), problem: Box::new(problem) }
    }
}

/// What is wrong with a checkpoint.
#[derive(Debug, Error)]
pub enum CheckpointProblem {
    /// The file could not be read.
    #[error("{0}")]
    Read(#[from] io::Error),
    /// Neither of the two layouts that PyTorch writes.
    #[error(
        "not a PyTorch checkpoint: starts with {found:02x?}; expected a zip archive or a pickle (or a TFLite file)"
    )]
    Format {
        /// The first bytes.
        found: Vec<u8>,
    },
    /// The zip archive is damaged or has an entry that PyTorch does not write.
    #[error("zip archive: {0}")]
    Zip(#[from] zip::result::ZipError),
    /// The archive lacks `data.pkl`.
    #[error("zip archive without a data.pkl: not written by torch.save")]
    NoPickle,
    /// A pickle is damaged or hostile.
    #[error(transparent)]
    Pickle(#[from] PickleError),
    /// Written on a big-endian machine.
    #[error("its numbers are big-endian; only little-endian files are read")]
    BigEndian,
    /// The version that the legacy layout carries is unknown.
    #[error("legacy layout: expected protocol version 1001")]
    Protocol,
    /// The legacy layout's list of storages is no list of names.
    #[error("legacy layout: found {found}; expected a list of storage names")]
    StorageList {
        /// What is there.
        found: String,
    },
    /// A storage is not in the file.
    #[error("storage \"{key}\" is not in the file")]
    NoStorage {
        /// Name of the storage.
        key: String,
    },
    /// A storage has another length than the pickle says, or the file ends inside it.
    #[error("storage \"{key}\" holds {found} bytes; expected {expected}")]
    StorageLength {
        /// Name of the storage.
        key: String,
        /// Bytes that are there.
        found: usize,
        /// Bytes that the pickle asks for.
        expected: usize,
    },
    /// The tensors are not those of the network.
    #[error("{0}")]
    ShapeMismatch(String),
    /// The pickle holds no dictionary of tensors.
    #[error(
        "no state dictionary: found {found}; expected tensors by name, or such a dictionary under \"model\" or \"state_dict\""
    )]
    NoStateDict {
        /// What is there.
        found: String,
    },
    /// An entry of the state dictionary is no tensor that is read here.
    #[error("tensor \"{name}\": found {found}; expected a tensor of floats, half floats, doubles or longs")]
    NotATensor {
        /// The entry.
        name: String,
        /// What is there.
        found: String,
    },
    /// A tensor reaches outside its storage, or asks for more values than the storage has.
    #[error(
        "tensor \"{name}\": shape {shape:?} with strides {strides:?} from {offset} does not fit its storage of {count} values"
    )]
    Bounds {
        /// The tensor.
        name: String,
        /// Sizes along its axes.
        shape: Vec<usize>,
        /// Steps along its axes.
        strides: Vec<usize>,
        /// Its first value.
        offset: usize,
        /// Values in the storage.
        count: usize,
    },
    /// The tensors together have more values than the file has bytes: they share storages in a way that no network
    /// does.
    #[error("its tensors unfold to more values than the file has bytes")]
    TooMuch,
    /// A TFLite file is damaged.
    #[error("TFLite file: {0}")]
    Tflite(&'static str),
    /// A tensor of a TFLite file has a shape that a convolution has not, or another than its numbers.
    #[error(
        "TFLite file: tensor \"{name}\" has the shape {shape:?}; expected that of a convolution and of its numbers"
    )]
    TfliteShape {
        /// The tensor.
        name: String,
        /// Its shape.
        shape: Vec<usize>,
    },
    /// The names fit none of the known networks.
    #[error(
        "unknown network: a tensor is called \"{example}\"; expected the names of SMOKE, mmdetection3d's SMOKE, DLA-34, MobileNetV2 or EfficientNet-Lite"
    )]
    Layout {
        /// One of the names.
        example: String,
    },
    /// Two names of the file mean the same tensor.
    #[error("tensor \"{name}\" means \"{canonical}\", which another tensor of the file means too")]
    Twice {
        /// The name in the file.
        name: String,
        /// Farsight's name.
        canonical: String,
    },
    /// The last class convolution is not made for three classes, so that their order is unknown.
    #[error("tensor \"{name}\" has the shape {found:?}; expected 3 classes")]
    Classes {
        /// The tensor.
        name: String,
        /// Its shape.
        found: Vec<usize>,
    },
}

impl CheckpointProblem {
    pub(super) fn tflite_shape(name: &str, shape: &[usize]) -> Self {
        Self::TfliteShape { name: name.to_owned(), shape: shape.to_vec() }
    }
}

//! Why an ONNX file is no model.

use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

use crate::wire::WireError;

/// A file that cannot be used, and why.
#[derive(Debug, Error)]
#[error("{}: {problem}", path.display())]
pub struct OnnxError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    pub problem: OnnxProblem,
}

impl OnnxError {
    /// `problem` of the file at `path`.
    pub fn new(path: &Path, problem: impl Into<OnnxProblem>) -> Self {
        Self { path: path.to_owned(), problem: problem.into() }
    }
}

/// What is wrong with an ONNX file.
#[derive(Debug, Error)]
pub enum OnnxProblem {
    /// It could not be read.
    #[error("{0}")]
    Read(#[from] io::Error),
    /// It is larger than any model of ours.
    #[error("{found} bytes; expected an ONNX file of at most {limit}")]
    Size {
        /// Its size, bytes.
        found: u64,
        /// The largest size.
        limit: u64,
    },
    /// It is no protobuf message: cut short, or something else.
    #[error("not a whole ONNX file: {0}")]
    Wire(#[from] WireError),
    /// It has more parts than any model of ours.
    #[error("more than {limit} {what}; no model of ours has so many")]
    Count {
        /// Parts of which kind.
        what: &'static str,
        /// The largest count.
        limit: usize,
    },
    /// It has no graph.
    #[error("no graph in it; expected an ONNX model")]
    NoGraph,
    /// It is not as it was written.
    #[error(
        "its contents have the hash {found}, its metadata say {expected}: the file was damaged or changed since it was written; expected another copy of it"
    )]
    Hash {
        /// SHA-256 of its contents.
        found: String,
        /// SHA-256 that the metadata give, shortened.
        expected: String,
    },
    /// A constant has a number that no network computes with.
    #[error("constant \"{name}\" has {value} at place {place}; expected finite numbers")]
    NotFinite {
        /// Its name, shortened.
        name: String,
        /// Where in it, from 0.
        place: usize,
        /// What stands there.
        value: f32,
    },
    /// It was not written by us.
    #[error("no \"{0}\" in its metadata; expected a file written by `farsight export`", crate::key::MODEL)]
    UnknownProducer,
    /// It ends too early, between two parts.
    #[error("no \"{}\" in its metadata; the file has been cut short", crate::key::WEIGHTS_SHA256)]
    Cut,
    /// Its description is broken.
    #[error("\"{}\" in its metadata: {problem}", crate::key::MODEL)]
    Config {
        /// What is wrong with it.
        problem: String,
    },
    /// It is a network of another method.
    #[error("a model of the method \"{found}\"; expected {expected} (\"{method}\")")]
    Method {
        /// The method that its metadata names.
        found: String,
        /// What was expected, in words.
        expected: &'static str,
        /// The method of that.
        method: &'static str,
    },
    /// The model file keeps no ranges for 8 bits, or those of another network.
    #[error("no ranges for 8 bits in its header; `farsight export --int8 --half` measures them")]
    NoRanges,
    /// The weights do not fit the network that it is made from.
    #[error(transparent)]
    Weights(#[from] farsight_graph::weights::WeightsError),
    /// An operator that no file of ours has.
    #[error("operator \"{name}\"; expected only those that `farsight export` writes")]
    Operator {
        /// Its name, shortened.
        name: String,
    },
    /// A constant lies in another file.
    #[error("constant \"{name}\" lies in another file; expected everything in one")]
    External {
        /// Its name, shortened.
        name: String,
    },
    /// A setting of an operator is out of all proportion.
    #[error("\"{setting}\" of an operator {operator} is {value}; no model of ours has more than {limit}")]
    Setting {
        /// The operator.
        operator: String,
        /// The setting, shortened.
        setting: String,
        /// What it is.
        value: i64,
        /// The largest that is taken.
        limit: i64,
    },
    /// A `Resize` that does not say how much it enlarges, or by too much.
    #[error("an operator Resize whose scales are no constant floats above 0 and at most 128")]
    Resize,
    /// A map is larger than any of ours.
    #[error("its value \"{name}\" takes {megabytes:.0} MB for an image; no model of ours has more than {limit:.0} MB")]
    Memory {
        /// Its name, shortened.
        name: String,
        /// What it takes for an image of 1280x384 pixels.
        megabytes: f64,
        /// The most that is taken.
        limit: f64,
    },
    /// It is another part of a network than the one that belongs here.
    #[error("{found} of a network that is cut at its sampler; expected {expected}")]
    Part {
        /// What it says of itself.
        found: String,
        /// The part that was expected.
        expected: &'static str,
    },
    /// It is the second part of another model.
    #[error("a part of another model than {}; expected two that `farsight export` wrote together", .0.display())]
    OtherPart(std::path::PathBuf),
    /// An input or output is missing.
    #[error("no {kind} \"{name}\"; found {found:?}")]
    Value {
        /// `input` or `output`.
        kind: &'static str,
        /// The name that was looked for.
        name: &'static str,
        /// The names that are there.
        found: Vec<String>,
    },
    /// Its local head is not what its metadata says.
    #[error("\"{}\" in its metadata: {problem}", crate::key::PEAKS_HEAD)]
    Head {
        /// What is wrong with it.
        problem: String,
    },
    /// An output has another number of channels than the description says.
    #[error("output \"{name}\" has {found} channels; its description says {expected}")]
    Channels {
        /// The output.
        name: &'static str,
        /// Its channels.
        found: u64,
        /// Those of the description.
        expected: usize,
    },
}

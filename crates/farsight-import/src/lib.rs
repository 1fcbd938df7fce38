//! Tensors of files that other programs wrote: PyTorch's checkpoints, and TFLite's networks ([`tflite`]).
//!
//! [`read_pth`] reads what `torch.save` writes, in the zip layout (PyTorch 1.6 and later) and in the legacy stream
//! before it. What the names mean is the business of the method that they belong to.
//!
//! PyTorch's files are Python pickles, which Python reads by running them. The reader here runs nothing: see
//! [`PickleError`] and the module behind it. A hostile file gives an error; it cannot make the program panic or take
//! memory out of proportion to its own size.

mod attribution;
mod error;
mod pickle;
mod storages;
mod tensors;
pub mod tflite;

use std::collections::BTreeMap;
use std::path::Path;

use farsight_graph::weights::WeightTensor;

pub use attribution::attribution;
pub use error::{CheckpointError, CheckpointProblem};
pub use pickle::PickleError;

/// The largest checkpoint that is read, bytes.
const MAX_FILE: u64 = farsight_graph::weights::MAX_FILE;

/// Reads the state dictionary of a `.pth` file: the tensors by the file's own names.
///
/// The dictionary may be the whole file or lie under `model` or `state_dict`; `module.`, which data-parallel training
/// puts before every name, is removed.
///
/// # Errors
/// [`CheckpointError`] names the file, and the tensor where there is one.
pub fn read_pth(path: &Path) -> Result<BTreeMap<String, WeightTensor>, CheckpointError> {
    let read = || tensors_from_pth(&farsight_files::read_file(path, MAX_FILE)?);
    read().map_err(|problem| CheckpointError::new(path, problem))
}

/// [`read_pth`] for a file that is in memory already.
///
/// # Errors
/// What is wrong with the file.
pub fn tensors_from_pth(bytes: &[u8]) -> Result<BTreeMap<String, WeightTensor>, CheckpointProblem> {
    let (pickled, mut storages) = storages::open(bytes)?;
    tensors::read_tensors(&pickled, &mut storages, bytes.len())
}

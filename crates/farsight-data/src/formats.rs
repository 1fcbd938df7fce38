//! The kinds of data sets that are known, and which of them a folder holds.
//!
//! A new kind is one line in [`FORMATS`].

use std::path::Path;
use std::sync::Arc;

use crate::dataset::{Dataset, DatasetError, DatasetFormat};
use crate::kitti;

/// The kinds of data sets that [`open_dataset`] knows, in the order in which they are tried.
pub const FORMATS: [DatasetFormat; 1] = [kitti::FORMAT];

/// Opens the data set at `root`, of any of the [`FORMATS`]: the frames of `split`, or all.
///
/// `split` is a name that the data set knows, or the path of a file with names of frames.
///
/// # Errors
/// When the folder is of no kind that is known, or something in it is missing or malformed.
pub fn open_dataset(root: &Path, split: Option<&Path>) -> Result<Arc<dyn Dataset>, DatasetError> {
    let Some(format) = FORMATS.iter().find(|format| (format.is_at)(root)) else {
        let known = FORMATS.iter().map(|format| format.layout).collect();
        return Err(DatasetError::UnknownFormat { root: root.to_owned(), known });
    };
    (format.open)(root, split)
}

/// As [`open_dataset`], for what needs labels.
///
/// # Errors
/// As [`open_dataset`], and when the data set has no labels.
pub fn open_labelled(root: &Path, split: Option<&Path>) -> Result<Arc<dyn Dataset>, DatasetError> {
    let dataset = open_dataset(root, split)?;
    if dataset.is_labelled() { Ok(dataset) } else { Err(DatasetError::Unlabelled { name: dataset.name() }) }
}

//! Which kind of data set a folder holds.

use std::path::Path;
use std::sync::Arc;

use super::{Dataset, DatasetError};
use crate::kitti;

/// The kinds of data sets that [`open_dataset`] knows, in the order in which they are tried.
pub const FORMATS: [DatasetFormat; 1] = [kitti::FORMAT];

/// A kind of data set in a folder.
#[derive(Debug, Clone, Copy)]
pub struct DatasetFormat {
    /// Its name.
    pub name: &'static str,
    /// What its folder has, for messages.
    pub layout: &'static str,
    /// Whether a folder looks like one. What is then missing, opening it says.
    pub is_at: fn(&Path) -> bool,
    /// Opens a folder, all frames or those of a split.
    pub open: fn(&Path, Option<&Path>) -> Result<Arc<dyn Dataset>, DatasetError>,
}

/// Opens the data set at `root`, of any of the [`FORMATS`]: the frames of `split`, or all.
///
/// `split` is a name that the data set knows, or the path of a file with names of frames.
///
/// # Errors
/// When the folder is of no kind that is known, or something in it is missing or malformed.
pub fn open_dataset(root: &Path, split: Option<&Path>) -> Result<Arc<dyn Dataset>, DatasetError> {
    match FORMATS.iter().find(|format| (format.is_at)(root)) {
        Some(format) => (format.open)(root, split),
        None => {
            let known = FORMATS.iter().map(|format| format.layout).collect();
            Err(DatasetError::UnknownFormat { root: root.to_owned(), known })
        }
    }
}

/// As [`open_dataset`], for what needs labels.
///
/// # Errors
/// As [`open_dataset`], and when the data set has no labels.
pub fn open_labelled(root: &Path, split: Option<&Path>) -> Result<Arc<dyn Dataset>, DatasetError> {
    let dataset = open_dataset(root, split)?;
    if dataset.is_labelled() { Ok(dataset) } else { Err(DatasetError::Unlabelled { name: dataset.name() }) }
}

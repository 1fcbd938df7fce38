//! Where the labels of an evaluation come from.

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use farsight_data::Dataset;

/// Labels by the name of their frame.
#[derive(Debug, Clone)]
pub enum LabelSource {
    /// A folder of label files in KITTI's format, read as the devkit reads them.
    Folder(PathBuf),
    /// A data set.
    Dataset(LabelledDataset),
}

/// A data set whose frames are asked for by name.
#[derive(Debug, Clone)]
pub struct LabelledDataset {
    pub(crate) dataset: Arc<dyn Dataset>,
    /// Numbers of the frames.
    pub(crate) indices: Arc<BTreeMap<String, usize>>,
}

impl From<&Path> for LabelSource {
    fn from(folder: &Path) -> Self {
        Self::Folder(folder.to_owned())
    }
}

impl From<&PathBuf> for LabelSource {
    fn from(folder: &PathBuf) -> Self {
        Self::Folder(folder.clone())
    }
}

impl From<&Arc<dyn Dataset>> for LabelSource {
    /// The label files of a data set that has some, otherwise what it says.
    fn from(dataset: &Arc<dyn Dataset>) -> Self {
        dataset.label_folder().map_or_else(
            || {
                let indices = dataset.ids().into_iter().zip(0..).collect();
                Self::Dataset(LabelledDataset { dataset: Arc::clone(dataset), indices: Arc::new(indices) })
            },
            Self::Folder,
        )
    }
}

impl LabelSource {
    /// The folder, or the name of the data set, for messages.
    pub(crate) fn place(&self) -> PathBuf {
        match self {
            Self::Folder(folder) => folder.clone(),
            Self::Dataset(LabelledDataset { dataset, .. }) => dataset.name().into(),
        }
    }
}

impl fmt::Display for LabelSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.place().display().fmt(f)
    }
}

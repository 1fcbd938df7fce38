//! Why a data set cannot be opened or a frame cannot be read.

use std::error::Error;
use std::path::PathBuf;

use thiserror::Error;

use super::ImageFolderError;
use crate::annotations::AnnotationError;
use crate::kitti::{CalibrationError, KittiError, RowsError};
use crate::{ClassMapError, ImageError};

/// A data set that cannot be opened, or a frame that cannot be read. Messages name the file.
#[derive(Debug, Error)]
pub enum DatasetError {
    /// No folder of a data set that is known here.
    #[error("{}: no data set that is known here; expected {}", root.display(), known.join(", or "))]
    UnknownFormat {
        /// The folder that was given.
        root: PathBuf,
        /// What is known.
        known: Vec<&'static str>,
    },
    /// Labels are needed and there are none.
    #[error("{name}: no labels; expected a data set that has some")]
    Unlabelled {
        /// What the data set is called.
        name: String,
    },
    /// A folder does not have KITTI's layout.
    #[error(transparent)]
    Kitti(#[from] KittiError),
    /// A folder has no images.
    #[error(transparent)]
    ImageFolder(#[from] ImageFolderError),
    /// An image cannot be read.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A calibration cannot be read.
    #[error(transparent)]
    Calibration(#[from] CalibrationError),
    /// A label or result file cannot be read.
    #[error(transparent)]
    Rows(#[from] RowsError),
    /// A file of annotations cannot be read.
    #[error(transparent)]
    Annotation(#[from] AnnotationError),
    /// A file of class names cannot be read.
    #[error(transparent)]
    Classes(#[from] ClassMapError),
    /// What a data set of another crate says.
    #[error(transparent)]
    Other(Box<dyn Error + Send + Sync>),
}

impl DatasetError {
    /// The error of a data set of another crate.
    pub fn other(error: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self::Other(error.into())
    }
}

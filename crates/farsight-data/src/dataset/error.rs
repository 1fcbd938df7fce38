//! Why a data set cannot be opened or a frame cannot be read.

use std::error::Error;
use std::path::PathBuf;

use thiserror::Error;

use crate::annotations::AnnotationError;
use crate::class_map::ClassMapError;
use crate::image_io::ImageError;

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
    /// An image cannot be read.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A file of annotations cannot be read.
    #[error(transparent)]
    Annotation(#[from] AnnotationError),
    /// A file of class names cannot be read.
    #[error(transparent)]
    Classes(#[from] ClassMapError),
    /// What is wrong with one kind of data set, in its own words.
    #[error(transparent)]
    Other(Box<dyn Error + Send + Sync>),
}

impl DatasetError {
    /// The error of one kind of data set.
    pub fn other(error: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self::Other(error.into())
    }
}

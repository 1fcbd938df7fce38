//! Why a page could not be made.

use std::io;
use std::path::PathBuf;

use farsight_files::WriteError;
use thiserror::Error;

/// A page that could not be made.
#[derive(Debug, Error)]
pub enum PageError {
    /// A chart cannot be drawn.
    #[error("chart \"{title}\" cannot be drawn: {problem}")]
    Draw {
        /// Heading of the chart.
        title: String,
        /// What the drawing library says.
        problem: String,
    },
    /// A picture cannot be encoded.
    #[error("a picture cannot be encoded: {0}")]
    Encode(#[from] image::ImageError),
    /// The folder cannot be made.
    #[error("{}: this folder cannot be made: {source}", path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
}

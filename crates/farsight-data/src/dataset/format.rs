//! How folders of one kind of data set are known and opened.

use std::path::Path;
use std::sync::Arc;

use super::{Dataset, DatasetError};

/// Opens a folder, all frames or those of a split.
pub type Opener = fn(&Path, Option<&Path>) -> Result<Arc<dyn Dataset>, DatasetError>;

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
    pub open: Opener,
}

//! Split files: which frames are for training and which for validation.

use std::collections::HashMap;
use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

/// A split file that could not be read.
#[derive(Debug, Error)]
pub enum SplitError {
    /// The file cannot be opened or is no text.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// A line holds no id.
    #[error("{}:{line}: \"{found}\"; expected the id of one frame, such as 000007", path.display())]
    Id {
        /// The file.
        path: PathBuf,
        /// Its line, from 1.
        line: usize,
        /// The line.
        found: String,
    },
    /// A frame is listed again.
    #[error("{}:{line}: frame {id} is on line {first_line} already; expected each frame once", path.display())]
    Twice {
        /// The file.
        path: PathBuf,
        /// Its line, from 1.
        line: usize,
        /// The frame.
        id: String,
        /// Where it was first.
        first_line: usize,
    },
    /// The file lists nothing.
    #[error("{}: no frame; expected one id a line", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
}

/// The ids in a split file, in its order.
///
/// # Errors
/// When the file cannot be read, lists nothing, lists a frame twice, or a line is not one id of letters, digits, `_`,
/// `-` and `.` (an id becomes a file name, so it must not lead elsewhere).
pub fn read_split(path: &Path) -> Result<Vec<String>, SplitError> {
    let text = farsight_files::read_text(path).map_err(|source| SplitError::Read { path: path.to_owned(), source })?;
    split_from_text(&text, path)
}

/// The ids in the text of a split file; `path` is what errors call it.
///
/// # Errors
/// As [`read_split`].
pub fn split_from_text(text: &str, path: &Path) -> Result<Vec<String>, SplitError> {
    let mut first_lines = HashMap::new();
    let mut ids = Vec::new();
    for (id, line) in text.lines().map(str::trim).zip(1..).filter(|(id, _)| !id.is_empty()) {
        if !is_id(id) {
            return Err(SplitError::Id { path: path.to_owned(), line, found: id.to_owned() });
        }
        if let Some(first_line) = first_lines.insert(id, line) {
            return Err(SplitError::Twice { path: path.to_owned(), line, id: id.to_owned(), first_line });
        }
        ids.push(id.to_owned());
    }
    if ids.is_empty() { Err(SplitError::Empty { path: path.to_owned() }) } else { Ok(ids) }
}

/// A longer id is the name of no file, bytes.
const MAX_ID: usize = 200;

pub(super) fn is_id(id: &str) -> bool {
    let allowed = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.');
    (1..=MAX_ID).contains(&id.len()) && !id.starts_with('.') && id.chars().all(allowed)
}

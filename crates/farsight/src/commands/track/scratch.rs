//! Files that take their place when they are whole.

use std::path::Path;

use anyhow::{Context, Result};
use tempfile::NamedTempFile;

/// A file beside its target, whose place it takes when it is whole, with the rights that new files have.
pub(super) fn scratch_beside(target: &Path, suffix: &str) -> Result<NamedTempFile> {
    let folder = target.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.prefix(".track").suffix(suffix).tempfile_in(folder).with_context(|| unwritable(target))
}

pub(super) fn unwritable(path: &Path) -> String {
    format!("{}: cannot be written", path.display())
}

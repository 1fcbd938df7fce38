//! Writing small files whole or not at all.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::{fs, io};

/// Writes `bytes` to a scratch file beside `path` and renames it over `path`.
///
/// A reader, or a process killed in between, sees the old file or the new one. Nothing is forced to the disk: label and result
/// files come by the thousand and can be made again.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let scratch = scratch_path(path)?;
    let written = fs::write(&scratch, bytes).and_then(|()| fs::rename(&scratch, path));
    if written.is_err() {
        // Nothing more can be done if even this fails; the first error is the one to tell.
        let _ = fs::remove_file(&scratch);
    }
    written
}

/// Two threads may write the same file, so each call has a scratch file of its own.
fn scratch_path(path: &Path) -> io::Result<PathBuf> {
    static NEXT: AtomicU32 = AtomicU32::new(0);
    let target = path.file_name().ok_or(io::ErrorKind::InvalidFilename)?;
    let number = NEXT.fetch_add(1, Ordering::Relaxed);
    let mut name = OsString::from(".");
    name.push(target);
    name.push(format!(".{}-{number}.partial", std::process::id()));
    Ok(path.with_file_name(name))
}

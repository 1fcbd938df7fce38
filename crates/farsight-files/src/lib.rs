//! Writing a file so that nobody ever sees half of it.

use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

use thiserror::Error;

/// How often another scratch name is tried when the first one is taken by what a killed process left behind.
const NAME_ATTEMPTS: u32 = 64;

/// Why a file could not be written. The target is then as it was before.
#[derive(Debug, Error)]
#[error("{}: could not {step}: {source}", path.display())]
pub struct DurableError {
    /// The file that was asked for.
    pub path: PathBuf,
    /// What failed, as in "could not ...".
    pub step: &'static str,
    /// The system's answer.
    pub source: io::Error,
}

/// Writes a file whole or not at all, and returns once it would survive a power cut.
///
/// `write` fills a scratch file beside the target; the scratch file is flushed, synced and renamed over the target, and
/// then the folder is synced. An existing target is replaced only when all of it went well; after an error it is
/// unchanged and the scratch file is gone.
///
/// # Errors
/// [`DurableError`] names the target, the step and the system's answer; an error of `write` is passed on in it.
pub fn write_atomically(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), DurableError> {
    write_through(path, true, write)
}

/// As [`write_atomically`], without waiting for the disk: for label and result files, which come by the thousand and can be made again.
///
/// # Errors
/// As [`write_atomically`].
pub fn write_quickly(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), DurableError> {
    write_through(path, false, write)
}

fn write_through(
    path: &Path,
    sync: bool,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), DurableError> {
    let failed = |step| move |source| DurableError { path: path.to_path_buf(), step, source };
    let (scratch, file) = Scratch::beside(path).map_err(failed("create a scratch file beside it"))?;
    let mut buffered = BufWriter::new(file);
    write(&mut buffered).map_err(failed("write it"))?;
    let file = buffered.into_inner().map_err(io::IntoInnerError::into_error).map_err(failed("write it"))?;
    if sync {
        file.sync_all().map_err(failed("sync it"))?;
    }
    // Some systems refuse to rename a file that is still open.
    drop(file);
    scratch.become_file(path).map_err(failed("rename its scratch file"))?;
    if sync { sync_folder(folder_of(path)).map_err(failed("sync its folder")) } else { Ok(()) }
}

/// A scratch file, removed when dropped unless it became the target.
struct Scratch {
    path: PathBuf,
    kept: bool,
}

impl Scratch {
    fn beside(target: &Path) -> io::Result<(Self, File)> {
        // Two threads may write the same target; each needs a scratch file of its own.
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let name = target.file_name().ok_or_else(|| io::Error::from(io::ErrorKind::InvalidFilename))?;
        let mut outcome = Err(io::Error::from(io::ErrorKind::AlreadyExists));
        for _ in 0..NAME_ATTEMPTS {
            let number = NEXT.fetch_add(1, Ordering::Relaxed);
            let scratch_name = format!(".{}.{}-{number}.partial", name.to_string_lossy(), std::process::id());
            let path = folder_of(target).join(scratch_name);
            outcome = OpenOptions::new().write(true).create_new(true).open(&path).map(|file| (path, file));
            if !matches!(&outcome, Err(error) if error.kind() == io::ErrorKind::AlreadyExists) {
                break;
            }
        }
        outcome.map(|(path, file)| (Self { path, kept: false }, file))
    }

    fn become_file(mut self, target: &Path) -> io::Result<()> {
        std::fs::rename(&self.path, target)?;
        self.kept = true;
        Ok(())
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        if !self.kept {
            // The error that brought us here is the one worth reporting.
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// Makes the rename itself durable. Only Unix can open a folder for that; elsewhere the file system decides.
fn sync_folder(folder: &Path) -> io::Result<()> {
    if cfg!(unix) { File::open(folder)?.sync_all() } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(folder).unwrap();
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn a_file_is_replaced_and_nothing_else_stays() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("weights.bin");
        for content in [&b"first, and longer"[..], b"second"] {
            write_atomically(&target, |out| out.write_all(content)).unwrap();
            assert_eq!(std::fs::read(&target).unwrap(), content);
        }
        assert_eq!(names(folder.path()), ["weights.bin"]);
    }

    #[test]
    fn a_failed_write_leaves_the_old_file() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("weights.bin");
        std::fs::write(&target, b"old").unwrap();
        let error = write_atomically(&target, |out| {
            out.write_all(b"half of the new")?;
            Err(io::Error::other("disk on fire"))
        });
        assert!(error.unwrap_err().to_string().ends_with("weights.bin: could not write it: disk on fire"));
        assert_eq!(std::fs::read(&target).unwrap(), b"old");
        assert_eq!(names(folder.path()), ["weights.bin"]);
    }

    #[test]
    fn a_missing_folder_and_a_folder_as_target_are_errors() {
        let folder = tempfile::tempdir().unwrap();
        for target in [folder.path().join("nowhere/weights.bin"), folder.path().to_path_buf(), PathBuf::from("/")] {
            assert!(write_atomically(&target, |out| out.write_all(b"new")).is_err(), "{}", target.display());
        }
    }
}

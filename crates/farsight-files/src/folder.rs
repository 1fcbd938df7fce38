//! Folders that one process writes to at a time, and what killed processes left in them.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io;
use std::path::Path;

/// Name of the file that is locked.
const LOCK_FILE: &str = ".lock";

/// How scratch files end.
pub(crate) const SCRATCH_SUFFIX: &str = ".partial";

/// A folder that no other process takes until this is dropped, or the process ends in whatever way.
#[derive(Debug)]
pub struct FolderLock(#[expect(dead_code, reason = "the lock is held as long as the file is open")] Option<File>);

impl FolderLock {
    /// Takes a folder that is there; none when somebody has it. Where the file system has no locks, it is free.
    ///
    /// # Errors
    /// When the file `.lock` in it cannot be opened.
    pub fn take(folder: &Path) -> io::Result<Option<Self>> {
        let file = OpenOptions::new().create(true).truncate(false).write(true).open(folder.join(LOCK_FILE))?;
        match file.try_lock() {
            Ok(()) => Ok(Some(Self(Some(file)))),
            Err(TryLockError::WouldBlock) => Ok(None),
            Err(TryLockError::Error(_)) => Ok(Some(Self(None))),
        }
    }
}

/// Removes the scratch files and folders that killed processes left in `folder`; of a process that runs, they stay.
/// Returns how many there were.
///
/// # Errors
/// When the folder cannot be listed or a file not removed.
pub fn remove_stale_scratch(folder: &Path) -> io::Result<usize> {
    remove_scratch(folder, |name| process_of(name).is_some_and(|process| !is_alive(process)))
}

/// As [`remove_stale_scratch`], of the one file called `name`.
pub(crate) fn remove_stale_scratch_of(folder: &Path, target: &str) -> io::Result<usize> {
    let start = format!(".{target}.");
    remove_scratch(folder, |name| {
        name.starts_with(&start) && process_of(name).is_some_and(|process| !is_alive(process))
    })
}

fn remove_scratch(folder: &Path, is_stale: impl Fn(&str) -> bool) -> io::Result<usize> {
    let mut removed = 0;
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if !entry.file_name().to_str().is_some_and(&is_stale) {
            continue;
        }
        let kind = entry.file_type()?;
        if kind.is_file() || kind.is_dir() {
            let path = entry.path();
            match if kind.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) } {
                Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
                _ => removed += 1,
            }
        }
    }
    Ok(removed)
}

/// The process that made the scratch file `.NAME.PROCESS-NUMBER.partial`; none for other names.
fn process_of(name: &str) -> Option<u32> {
    let (_, numbers) = name.strip_prefix('.')?.strip_suffix(SCRATCH_SUFFIX)?.rsplit_once('.')?;
    let (process, number) = numbers.split_once('-')?;
    number.parse::<u32>().ok()?;
    process.parse().ok()
}

/// Whether a process runs; where that is not known, it does.
fn is_alive(process: u32) -> bool {
    process == std::process::id()
        || !Path::new("/proc/self").exists()
        || Path::new(&format!("/proc/{process}")).exists()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_taken_once_at_a_time() {
        let folder = tempfile::tempdir().unwrap();
        let lock = FolderLock::take(folder.path()).unwrap();
        assert!(lock.is_some());
        assert!(FolderLock::take(folder.path()).unwrap().is_none());
        drop(lock);
        assert!(FolderLock::take(folder.path()).unwrap().is_some());
        assert!(FolderLock::take(&folder.path().join("nowhere")).is_err());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn what_killed_processes_left_is_removed_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let own = std::process::id();
        // No process has a larger number than 2^22.
        let names =
            [".a.png.99999999-0.partial", ".b.99999999-7.partial", "a.png", ".x.partial", "y.99999999-0.partial"];
        let kept = [format!(".a.png.{own}-0.partial"), format!(".c.{own}-9.partial")];
        for name in names.into_iter().chain(kept.iter().map(String::as_str)) {
            fs::write(folder.path().join(name), "").unwrap();
        }
        assert_eq!(remove_stale_scratch_of(folder.path(), "a.png").unwrap(), 1);
        assert_eq!(remove_stale_scratch(folder.path()).unwrap(), 1);
        let left = fs::read_dir(folder.path()).unwrap().count();
        assert_eq!(left, names.len() - 2 + kept.len());
    }
}

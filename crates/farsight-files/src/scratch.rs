//! Scratch files and folders: what grows beside its target and takes its name when it is whole.

use std::fs::{self, File, OpenOptions};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

use crate::folder::{SCRATCH_SUFFIX, remove_stale_scratch_of};
use crate::{Place, folder_of, sync_folder};

/// How often another scratch name is tried when the first one is taken by what a killed process left behind.
const NAME_ATTEMPTS: u32 = 64;

/// A scratch file or folder beside its target, `.NAME.PROCESS-NUMBER.partial`. It is removed when this is dropped
/// before it took the target's name; of a process that was killed, the next one with the same target removes it.
#[derive(Debug)]
pub struct Scratch {
    path: PathBuf,
    target: PathBuf,
    kept: bool,
}

impl Scratch {
    /// A new file beside `target`, and what killed processes left of the same target is removed. A link stays, and what
    /// it leads to is the target.
    ///
    /// # Errors
    /// When it cannot be made, and when the target is a folder, pipe, socket or device.
    pub fn file(target: &Path) -> io::Result<(Self, File)> {
        Self::fresh(target, |path| OpenOptions::new().read(true).write(true).create_new(true).open(path))
    }

    /// As [`Scratch::file`], a new folder: its target is none yet, or empty.
    ///
    /// # Errors
    /// When it cannot be made.
    pub fn folder(target: &Path) -> io::Result<Self> {
        remove_left(target);
        Self::beside(target, |path| fs::create_dir(path)).map(|(scratch, ())| scratch)
    }

    /// A new folder in the system's folder for temporary files, which nobody else may read and which goes away with
    /// this; those that killed processes left are removed.
    ///
    /// # Errors
    /// When it cannot be made.
    pub fn temporary_folder() -> io::Result<Self> {
        let target = std::env::temp_dir().join("farsight");
        remove_left(&target);
        let mut builder = fs::DirBuilder::new();
        #[cfg(unix)]
        std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
        Self::beside(&target, |path| builder.create(path)).map(|(scratch, ())| scratch)
    }

    fn fresh<T>(target: &Path, make: impl Fn(&Path) -> io::Result<T>) -> io::Result<(Self, T)> {
        let Place::File(target) = Place::of(target)? else {
            return Err(io::Error::other("a pipe, socket or device; expected a file"));
        };
        remove_left(&target);
        Self::beside(&target, make)
    }

    /// What `make` makes under a name of its own beside `target`.
    pub(crate) fn beside<T>(target: &Path, make: impl Fn(&Path) -> io::Result<T>) -> io::Result<(Self, T)> {
        // Two threads may write the same target; each needs a scratch file of its own.
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let name = target.file_name().ok_or_else(|| io::Error::from(io::ErrorKind::InvalidFilename))?;
        let mut outcome = Err(io::Error::from(io::ErrorKind::AlreadyExists));
        for _ in 0..NAME_ATTEMPTS {
            let number = NEXT.fetch_add(1, Ordering::Relaxed);
            let scratch_name = format!(".{}.{}-{number}{SCRATCH_SUFFIX}", name.to_string_lossy(), std::process::id());
            let path = folder_of(target).join(scratch_name);
            outcome = make(&path).map(|made| (path, made));
            if !matches!(&outcome, Err(error) if error.kind() == io::ErrorKind::AlreadyExists) {
                break;
            }
        }
        outcome.map(|(path, made)| (Self { path, target: target.to_owned(), kept: false }, made))
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Gives it the target's name, and returns once it would survive a power cut. A file must be closed before: some
    /// systems rename none that is open.
    ///
    /// # Errors
    /// When it cannot be synced or renamed; it is removed then.
    pub fn persist(self) -> io::Result<()> {
        if self.path.is_file() {
            OpenOptions::new().write(true).open(&self.path)?.sync_all()?;
        }
        let folder = folder_of(&self.target).to_owned();
        self.rename()?;
        sync_folder(&folder)
    }

    /// As [`Scratch::persist`], without waiting for the disk.
    pub(crate) fn rename(mut self) -> io::Result<()> {
        fs::rename(&self.path, &self.target)?;
        self.kept = true;
        Ok(())
    }
}

/// Removes what killed processes left of `target`. What cannot be removed is in nobody's way.
pub(crate) fn remove_left(target: &Path) {
    let name = target.file_name().unwrap_or_default().to_string_lossy();
    let _ = remove_stale_scratch_of(folder_of(target), &name);
}

impl Drop for Scratch {
    fn drop(&mut self) {
        if self.kept {
            return;
        }
        // The error that brought us here is the one worth reporting.
        let _ = if self.path.is_dir() { fs::remove_dir_all(&self.path) } else { fs::remove_file(&self.path) };
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<_> =
            fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn scratch_takes_the_name_of_its_target_or_goes_away() {
        let folder = tempfile::tempdir().unwrap();
        let (file, place) = (folder.path().join("a.mp4"), folder.path().join("parts"));
        let (scratch, mut out) = Scratch::file(&file).unwrap();
        let name = scratch.path().file_name().unwrap().to_string_lossy().into_owned();
        assert!(name.starts_with(&format!(".a.mp4.{}-", std::process::id())) && name.ends_with(".partial"), "{name}");
        out.write_all(b"whole").unwrap();
        drop(out);
        scratch.persist().unwrap();
        assert_eq!(fs::read(&file).unwrap(), b"whole");
        let scratch = Scratch::folder(&place).unwrap();
        fs::write(scratch.path().join("one"), "1").unwrap();
        scratch.persist().unwrap();
        for scratch in [Scratch::file(&file).unwrap().0, Scratch::folder(&folder.path().join("other")).unwrap()] {
            assert!(scratch.path().exists());
        }
        assert_eq!(
            (names(folder.path()), names(&place)),
            (vec!["a.mp4".to_owned(), "parts".to_owned()], vec!["one".to_owned()])
        );
        assert!(Scratch::file(&place).is_err() && Scratch::file(Path::new("/")).is_err());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn what_a_killed_process_left_of_the_same_target_is_removed() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        // No process has a larger number than 2^22.
        fs::write(at(".a.mp4.99999999-0.partial"), "half").unwrap();
        fs::write(at(".b.mp4.99999999-0.partial"), "of another target").unwrap();
        fs::create_dir_all(at(".parts.99999999-3.partial/within")).unwrap();
        drop(Scratch::file(&at("a.mp4")).unwrap());
        drop(Scratch::folder(&at("parts")).unwrap());
        assert_eq!(names(folder.path()), [".b.mp4.99999999-0.partial"]);
        assert!(Scratch::file(Path::new("/dev/null")).unwrap_err().to_string().contains("expected a file"));
    }
}

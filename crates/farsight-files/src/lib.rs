//! Writing a file so that nobody ever sees half of it.
//!
//! Every crate that writes files uses this one. The bytes go to a scratch file beside the target, which then takes its
//! name: [`write_atomically`] also asks the disk to keep it, [`write_quickly`] does not, for files that can be made
//! again. What grows for long, or is made by somebody else, goes to a [`Scratch`]. Reading is here, too, as far as it
//! must not wait or grow without end: [`read_file`]. Tables of figures that documents quote are a kind of file of their
//! own: [`MeasuredTable`].

mod folder;
mod measured;
mod read;
mod scratch;

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use thiserror::Error;

pub use folder::{FolderLock, remove_stale_scratch};
pub use measured::{MeasuredTable, TableError, machine, markdown_table, today};
pub use read::{MAX_CONFIG, MAX_TEXT, open_regular, read_config, read_file, read_text, text_up_to};
pub use scratch::Scratch;

/// Links that are followed one after the other; Linux gives up at as many.
const MAX_CHAIN: u32 = 40;

/// Why a file could not be written. The target is then as it was before.
#[derive(Debug, Error)]
#[error("{}: could not {step}: {source}", path.display())]
pub struct WriteError {
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
/// A link stays, and what it points to is replaced. Pipes and devices cannot be replaced: they are written to as they
/// are.
///
/// # Errors
/// [`WriteError`] names the target, the step and the system's answer; an error of `write` is passed on in it.
pub fn write_atomically(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), WriteError> {
    write_through(path, true, write)
}

/// As [`write_atomically`], without waiting for the disk: for label and result files, which come by the thousand and
/// can be made again.
///
/// # Errors
/// As [`write_atomically`].
pub fn write_quickly(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), WriteError> {
    write_through(path, false, write)
}

/// Whether [`write_atomically`] could write to `path` now: a scratch file is made beside the target and removed again,
/// with those that killed processes left of the same target.
///
/// For work that takes long: better told before it than after.
///
/// # Errors
/// As [`write_atomically`].
pub fn check_writable(path: &Path) -> Result<(), WriteError> {
    let failed = |step| move |source| WriteError { path: path.to_path_buf(), step, source };
    match Place::of(path).map_err(failed("write it"))? {
        Place::File(target) => {
            scratch::remove_left(&target);
            scratch_file(&target).map(drop).map_err(failed("create a scratch file beside it"))
        }
        // Opening a pipe waits for its reader.
        Place::Stream => Ok(()),
    }
}

fn write_through(
    path: &Path,
    sync: bool,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), WriteError> {
    let failed = |step| move |source| WriteError { path: path.to_path_buf(), step, source };
    let target = match Place::of(path).map_err(failed("write it"))? {
        Place::File(target) => target,
        Place::Stream => return write_to_stream(path, write).map_err(failed("write to it")),
    };
    let (scratch, file) = scratch_file(&target).map_err(failed("create a scratch file beside it"))?;
    let mut buffered = BufWriter::new(file);
    write(&mut buffered).map_err(failed("write it"))?;
    let file = buffered.into_inner().map_err(io::IntoInnerError::into_error).map_err(failed("write it"))?;
    if sync {
        file.sync_all().map_err(failed("sync it"))?;
    }
    // Some systems refuse to rename a file that is still open.
    drop(file);
    scratch.rename().map_err(failed("rename its scratch file"))?;
    if sync { sync_folder(folder_of(&target)).map_err(failed("sync its folder")) } else { Ok(()) }
}

fn scratch_file(target: &Path) -> io::Result<(Scratch, File)> {
    Scratch::beside(target, |path| OpenOptions::new().write(true).create_new(true).open(path))
}

fn write_to_stream(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let mut buffered = BufWriter::new(OpenOptions::new().write(true).open(path)?);
    write(&mut buffered)?;
    buffered.flush()
}

/// Where the bytes of a file go.
#[derive(Debug, PartialEq, Eq)]
enum Place {
    /// A file that is replaced, or made: what the path leads to through all links.
    File(PathBuf),
    /// A pipe or a device.
    Stream,
}

impl Place {
    fn of(path: &Path) -> io::Result<Self> {
        // The system follows links by itself, also those in /proc, which lead to no path.
        match fs::metadata(path) {
            Ok(there) if there.is_dir() => Err(io::Error::from(io::ErrorKind::IsADirectory)),
            Ok(there) if !there.is_file() => Ok(Self::Stream),
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
            // A file, or nothing yet.
            _ => end_of_links(path).map(Self::File),
        }
    }
}

/// What `path` leads to, whether it is there or not.
fn end_of_links(path: &Path) -> io::Result<PathBuf> {
    let mut path = path.to_path_buf();
    for _ in 0..MAX_CHAIN {
        match fs::read_link(&path) {
            Ok(target) => path = folder_of(&path).join(target),
            // No link.
            Err(_) => return Ok(path),
        }
    }
    Err(io::Error::other("too many links"))
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

    #[cfg(unix)]
    #[test]
    fn links_stay_and_what_they_lead_to_is_written() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("elsewhere")).unwrap();
        std::os::unix::fs::symlink("elsewhere/weights.bin", at("near")).unwrap();
        std::os::unix::fs::symlink("near", at("far")).unwrap();
        for content in [b"the first, through a link to nothing".as_slice(), b"another"] {
            check_writable(&at("far")).unwrap();
            write_atomically(&at("far"), |out| out.write_all(content)).unwrap();
            assert_eq!(fs::read(at("elsewhere/weights.bin")).unwrap(), content);
        }
        assert!(["near", "far"].iter().all(|name| fs::symlink_metadata(at(name)).unwrap().is_symlink()));
        assert_eq!(names(&at("elsewhere")), ["weights.bin"]);
        std::os::unix::fs::symlink("round", at("round")).unwrap();
        assert!(write_quickly(&at("round"), |out| out.write_all(b"new")).is_err());
    }

    #[cfg(unix)]
    #[test]
    fn a_pipe_is_written_to_and_stays() {
        use std::os::unix::fs::FileTypeExt;
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        if !made.is_ok_and(|status| status.success()) {
            println!("skipped: no mkfifo");
            return;
        }
        check_writable(&pipe).unwrap();
        let reader = std::thread::spawn({
            let pipe = pipe.clone();
            move || fs::read(pipe).unwrap()
        });
        write_quickly(&pipe, |out| out.write_all(b"through the pipe")).unwrap();
        assert_eq!(reader.join().unwrap(), b"through the pipe");
        assert!(fs::metadata(&pipe).unwrap().file_type().is_fifo());
        assert_eq!(names(folder.path()), ["pipe"]);
    }

    #[test]
    fn what_can_be_written_is_known_before() {
        let folder = tempfile::tempdir().unwrap();
        check_writable(&folder.path().join("weights.bin")).unwrap();
        assert!(names(folder.path()).is_empty());
        for target in [folder.path().join("nowhere/weights.bin"), folder.path().to_path_buf()] {
            assert!(check_writable(&target).is_err(), "{}", target.display());
        }
    }
}

//! Networks as an engine compiled them, kept from run to run: in 8 bits compiling one takes a second.
//!
//! Each network has a folder of its own, in which the engine writes a file of its own kind and finds it again. Beside
//! that lies its hash; what was changed since is made anew.

use std::fs::{self, File, OpenOptions};
use std::io;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use farsight_files::Scratch;
use farsight_graph::weights::hexadecimal;
use sha2::{Digest, Sha256};

use crate::library::Failure;

/// Name of the file with the hash of the others.
const HASH: &str = "sha256";

/// So much is kept, bytes. Beyond it goes what was used longest ago.
const MAX_KEPT: u64 = 256 << 20;

/// A folder of compiled networks. Several processes may use it at once.
pub(crate) struct CompiledCache {
    folder: PathBuf,
}

impl CompiledCache {
    /// The cache in `folder`, which need not be there.
    pub(crate) fn new(folder: &Path) -> Self {
        Self { folder: folder.to_owned() }
    }

    /// The name of the network that these parts make out: its file, its shapes, how it is to run.
    pub(crate) fn key(parts: &[&[u8]]) -> String {
        let mut hash = Sha256::new();
        for part in parts {
            hash.update((part.len() as u64).to_le_bytes());
            hash.update(part);
        }
        hexadecimal(&hash.finalize())
    }

    /// What `compile` makes of the network called `key` when it may use and write files in the folder that it is given.
    ///
    /// # Errors
    /// When `compile` fails, and when nothing can be written here.
    pub(crate) fn compiled<T>(
        &self,
        key: &str,
        mut compile: impl FnMut(&Path) -> Result<T, Failure>,
    ) -> Result<T, Failure> {
        let kept = self.folder.join(key);
        if is_whole(&kept) {
            let now = OpenOptions::new().append(true).open(kept.join(HASH));
            // It is only a little older than it should be.
            let _ = now.and_then(|file| file.set_modified(SystemTime::now()));
            return compile(&kept);
        }
        fs::create_dir_all(&self.folder)?;
        // It is not there or was changed; where it cannot be removed the new one is not kept.
        let _ = fs::remove_dir_all(&kept);
        let scratch = Scratch::folder(&kept)?;
        let made = compile(scratch.path())?;
        // Another process may have been faster, or the disk be full: the network runs all the same.
        let _ = seal(scratch.path()).and_then(|is_sealed| if is_sealed { scratch.persist() } else { Ok(()) });
        let _ = self.trim(MAX_KEPT);
        Ok(made)
    }

    /// Removes what was used longest ago until at most `limit` bytes are left.
    fn trim(&self, limit: u64) -> io::Result<()> {
        let mut kept: Vec<(SystemTime, u64, PathBuf)> = Vec::new();
        for entry in fs::read_dir(&self.folder)? {
            let path = entry?.path();
            // Without a hash it is being made.
            let Ok(used) = fs::metadata(path.join(HASH)).and_then(|hash| hash.modified()) else { continue };
            let size = files(&path)?.iter().map(|file| fs::metadata(file).map_or(0, |facts| facts.len())).sum();
            kept.push((used, size, path));
        }
        kept.sort();
        let mut left: u64 = kept.iter().map(|(_, size, _)| size).sum();
        for (_, size, path) in kept {
            if left <= limit {
                break;
            }
            fs::remove_dir_all(path)?;
            left -= size;
        }
        Ok(())
    }
}

/// Whether the folder's files are as they were when their hash was written.
fn is_whole(folder: &Path) -> bool {
    let hash = farsight_files::read_file(&folder.join(HASH), 1024);
    hash.is_ok_and(|hash| hash_of(folder).is_ok_and(|found| found.is_some_and(|found| found.as_bytes() == hash)))
}

/// Writes the hash of the folder's files; whether there are any.
fn seal(folder: &Path) -> io::Result<bool> {
    let hash = hash_of(folder)?;
    hash.map_or(Ok(false), |hash| fs::write(folder.join(HASH), hash).map(|()| true))
}

/// The hash of the folder's files but of the one with the hash; none where there is no other.
fn hash_of(folder: &Path) -> io::Result<Option<String>> {
    let files = files(folder)?;
    let mut hash = Sha256::new();
    for file in &files {
        hash.update(file.file_name().unwrap_or_default().as_encoded_bytes());
        hash.update(fs::metadata(file)?.len().to_le_bytes());
        io::copy(&mut File::open(file)?, &mut hash)?;
    }
    Ok((!files.is_empty()).then(|| hexadecimal(&hash.finalize())))
}

/// The regular files of a folder but the one with the hash, by their names.
fn files(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if entry.file_type()?.is_file() && entry.file_name() != HASH {
            files.push(entry.path());
        }
    }
    files.sort();
    Ok(files)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An engine that writes a file in the folder unless it finds one; what it makes is that file's text.
    fn engine(text: &str, runs: &mut u32) -> impl FnMut(&Path) -> Result<String, Failure> {
        move |folder| {
            let blob = folder.join("1.blob");
            if !blob.exists() {
                *runs += 1;
                fs::write(&blob, text)?;
            }
            Ok(fs::read_to_string(&blob)?)
        }
    }

    #[test]
    fn what_was_compiled_is_kept_and_what_was_changed_is_made_anew() {
        let folder = tempfile::tempdir().unwrap();
        let cache = CompiledCache::new(&folder.path().join("compiled"));
        let mut runs = 0;
        for expected_runs in [1, 1] {
            assert_eq!(cache.compiled("a", engine("whole", &mut runs)).unwrap(), "whole");
            assert_eq!(runs, expected_runs);
        }
        let kept = folder.path().join("compiled/a");
        for (file, text) in [("1.blob", "wHole"), (HASH, "0"), ("2.blob", "more")] {
            fs::write(kept.join(file), text).unwrap();
            runs = 0;
            assert_eq!(cache.compiled("a", engine("whole", &mut runs)).unwrap(), "whole", "{file}");
            assert_eq!(runs, 1, "{file}");
        }
        let names: Vec<_> =
            fs::read_dir(folder.path().join("compiled")).unwrap().map(|one| one.unwrap().path()).collect();
        assert_eq!(names, [kept]);
    }

    #[test]
    fn a_failure_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let cache = CompiledCache::new(folder.path());
        let error = cache.compiled("a", |_| Err::<(), _>("no such layer".into())).unwrap_err();
        assert_eq!(error.to_string(), "no such layer");
        // Nor does an engine that writes nothing.
        cache.compiled("a", |_| Ok(())).unwrap();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn what_was_used_longest_ago_goes_first() {
        let folder = tempfile::tempdir().unwrap();
        let cache = CompiledCache::new(folder.path());
        for (age, key) in ["old", "older", "new"].into_iter().enumerate() {
            cache.compiled(key, engine("ten bytes.", &mut 0)).unwrap();
            let age = std::time::Duration::from_secs([100, 200, 0][age]);
            let hash = OpenOptions::new().append(true).open(folder.path().join(key).join(HASH)).unwrap();
            hash.set_modified(SystemTime::now() - age).unwrap();
        }
        // Used again, it is the newest.
        cache.compiled("older", engine("", &mut 0)).unwrap();
        cache.trim(20).unwrap();
        let left = |key: &str| folder.path().join(key).exists();
        assert_eq!([left("old"), left("older"), left("new")], [false, true, true]);
    }

    #[test]
    fn keys_tell_where_parts_end() {
        assert_ne!(CompiledCache::key(&[b"ab", b"c"]), CompiledCache::key(&[b"a", b"bc"]));
        assert_eq!(CompiledCache::key(&[b"ab"]).len(), 64);
    }
}

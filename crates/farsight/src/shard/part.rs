//! A part being made.

use std::fs;
use std::io::ErrorKind;
use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use farsight_files::{FolderLock, write_atomically};

use super::Shard;
use super::manifest::{FILE, Hashed, Join, Manifest, Output, Run};

/// A part whose work is to be done: outputs go to its folder, which nobody sees before it is whole.
pub(crate) struct Part {
    shard: Shard,
    run: Run,
    inputs: Vec<Hashed>,
    /// Where the part appears.
    place: PathBuf,
    /// Holds the lock, and the folder that becomes the part.
    scratch: PathBuf,
    _lock: FolderLock,
}

impl Part {
    /// Begins a part; none where it is there already, made from the same. `files` are those of an item, by its number.
    ///
    /// # Errors
    /// When the part that is there was made from something else, or another process makes it now.
    pub(crate) fn begin(
        (shard, parts): (Shard, &Path),
        run: Run,
        items: &[String],
        files: impl Fn(usize) -> Vec<PathBuf>,
    ) -> Result<Option<Self>> {
        let inputs = shard.block(items.len()).map(|item| Hashed::of(items[item].clone(), &files(item)));
        let inputs = inputs.collect();
        let place = parts.join(shard.folder_name());
        let scratch = parts.join(format!(".{}.partial", shard.folder_name()));
        fs::create_dir_all(&scratch).with_context(|| format!("{}: cannot be made", scratch.display()))?;
        let shown = scratch.display().to_string();
        let failed = || format!("{shown}: cannot be written to");
        let Some(lock) = FolderLock::take(&scratch).with_context(failed)? else {
            bail!("{shown}: another process makes part {shard} now");
        };
        let part = Self { shard, run, inputs, place, scratch, _lock: lock };
        // Looked at under the lock: whoever had it before may have finished the part.
        if part.place.exists() {
            part.check_same()?;
            part.clear();
            return Ok(None);
        }
        match fs::remove_dir_all(part.folder()) {
            Err(error) if error.kind() != ErrorKind::NotFound => return Err(error).with_context(failed),
            _ => fs::create_dir(part.folder()).with_context(failed)?,
        }
        Ok(Some(part))
    }

    /// Where the outputs go.
    pub(crate) fn folder(&self) -> PathBuf {
        self.scratch.join("part")
    }

    /// Where an output goes, whose folder is made.
    pub(crate) fn output(&self, path: &Path) -> Result<PathBuf> {
        let path = self.folder().join(path);
        let folder = path.parent().unwrap_or(&path);
        fs::create_dir_all(folder).with_context(|| format!("{}: cannot be made", folder.display()))?;
        Ok(path)
    }

    /// The numbers of the items to do.
    pub(crate) fn block(&self) -> Range<usize> {
        self.shard.block(self.run.items)
    }

    /// Makes the part appear. `failed` are the items that could not be done; `join` says how an output joins with those
    /// of the same path.
    pub(crate) fn finish(self, failed: Vec<String>, join: impl Fn(&Path) -> Join) -> Result<()> {
        let folder = self.folder();
        let mut paths = Vec::new();
        files_below(&folder, Path::new(""), &mut paths)?;
        paths.sort();
        let outputs = paths.iter().map(|path| Output::of(&folder, path, join(path))).collect::<Result<_>>()?;
        let block = self.block();
        let manifest = Manifest {
            run: self.run.clone(),
            part: self.shard.number,
            first_item: block.start,
            inputs: self.inputs.clone(),
            done: block.len() - failed.len(),
            failed,
            outputs,
        };
        let text = serde_json::to_string_pretty(&manifest)? + "\n";
        write_atomically(&folder.join(FILE), |out| out.write_all(text.as_bytes()))?;
        fs::rename(&folder, &self.place).with_context(|| format!("{}: cannot be written", self.place.display()))?;
        self.clear();
        Ok(())
    }

    /// Whether the part that is there was made from the same.
    fn check_same(&self) -> Result<()> {
        let there = Manifest::read(&self.place)?;
        let shown = self.place.display();
        let hint = "expected the same, or another --parts";
        if let Some(difference) = there.run.difference(&self.run) {
            bail!("{shown}: made with {difference}; {hint}");
        }
        ensure!(there.part == self.shard.number, "{shown}: holds part {}; {hint}", there.part);
        match there.inputs.iter().zip(&self.inputs).find(|(then, now)| then != now) {
            Some((_, input)) => bail!("{shown}: made when {} had other bytes; {hint}", input.name),
            None => Ok(()),
        }
    }

    /// Removes what is left of the work. If it cannot be removed, it is in nobody's way.
    fn clear(&self) {
        let _ = fs::remove_dir_all(&self.scratch);
    }
}

/// The files below `folder`, by their paths from there.
fn files_below(folder: &Path, within: &Path, found: &mut Vec<PathBuf>) -> Result<()> {
    let place = folder.join(within);
    let failed = || format!("{}: cannot be listed", place.display());
    for entry in fs::read_dir(&place).with_context(failed)? {
        let entry = entry.with_context(failed)?;
        let path = within.join(entry.file_name());
        if entry.file_type().with_context(failed)?.is_dir() {
            files_below(folder, &path, found)?;
        } else {
            found.push(path);
        }
    }
    Ok(())
}

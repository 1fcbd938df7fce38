//! Parts put together, once it is sure that they are all there and belong together.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{BufWriter, Read, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use farsight_files::open_regular;
use farsight_graph::weights::hexadecimal;
use sha2::{Digest, Sha256};

use super::Shard;
use super::manifest::{FILE, Join, Manifest, Output, copy_and_hash};
use crate::json_array::{ArrayWriter, MAX_ANSWERS, each_element};

/// All parts of one job, in their order.
pub(crate) struct Parts(Vec<(PathBuf, Manifest)>);

impl Parts {
    /// Finds the parts in `folders`, each of which is a part or holds parts.
    ///
    /// # Errors
    /// When one is missing or there twice, or they are not of the same job.
    pub(crate) fn find(folders: &[PathBuf]) -> Result<Self> {
        let mut found = BTreeMap::<usize, (PathBuf, Manifest)>::new();
        for place in folders.iter().map(|folder| places(folder)).collect::<Result<Vec<_>>>()?.into_iter().flatten() {
            let manifest = Manifest::read(&place)?;
            if let Some((first, other)) = found.values().next()
                && let Some(difference) = other.run.difference(&manifest.run)
            {
                bail!("{}: {} is of {difference}; expected parts of one job", place.display(), first.display());
            }
            let number = manifest.part;
            if let Some((twin, _)) = found.insert(number, (place.clone(), manifest)) {
                bail!("{}: part {number} is in {}, too; expected each part once", place.display(), twin.display());
            }
        }
        let parts: Vec<_> = found.into_values().collect();
        let shown = || folders.iter().map(|folder| folder.display().to_string()).collect::<Vec<_>>().join(", ");
        let Some((_, first)) = parts.first() else {
            bail!("{}: no parts; expected folders such as 001-of-016", shown());
        };
        let (count, items) = (first.run.parts, first.run.items);
        let is_there = |number: &usize| parts.iter().any(|(_, manifest)| manifest.part == *number);
        let missing: Vec<String> = (1..=count).filter(|number| !is_there(number)).map(|n| n.to_string()).collect();
        ensure!(missing.is_empty(), "{}: of {count} parts there is no {}", shown(), missing.join(", "));
        for (place, manifest) in &parts {
            let block = Shard { number: manifest.part, count }.block(items);
            let is_whole = manifest.first_item == block.start && manifest.inputs.len() == block.len();
            ensure!(manifest.part <= count && is_whole, "{}: not the items of this part", place.join(FILE).display());
        }
        Ok(Self(parts))
    }

    /// The words of the command line that made them.
    pub(crate) fn words(&self) -> &[String] {
        self.0.first().map_or(&[], |(_, manifest)| &manifest.run.words)
    }

    /// Half the widths of the model's 50 and 90% intervals, where they were kept.
    pub(crate) fn interval_sigmas(&self) -> Option<[f64; 2]> {
        self.0.first().and_then(|(_, manifest)| manifest.run.interval_sigmas)
    }

    /// How many there are.
    pub(crate) fn len(&self) -> usize {
        self.0.len()
    }

    /// How many items were done.
    pub(crate) fn done(&self) -> usize {
        self.0.iter().map(|(_, manifest)| manifest.done).sum()
    }

    /// The names of all items, in order.
    pub(crate) fn items(&self) -> Vec<&str> {
        self.0.iter().flat_map(|(_, manifest)| &manifest.inputs).map(|input| input.name.as_str()).collect()
    }

    /// The names of the items that failed.
    pub(crate) fn failed(&self) -> Vec<&str> {
        self.0.iter().flat_map(|(_, manifest)| &manifest.failed).map(String::as_str).collect()
    }

    /// Writes all outputs below `target`, which is there and empty.
    pub(crate) fn write(&self, target: &Path) -> Result<()> {
        let mut outputs = BTreeMap::<&str, Vec<(&Path, &Output)>>::new();
        for (place, manifest) in &self.0 {
            for output in &manifest.outputs {
                outputs.entry(&output.path).or_default().push((place, output));
            }
        }
        for (path, pieces) in outputs {
            super::check_relative("output", Path::new(path)).context("a manifest that no command wrote")?;
            let target = target.join(path);
            let folder = target.parent().unwrap_or(&target);
            fs::create_dir_all(folder).with_context(|| format!("{}: cannot be made", folder.display()))?;
            join(&pieces, &target)?;
        }
        Ok(())
    }
}

/// The folders of parts that `folder` is or holds; hidden ones are not whole.
fn places(folder: &Path) -> Result<Vec<PathBuf>> {
    if folder.join(FILE).is_file() {
        return Ok(vec![folder.to_owned()]);
    }
    let failed = || format!("{}: cannot be listed; expected a folder of parts", folder.display());
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).with_context(failed)? {
        let path = entry.with_context(failed)?.path();
        if path.join(FILE).is_file() && !path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.')) {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

/// Makes one file of the pieces that parts have under the same path.
fn join(pieces: &[(&Path, &Output)], target: &Path) -> Result<()> {
    let [(first_place, first), others @ ..] = pieces else { return Ok(()) };
    for (place, other) in others {
        let same = first.join == other.join && (first.join != Join::Same || first.sha256 == other.sha256);
        let (place, first_place) = (place.join(&other.path), first_place.join(&first.path));
        ensure!(same, "{}: not the same as {}", place.display(), first_place.display());
        ensure!(first.join != Join::Own, "{}: is in {}, too", place.display(), first_place.display());
    }
    let unwritable = || format!("{}: cannot be written", target.display());
    let mut out = BufWriter::new(File::create(target).with_context(unwritable)?);
    match first.join {
        Join::Own | Join::Same => copy(first_place, first, &mut out)?,
        Join::Lines => pieces.iter().try_for_each(|(place, output)| copy(place, output, &mut out))?,
        Join::Array => {
            let mut array = ArrayWriter::new(&mut out);
            for (place, output) in pieces {
                let piece = place.join(&output.path);
                let shown = piece.display();
                ensure!(output.bytes <= MAX_ANSWERS, "{shown}: {} bytes; expected at most {MAX_ANSWERS}", output.bytes);
                let mut text = Vec::new();
                copy(place, output, &mut text)?;
                let mut full = None;
                let joined = each_element(&text, |element| array.add(&element).map_err(|error| full = Some(error)));
                if let Some(error) = full {
                    return Err(error).with_context(unwritable);
                }
                joined.with_context(|| shown.to_string())?;
            }
            array.finish().with_context(unwritable)?;
        }
    }
    out.flush().with_context(unwritable)
}

/// Copies an output of a part, if it is still as it was written.
fn copy(place: &Path, output: &Output, to: &mut dyn Write) -> Result<()> {
    let path = place.join(&output.path);
    let file = open_regular(&path).with_context(|| format!("{}: cannot be read", path.display()))?;
    let mut hash = Sha256::new();
    // One byte more than there should be tells that there are more.
    let file = file.take(output.bytes.saturating_add(1));
    let bytes = copy_and_hash(file, to, &mut hash).with_context(|| format!("{}: cannot be copied", path.display()))?;
    let is_as_written = bytes == output.bytes && hexadecimal(&hash.finalize()) == output.sha256;
    ensure!(is_as_written, "{}: not the bytes that {FILE} names; expected the part as it was written", path.display());
    Ok(())
}

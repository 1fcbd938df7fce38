//! What a part says about itself: `manifest.json` in its folder.

use std::fs::{self, File};
use std::io::{self, BufReader, Read, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use farsight::json::ModelRecord;
use farsight_files::text_up_to;
use farsight_graph::weights::hexadecimal;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

/// Its name in the folder of a part.
pub(crate) const FILE: &str = "manifest.json";

/// Manifests are shorter than this, bytes: a million items in one part.
const MAX_MANIFEST: u64 = 256 << 20;

/// Bytes that are read at a time.
const CHUNK: usize = 1 << 16;

/// What all parts of a job have in common.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Run {
    /// Version of the program.
    pub(crate) program_version: String,
    /// The words of the command line that decide about the results.
    pub(crate) words: Vec<String>,
    /// The models that look, if any do.
    pub(crate) model: Option<ModelRecord>,
    /// Half the widths of its 50 and 90% intervals, error bars, where what is found is judged.
    #[serde(default)]
    pub(crate) interval_sigmas: Option<[f64; 2]>,
    /// Files that every part reads, such as a calibration.
    pub(crate) shared: Vec<Hashed>,
    /// How many items there are in all parts.
    pub(crate) items: usize,
    /// SHA-256 of their names, in order, a line each.
    pub(crate) items_sha256: String,
    /// How many parts there are.
    pub(crate) parts: usize,
}

impl Run {
    /// This program's run of `words` over the `items` in `parts` parts.
    pub(crate) fn new(items: &[String], shared: &[PathBuf], model: Option<ModelRecord>, parts: usize) -> Self {
        let shared =
            shared.iter().map(|path| Hashed::of(path.to_string_lossy().into_owned(), std::slice::from_ref(path)));
        let lines: String = items.iter().flat_map(|item| [item, "\n"]).collect();
        Self {
            program_version: farsight::VERSION.to_owned(),
            words: super::words(),
            model,
            interval_sigmas: None,
            shared: shared.collect(),
            items: items.len(),
            items_sha256: hexadecimal(&Sha256::digest(lines)),
            parts,
        }
    }

    /// What of this run is another in `other`, and both values.
    pub(crate) fn difference(&self, other: &Self) -> Option<String> {
        let values = |run: &Self| {
            // Intervals follow from the models.
            let Self { program_version, words, model, interval_sigmas: _, shared, items, items_sha256, parts } = run;
            [
                ("version of the program", format!("{program_version:?}")),
                ("command line", format!("{:?}", words.join(" "))),
                ("number of parts", parts.to_string()),
                ("model", serde_json::to_string(model).unwrap_or_default()),
                ("files that all parts read", serde_json::to_string(shared).unwrap_or_default()),
                ("number of items", items.to_string()),
                ("items (SHA-256 of their names)", items_sha256.clone()),
            ]
        };
        let both = values(self).into_iter().zip(values(other));
        both.into_iter().find(|(a, b)| a != b).map(|((name, a), (_, b))| format!("another {name}: {a}, here {b}"))
    }
}

/// What was read, and its bytes' hash.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Hashed {
    /// An item, or a file.
    pub(crate) name: String,
    /// SHA-256 of its files, one after the other; null where one of them cannot be read.
    pub(crate) sha256: Option<String>,
}

impl Hashed {
    /// The hash of `files`, those in folders included; none where one cannot be read. Whoever needs the file says so
    /// better.
    pub(crate) fn of(name: String, files: &[PathBuf]) -> Self {
        let mut hash = Sha256::new();
        let read = files.iter().try_for_each(|path| add_all(path, &mut hash));
        Self { name, sha256: read.ok().map(|()| hexadecimal(&hash.finalize())) }
    }
}

fn add_all(path: &Path, hash: &mut Sha256) -> io::Result<()> {
    if path.is_dir() {
        let mut inside = fs::read_dir(path)?.map(|entry| Ok(entry?.path())).collect::<io::Result<Vec<_>>>()?;
        inside.sort();
        return inside.iter().filter(|path| path.is_file()).try_for_each(|path| add_all(path, hash));
    }
    // A pipe would wait for its writer, and be empty for whoever reads it next.
    if !path.is_file() {
        return Err(io::ErrorKind::InvalidInput.into());
    }
    copy_and_hash(File::open(path)?, &mut io::sink(), hash).map(drop)
}

/// Copies what is left of `from`, hashes it, and returns its length.
pub(crate) fn copy_and_hash(from: impl Read, to: &mut dyn Write, hash: &mut Sha256) -> io::Result<u64> {
    let mut from = BufReader::with_capacity(CHUNK, from);
    let (mut chunk, mut length) = (vec![0; CHUNK], 0);
    loop {
        let count = from.read(&mut chunk)?;
        if count == 0 {
            return Ok(length);
        }
        hash.update(&chunk[..count]);
        to.write_all(&chunk[..count])?;
        length += count as u64;
    }
}

/// How the same output of several parts becomes one file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Join {
    /// Only one part has it.
    Own,
    /// One after the other.
    Lines,
    /// JSON arrays become one.
    Array,
    /// All parts have the same.
    Same,
}

/// One file of a part.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Output {
    /// Below the folder of the part, names parted by `/`.
    pub(crate) path: String,
    pub(crate) join: Join,
    pub(crate) bytes: u64,
    pub(crate) sha256: String,
}

impl Output {
    /// The file `path` below `folder`.
    pub(crate) fn of(folder: &Path, path: &Path, join: Join) -> Result<Self> {
        let place = folder.join(path);
        let failed = || format!("{}: cannot be read", place.display());
        let mut hash = Sha256::new();
        let bytes = copy_and_hash(File::open(&place).with_context(failed)?, &mut io::sink(), &mut hash);
        let names: Vec<_> = path.iter().map(|name| name.to_string_lossy()).collect();
        Ok(Self {
            path: names.join("/"),
            join,
            bytes: bytes.with_context(failed)?,
            sha256: hexadecimal(&hash.finalize()),
        })
    }
}

/// All that a part says about itself.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Manifest {
    /// What it has in common with the other parts.
    #[serde(flatten)]
    pub(crate) run: Run,
    /// Its number, from 1.
    pub(crate) part: usize,
    /// Number of its first item among all, from 0.
    pub(crate) first_item: usize,
    /// Its items.
    pub(crate) inputs: Vec<Hashed>,
    /// How many of them were done.
    pub(crate) done: usize,
    /// Names of those that failed.
    pub(crate) failed: Vec<String>,
    /// Its files, sorted.
    pub(crate) outputs: Vec<Output>,
}

impl Manifest {
    /// Reads that of the part in `folder`.
    pub(crate) fn read(folder: &Path) -> Result<Self> {
        let path = folder.join(FILE);
        let text = text_up_to(&path, MAX_MANIFEST).with_context(|| {
            format!("{}: cannot be read; expected a part that a command with --shard wrote", path.display())
        })?;
        serde_json::from_str(&text).with_context(|| format!("{}: no manifest of a part", path.display()))
    }
}

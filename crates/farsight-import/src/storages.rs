//! The blocks of numbers beside the pickle, in both layouts of `torch.save`.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{Cursor, Read};

use zip::ZipArchive;
use zip::read::{ArchiveOffset, Config, ZipFile};
use zip::result::ZipError;

use super::error::CheckpointProblem;
use super::pickle::{Pickled, Value};

/// What the first pickle of the legacy layout holds, 0x1950a86a20f9469cfc6c, lowest byte first (PyTorch,
/// `torch/serialization.py`).
const LEGACY_MAGIC: [u8; 10] = [0x6c, 0xfc, 0x9c, 0x46, 0xf9, 0x20, 0x6a, 0xa8, 0x50, 0x19];

/// What the second pickle of the legacy layout holds.
const LEGACY_PROTOCOL: i64 = 1001;

/// First bytes of every zip archive.
const ZIP_START: &[u8] = b"PK";

/// First byte of every pickle of protocol 2 and later.
const PICKLE_START: u8 = 0x80;

/// The pickle that the file is about, and its storages.
pub(super) fn open(bytes: &[u8]) -> Result<(Pickled, Storages<'_>), CheckpointProblem> {
    if bytes.starts_with(ZIP_START) {
        return open_zip(bytes);
    }
    if bytes.first() == Some(&PICKLE_START) {
        return open_legacy(bytes);
    }
    Err(CheckpointProblem::Format { found: bytes.iter().copied().take(8).collect() })
}

/// Where the numbers are.
pub(super) enum Storages<'a> {
    /// PyTorch 1.6 and later: one archive entry a storage, `<prefix>data/<key>`.
    Zip { archive: ZipArchive<Cursor<&'a [u8]>>, prefix: String, budget: u64 },
    /// PyTorch 1.5 and earlier: one after the other behind the pickles.
    Legacy(BTreeMap<String, &'a [u8]>),
}

impl<'a> Storages<'a> {
    /// All bytes of the storage of this name.
    pub(super) fn read(&mut self, key: &str) -> Result<Cow<'a, [u8]>, CheckpointProblem> {
        let missing = || CheckpointProblem::NoStorage { key: key.to_owned() };
        match self {
            Self::Legacy(blocks) => blocks.get(key).map(|block| Cow::Borrowed(*block)).ok_or_else(missing),
            Self::Zip { archive, prefix, budget } => match archive.by_name(&format!("{prefix}data/{key}")) {
                Err(ZipError::FileNotFound) => Err(missing()),
                entry => Ok(Cow::Owned(read_entry(entry?, budget)?)),
            },
        }
    }
}

fn open_zip(bytes: &[u8]) -> Result<(Pickled, Storages<'_>), CheckpointProblem> {
    // Left to itself the zip crate guesses whether something stands before the archive, and guesses wrong for many
    // archives of PyTorch: they have the 64-bit end records without needing them.
    let config = Config { archive_offset: ArchiveOffset::Known(0) };
    let mut archive = ZipArchive::with_config(config, Cursor::new(bytes))?;
    let mut budget = bytes.len() as u64;
    let prefix = zip_prefix(&archive).ok_or(CheckpointProblem::NoPickle)?;
    match archive.by_name(&format!("{prefix}byteorder")) {
        // Files of PyTorch before 2.1 lack the entry; they are little-endian.
        Err(ZipError::FileNotFound) => {}
        entry => {
            if read_entry(entry?, &mut budget)? != b"little" {
                return Err(CheckpointProblem::BigEndian);
            }
        }
    }
    let pickle = read_entry(archive.by_name(&format!("{prefix}data.pkl"))?, &mut budget)?;
    Ok((Pickled::read(&pickle)?, Storages::Zip { archive, prefix, budget }))
}

/// The folder that holds everything, with its slash: its name is that of the file when it was written.
fn zip_prefix(archive: &ZipArchive<Cursor<&[u8]>>) -> Option<String> {
    let folder = |name: &str| name.strip_suffix("data.pkl").filter(|folder| folder.ends_with('/')).map(str::to_owned);
    archive.file_names().filter_map(Result::ok).find_map(|name| folder(&name))
}

/// The content of an entry, its checksum verified.
///
/// PyTorch stores without compression, so that all entries together are no longer than the file. `budget` keeps it so
/// for an archive whose entries overlap.
fn read_entry(entry: ZipFile<'_, Cursor<&[u8]>>, budget: &mut u64) -> Result<Vec<u8>, CheckpointProblem> {
    *budget = budget.checked_sub(entry.size()).ok_or(CheckpointProblem::TooMuch)?;
    let (size, mut content) = (entry.size(), Vec::new());
    entry.take(size.saturating_add(1)).read_to_end(&mut content)?;
    Ok(content)
}

/// Five pickles (magic number, version, machine, object, storage names), then each storage: its count as an i64 and its
/// bytes.
fn open_legacy(bytes: &[u8]) -> Result<(Pickled, Storages<'_>), CheckpointProblem> {
    let mut rest = bytes;
    let magic = next_pickle(&mut rest)?;
    if !matches!(magic.root(), Value::BigInt(number) if **number == LEGACY_MAGIC) {
        return Err(CheckpointProblem::Format { found: bytes.iter().copied().take(8).collect() });
    }
    if !matches!(next_pickle(&mut rest)?.root(), Value::Int(LEGACY_PROTOCOL)) {
        return Err(CheckpointProblem::Protocol);
    }
    let machine = next_pickle(&mut rest)?;
    if matches!(machine.entry(machine.root(), "little_endian"), Some(Value::Bool(false))) {
        return Err(CheckpointProblem::BigEndian);
    }
    let object = next_pickle(&mut rest)?;
    let blocks = legacy_blocks(&storage_names(&next_pickle(&mut rest)?)?, &object, rest)?;
    Ok((object, Storages::Legacy(blocks)))
}

fn next_pickle(rest: &mut &[u8]) -> Result<Pickled, CheckpointProblem> {
    let pickle = Pickled::read(rest)?;
    *rest = &rest[pickle.length..];
    Ok(pickle)
}

fn storage_names(pickle: &Pickled) -> Result<Vec<String>, CheckpointProblem> {
    let wrong = |value: &Value| CheckpointProblem::StorageList { found: value.describe().to_owned() };
    let Value::List(names) = pickle.root() else { return Err(wrong(pickle.root())) };
    let name = |value: &Value| if let Value::Text(name) = value { Ok(name.to_string()) } else { Err(wrong(value)) };
    names.iter().map(|id| name(pickle.get(*id))).collect()
}

fn legacy_blocks<'a>(
    names: &[String],
    object: &Pickled,
    mut rest: &'a [u8],
) -> Result<BTreeMap<String, &'a [u8]>, CheckpointProblem> {
    let sizes: BTreeMap<&str, usize> = object.storages().map(|s| (&*s.key, s.kind.size)).collect();
    let mut blocks = BTreeMap::new();
    for name in names {
        let cut_short = |expected| CheckpointProblem::StorageLength { key: name.clone(), found: rest.len(), expected };
        let size = *sizes.get(&**name).ok_or_else(|| CheckpointProblem::NoStorage { key: name.clone() })?;
        let (count, data) = rest.split_first_chunk::<8>().ok_or_else(|| cut_short(8))?;
        let length = usize::try_from(u64::from_le_bytes(*count)).unwrap_or(usize::MAX).saturating_mul(size);
        let (block, behind) = data.split_at_checked(length).ok_or_else(|| cut_short(length))?;
        blocks.insert(name.clone(), block);
        rest = behind;
    }
    Ok(blocks)
}

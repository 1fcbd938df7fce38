//! A finished cell in one small file, which can be committed: arms are compared without training them again.

use std::collections::BTreeMap;
use std::fs;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use farsight_files::{open_regular, read_text, write_atomically, write_quickly};
use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use serde::{Deserialize, Serialize};

use super::cell::{CellFolder, is_of};
use crate::experiment::Cell;
use crate::experiment::results::CellResult;

/// No record is longer than this, bytes of JSON: twenty times one of KITTI's 3,769 frames.
const MAX_BYTES: u64 = 100 << 20;

/// What a cell gave, frame by frame.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Record {
    /// As in the folder of the cell: plan, data, start and program.
    pub(super) identity: String,
    pub(super) measured: CellResult,
    /// KITTI's rows by the names of frames.
    answers: BTreeMap<String, String>,
}

/// Where the record of a cell is.
pub(super) fn path(records: &Path, cell: &Cell) -> PathBuf {
    records.join(format!("{}.json.gz", cell.name()))
}

impl Record {
    /// The record of a cell that is done; `frames` are those that it is judged on.
    pub(super) fn of(folder: &CellFolder, identity: &str, measured: CellResult, frames: &[String]) -> Result<Self> {
        let answer = |id: &String| {
            let path = folder.answer(id);
            let text = read_text(&path).with_context(|| format!("{}: cannot be read", path.display()))?;
            Ok((id.clone(), text))
        };
        let answers = frames.iter().map(answer).collect::<Result<_>>()?;
        Ok(Self { identity: identity.to_owned(), measured, answers })
    }

    /// Reads the record at `path`, which must be of `identity`; of any start where that is not known.
    pub(super) fn read(path: &Path, identity: &str) -> Result<Self> {
        let shown = path.display();
        let file = open_regular(path).with_context(|| format!("{shown}: cannot be read"))?;
        let mut text = String::new();
        let unpacked = GzDecoder::new(file).take(MAX_BYTES).read_to_string(&mut text);
        unpacked.with_context(|| format!("{shown}: cannot be unpacked"))?;
        let record: Self = serde_json::from_str(&text).with_context(|| format!("{shown}: not the record of a cell"))?;
        let expected = "expected the plan, data, start and program of this one; or another --records";
        ensure!(is_of(&record.identity, identity), "{shown}: a cell of another experiment; {expected}");
        Ok(record)
    }

    /// Writes it to `path`, as a whole or not at all.
    pub(super) fn write(&self, path: &Path) -> Result<()> {
        let text = serde_json::to_vec(self)?;
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent).with_context(|| format!("{}: cannot be made", parent.display()))?;
        }
        Ok(write_atomically(path, |file| {
            let mut packed = GzEncoder::new(file, Compression::best());
            io::Write::write_all(&mut packed, &text)?;
            packed.finish().map(|_| ())
        })?)
    }

    /// Puts the answers into the folder of the cell.
    pub(super) fn unpack(&self, folder: &CellFolder) -> Result<()> {
        for (id, rows) in &self.answers {
            let is_name = !id.is_empty() && id.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '_' | '-'));
            ensure!(is_name, "a frame called \"{id}\"; expected letters, digits, _ and -");
            write_quickly(&folder.answer(id), |file| file.write_all(rows.as_bytes()))?;
        }
        Ok(())
    }
}

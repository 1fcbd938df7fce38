//! Where the shared test data lies, and how it becomes frames.
#![allow(dead_code, unreachable_pub)] // Each test file is a crate of its own and uses a part.
#![allow(clippy::unwrap_used)] // Helpers of tests.

pub mod awkward;

use std::path::{Path, PathBuf};
use std::process::Command;

use farsight_data::kitti::{RowKind, rows_as_devkit};
use farsight_eval::{Frame, Prediction};
use farsight_testing::kitti;

/// The frame whose files are called `id`.txt, read as the devkit does.
pub fn frame(labels: &Path, results: &Path, id: &str) -> Frame {
    let rows = |folder: &Path, kind| {
        let text = std::fs::read_to_string(folder.join(format!("{id}.txt"))).unwrap_or_default();
        rows_as_devkit(&text, kind).rows
    };
    Frame {
        id: id.to_owned(),
        labels: rows(labels, RowKind::Label).into_iter().map(|row| row.row.label).collect(),
        predictions: rows(results, RowKind::Result).into_iter().map(Prediction::from).collect(),
    }
}

/// Ids of the files in a folder, sorted.
pub fn ids(folder: &Path) -> Vec<String> {
    let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut ids: Vec<_> = files.map(|path| path.file_stem().unwrap().to_string_lossy().into_owned()).collect();
    ids.sort();
    ids
}

/// The two real result sets: labels, ids of the val split, and result folders by name.
pub struct RealSets {
    pub labels: PathBuf,
    pub ids: Vec<String>,
    pub results: PathBuf,
    _scratch: tempfile::TempDir,
}

impl RealSets {
    pub const NAMES: [&str; 2] = ["pointgnn_vishnuu95", "m3drpn_piethonista"];

    /// Unpacks them into a scratch folder that goes with this value.
    pub fn unpacked() -> Option<Self> {
        let shared = kitti("")?;
        let scratch = tempfile::tempdir().unwrap();
        for archive in ["labels-and-calib.tar.xz", "val-results.tar.xz"] {
            let archive = shared.join(archive);
            let unpacked = Command::new("tar").arg("-xf").arg(&archive).arg("-C").arg(scratch.path()).status();
            if !unpacked.is_ok_and(|status| status.success()) {
                eprintln!("skipped: {} cannot be unpacked with tar", archive.display());
                return None;
            }
        }
        let ids = farsight_data::kitti::read_split(&scratch.path().join("ImageSets/val.txt")).unwrap();
        Some(Self {
            labels: scratch.path().join("training/label_2"),
            ids,
            results: scratch.path().to_owned(),
            _scratch: scratch,
        })
    }

    /// The frames of one result set, in the order of the split.
    pub fn frames(&self, name: &str) -> Vec<Frame> {
        let results = self.results.join(name).join("data");
        self.ids.iter().map(|id| frame(&self.labels, &results, id)).collect()
    }
}

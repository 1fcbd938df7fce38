//! Where the material lies that is not part of the project: real KITTI files. Shared with the tests of the methods.
#![allow(dead_code, reason = "each user needs a part of it")]

use std::path::PathBuf;
use std::process::Command;
use std::sync::OnceLock;

use farsight_core::{Camera, Label};
use farsight_data::kitti::{Calibration, read_labels};
use farsight_testing::kitti;
use tempfile::TempDir;

/// Unpacks an archive of the KITTI folder with the system's tar.
pub(crate) fn unpacked(archive: &str) -> Option<TempDir> {
    let archive = kitti("")?.join(archive);
    let target = tempfile::tempdir().unwrap();
    let status = Command::new("tar").arg("-xf").arg(&archive).arg("-C").arg(target.path()).status();
    if status.is_ok_and(|status| status.success()) {
        return Some(target);
    }
    println!("skipped: tar (with xz) cannot unpack {}", archive.display());
    None
}

/// A frame without its pixels.
pub(crate) struct LabelledView {
    pub(crate) id: String,
    pub(crate) camera: Camera,
    pub(crate) labels: Vec<Label>,
}

/// KITTI's frames come in four sizes; where only labels are at hand, this one is taken.
pub(crate) const IMAGE_SIZE: [usize; 2] = [1242, 375];

/// Cameras and labels of all 7,481 frames, sorted by id; unpacked once for all tests.
pub(crate) fn all_views() -> Option<&'static [LabelledView]> {
    static VIEWS: OnceLock<Option<Vec<LabelledView>>> = OnceLock::new();
    VIEWS.get_or_init(read_views).as_deref()
}

fn read_views() -> Option<Vec<LabelledView>> {
    let unpacked = unpacked("labels-and-calib.tar.xz")?;
    let training = unpacked.path().join("training");
    let mut files: Vec<_> =
        std::fs::read_dir(training.join("label_2")).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    let view = |file: &PathBuf| {
        let id = file.file_stem().unwrap().to_str().unwrap().to_owned();
        let calibration = Calibration::read(&training.join("calib").join(format!("{id}.txt"))).unwrap();
        LabelledView { id, camera: calibration.camera(), labels: read_labels(file).unwrap() }
    };
    Some(files.iter().map(view).collect())
}

//! Where the material lies that is not part of the project: goldens and real KITTI files. Shared with the tests of the methods.
#![allow(dead_code, reason = "each user needs a part of it")]

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use farsight_core::{Camera, Label};
use farsight_data::kitti::{Calibration, read_labels};
use safetensors::SafeTensors;
use tempfile::TempDir;

/// The folder that `variable` names, or `default`, both relative to the workspace; `None`, with a word about it, when it is not there.
fn folder(variable: &str, default: &str) -> Option<PathBuf> {
    let workspace = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let path = workspace.join(std::env::var_os(variable).unwrap_or_else(|| default.into()));
    if path.is_dir() {
        return Some(path);
    }
    println!("skipped: no folder {}; set {variable}", path.display());
    None
}

pub(crate) fn kitti_folder() -> Option<PathBuf> {
    folder("FARSIGHT_KITTI", "../shared/kitti")
}

/// Tensors of one golden file.
pub(crate) struct Golden(Vec<u8>);

impl Golden {
    pub(crate) fn open(name: &str) -> Option<Self> {
        let path = folder("FARSIGHT_GOLDEN", "../shared/golden")?.join(format!("{name}.safetensors"));
        Some(Self(std::fs::read(path).unwrap()))
    }

    fn bytes<const SIZE: usize>(&self, tensor: &str) -> Vec<[u8; SIZE]> {
        let file = SafeTensors::deserialize(&self.0).unwrap();
        let (values, rest) = file.tensor(tensor).unwrap().data().as_chunks::<SIZE>();
        assert!(rest.is_empty());
        values.to_vec()
    }

    pub(crate) fn bytes_of(&self, tensor: &str) -> Vec<u8> {
        self.bytes::<1>(tensor).into_iter().map(u8::from_le_bytes).collect()
    }

    pub(crate) fn numbers(&self, tensor: &str) -> Vec<f64> {
        self.bytes(tensor).into_iter().map(|b| f64::from(f32::from_le_bytes(b))).collect()
    }

    /// Row by row.
    pub(crate) fn rows<const WIDTH: usize>(&self, tensor: &str) -> Vec<[f64; WIDTH]> {
        self.numbers(tensor).as_chunks::<WIDTH>().0.to_vec()
    }
}

/// Unpacks an archive of the KITTI folder with the system's tar.
pub(crate) fn unpacked(archive: &str) -> Option<TempDir> {
    let archive = kitti_folder()?.join(archive);
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

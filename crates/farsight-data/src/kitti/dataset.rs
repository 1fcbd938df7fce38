//! A folder of frames in KITTI's layout.

use std::path::{Path, PathBuf};
use std::{fs, io};

use farsight_core::{Camera, Label};
use thiserror::Error;

use super::calibration::{Calibration, CalibrationError};
use super::rows::{RowsError, read_labels};
use super::split::{SplitError, is_id, read_split};
use crate::Frame;
use crate::image_io::{ImageError, has_image_extension, image_named, read_image};
use crate::plates::{PlatesError, read_plates};

/// Frames with images, calibrations and labels.
///
/// Either `ROOT/training/{image_2,calib,label_2}` or `ROOT/{image_2,calib,label_2}`; splits lie in `ImageSets` in or beside that folder.
/// Images are PNG or JPEG. Rendered data sets have a folder `plates`, too ([`crate::plates`]).
#[derive(Debug, Clone)]
pub struct KittiDataset {
    folder: PathBuf,
    ids: Vec<String>,
}

/// A data set that could not be opened, or a frame that could not be loaded.
#[derive(Debug, Error)]
pub enum DatasetError {
    /// The folder does not have KITTI's layout.
    #[error(
        "{}: no folder \"{missing}\"; expected {{image_2,calib,label_2}} here or in training/", root.display()
    )]
    Layout {
        /// The folder that was given.
        root: PathBuf,
        /// What it lacks.
        missing: &'static str,
    },
    /// A folder cannot be listed.
    #[error("{}: cannot be listed: {source}", path.display())]
    List {
        /// The folder.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// There is no such split.
    #[error("no split \"{name}\"; expected a file such as {}", expected.display())]
    NoSplit {
        /// What was asked for.
        name: String,
        /// Where it was looked for.
        expected: PathBuf,
    },
    /// There is no image.
    #[error("{}: no images; expected files such as 000000.png", path.display())]
    NoImages {
        /// The folder.
        path: PathBuf,
    },
    /// Frames lack files.
    #[error("{count} of {total} frames lack files; the first is {id}: expected {}", expected.display())]
    Incomplete {
        /// How many frames.
        count: usize,
        /// Of how many.
        total: usize,
        /// The first of them.
        id: String,
        /// A file that it lacks.
        expected: PathBuf,
    },
    /// The split file is malformed.
    #[error(transparent)]
    Split(#[from] SplitError),
    /// An image cannot be read.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A calibration cannot be read.
    #[error(transparent)]
    Calibration(#[from] CalibrationError),
    /// A label file cannot be read.
    #[error(transparent)]
    Labels(#[from] RowsError),
    /// A file of number plates cannot be read.
    #[error(transparent)]
    Plates(#[from] PlatesError),
}

impl KittiDataset {
    /// Opens the data set at `root`: the frames of `split`, or all that have an image, sorted by id.
    ///
    /// `split` is a name (`train` stands for `ImageSets/train.txt`) or the path of a split file. Every frame is checked for its files
    /// here, so that a training does not end at the last frame of its first epoch.
    ///
    /// # Errors
    /// When folders, the split or files of a frame are missing, or the split file is malformed.
    pub fn open(root: &Path, split: Option<&Path>) -> Result<Self, DatasetError> {
        let folder = frames_folder(root)?;
        let ids = match split {
            Some(split) => read_split(&split_path(root, split)?)?,
            None => ids_with_image(&folder.join("image_2"))?,
        };
        let dataset = Self { folder, ids };
        dataset.check_files()?;
        Ok(dataset)
    }

    /// Ids of the frames, in the order of the split.
    pub fn ids(&self) -> &[String] {
        &self.ids
    }

    /// How many frames there are.
    pub fn len(&self) -> usize {
        self.ids.len()
    }

    /// Whether there is no frame; never, for a data set that was opened.
    pub fn is_empty(&self) -> bool {
        self.ids.is_empty()
    }

    /// Whether it lists the number plates that its images show, as rendered data sets do.
    pub fn knows_plates(&self) -> bool {
        self.folder.join("plates").is_dir()
    }

    /// The folder of the label files.
    pub fn label_folder(&self) -> PathBuf {
        self.folder.join("label_2")
    }

    /// Frame number `index`: its pixels, camera and labels.
    ///
    /// # Errors
    /// When one of its files cannot be read.
    ///
    /// # Panics
    /// When there is no such frame, as for every slice; so do the other readers of one frame.
    pub fn load(&self, index: usize) -> Result<Frame, DatasetError> {
        Ok(Frame {
            id: self.ids[index].clone(),
            image: read_image(&self.image_path(index))?,
            camera: self.load_camera(index)?,
            labels: self.load_labels(index)?,
            depth_m: None,
            plates: read_plates(&self.path("plates", index, "txt"))?,
        })
    }

    /// The camera of frame number `index`.
    ///
    /// # Errors
    /// When its calibration cannot be read.
    pub fn load_camera(&self, index: usize) -> Result<Camera, DatasetError> {
        Ok(Calibration::read(&self.path("calib", index, "txt"))?.camera())
    }

    /// The labels of frame number `index`.
    ///
    /// # Errors
    /// When its label file cannot be read.
    pub fn load_labels(&self, index: usize) -> Result<Vec<Label>, DatasetError> {
        Ok(read_labels(&self.path("label_2", index, "txt"))?)
    }

    /// The image file of frame number `index`.
    pub fn image_path(&self, index: usize) -> PathBuf {
        let found = image_named(&self.folder.join("image_2"), &self.ids[index]);
        found.unwrap_or_else(|| self.path("image_2", index, "png"))
    }

    fn path(&self, folder: &str, index: usize, extension: &str) -> PathBuf {
        self.folder.join(folder).join(format!("{}.{extension}", self.ids[index]))
    }

    fn check_files(&self) -> Result<(), DatasetError> {
        let missing = |index: usize| {
            let files = [self.image_path(index), self.path("calib", index, "txt"), self.path("label_2", index, "txt")];
            files.into_iter().find(|path| !path.is_file()).map(|path| (index, path))
        };
        let mut incomplete = (0..self.len()).filter_map(missing);
        let Some((index, expected)) = incomplete.next() else { return Ok(()) };
        let count = 1 + incomplete.count();
        Err(DatasetError::Incomplete { count, total: self.len(), id: self.ids[index].clone(), expected })
    }
}

fn frames_folder(root: &Path) -> Result<PathBuf, DatasetError> {
    let training = root.join("training");
    let folder = if training.is_dir() { training } else { root.to_owned() };
    match ["image_2", "calib", "label_2"].into_iter().find(|name| !folder.join(name).is_dir()) {
        None => Ok(folder),
        Some(missing) => Err(DatasetError::Layout { root: root.to_owned(), missing }),
    }
}

/// A path that is a file is taken as it is; otherwise a name in `ImageSets`, which lies in the root or, for a root that is itself
/// `training`, beside it.
fn split_path(root: &Path, split: &Path) -> Result<PathBuf, DatasetError> {
    let file = format!("{}.txt", split.display());
    let expected = root.join("ImageSets").join(&file);
    let candidates = [split.to_owned(), expected.clone(), root.join("..").join("ImageSets").join(&file)];
    let found = candidates.into_iter().find(|path| path.is_file());
    found.ok_or_else(|| DatasetError::NoSplit { name: split.display().to_string(), expected })
}

fn ids_with_image(folder: &Path) -> Result<Vec<String>, DatasetError> {
    let failed = |source| DatasetError::List { path: folder.to_owned(), source };
    let mut ids = Vec::new();
    for entry in fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        let id = path.file_stem().and_then(|stem| stem.to_str()).filter(|id| has_image_extension(&path) && is_id(id));
        ids.extend(id.map(str::to_owned));
    }
    ids.sort();
    ids.dedup();
    if ids.is_empty() { Err(DatasetError::NoImages { path: folder.to_owned() }) } else { Ok(ids) }
}

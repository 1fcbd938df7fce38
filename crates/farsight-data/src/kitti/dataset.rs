//! A folder of frames in KITTI's layout.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::{fs, io};

use farsight_core::road::RoadPlane;
use farsight_core::{Camera, Label};
use image::RgbImage;
use thiserror::Error;

use super::calibration::{Calibration, CalibrationError};
use super::rows::{RowsError, read_labels};
use super::split::{SplitError, is_id, read_split};
use crate::annotations::{Annotations, FILE_FORMATS, FileFormat};
use crate::class_map::{ClassMap, ClassMapError};
use crate::dataset::{Dataset, DatasetError, DatasetFormat};
use crate::image_io::{has_image_extension, image_named, read_image};

/// What [`open_dataset`](crate::formats::open_dataset) knows of KITTI's layout.
pub const FORMAT: DatasetFormat = DatasetFormat {
    name: "kitti",
    layout: "{image_2,calib,label_2} here or in training/",
    is_at: |root| FOLDERS.iter().any(|name| base(root).join(name).is_dir()),
    open: |root, split| Ok(Arc::new(KittiDataset::open(root, split)?)),
};

/// What every frame has a file in.
const FOLDERS: [&str; 3] = ["image_2", "calib", "label_2"];

/// The file that says what class names of the labels mean, where they are not KITTI's.
const CLASSES_FILE: &str = "classes.txt";

/// Frames with images, calibrations and labels.
///
/// Either `ROOT/training/{image_2,calib,label_2}` or `ROOT/{image_2,calib,label_2}`; splits lie in `ImageSets` in or
/// beside that folder. Images are PNG or JPEG. Annotations in files ([`FILE_FORMATS`]) lie beside them, as rendered
/// data sets have them. Class names that are not KITTI's are mapped by `ROOT/classes.txt` ([`ClassMap::read`]), if
/// there is one.
#[derive(Debug, Clone)]
pub struct KittiDataset {
    root: PathBuf,
    folder: PathBuf,
    ids: Vec<String>,
    classes: ClassMap,
    annotations: Vec<FileFormat>,
}

/// A folder in KITTI's layout that could not be opened.
#[derive(Debug, Error)]
pub enum KittiError {
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
    /// The file of class names is malformed.
    #[error(transparent)]
    Classes(#[from] ClassMapError),
}

impl From<KittiError> for DatasetError {
    fn from(error: KittiError) -> Self {
        Self::other(error)
    }
}

impl From<CalibrationError> for DatasetError {
    fn from(error: CalibrationError) -> Self {
        Self::other(error)
    }
}

impl From<RowsError> for DatasetError {
    fn from(error: RowsError) -> Self {
        Self::other(error)
    }
}

impl KittiDataset {
    /// Opens the data set at `root`: the frames of `split`, or all that have an image, sorted by id.
    ///
    /// `split` is a name (`train` stands for `ImageSets/train.txt`) or the path of a split file. Every frame is checked
    /// for its files here, so that a training does not end at the last frame of its first epoch.
    ///
    /// # Errors
    /// When folders, the split or files of a frame are missing, or the split file is malformed.
    pub fn open(root: &Path, split: Option<&Path>) -> Result<Self, KittiError> {
        let folder = frames_folder(root)?;
        let ids = match split {
            Some(split) => read_split(&split_path(root, split)?)?,
            None => ids_with_image(&folder.join("image_2"))?,
        };
        let places = [root, &folder].map(|place| place.join(CLASSES_FILE));
        let classes = places.iter().find(|path| path.is_file()).map(|path| ClassMap::read(path)).transpose()?;
        let annotations = FILE_FORMATS.into_iter().filter(|format| folder.join(format.name).is_dir()).collect();
        let dataset = Self { root: root.to_owned(), folder, ids, classes: classes.unwrap_or_default(), annotations };
        dataset.check_files()?;
        Ok(dataset)
    }

    /// The image file of frame number `index`.
    fn image_path(&self, index: usize) -> PathBuf {
        let found = image_named(&self.folder.join("image_2"), &self.ids[index]);
        found.unwrap_or_else(|| self.path("image_2", index, "png"))
    }

    fn path(&self, folder: &str, index: usize, extension: &str) -> PathBuf {
        self.folder.join(folder).join(format!("{}.{extension}", self.ids[index]))
    }

    fn check_files(&self) -> Result<(), KittiError> {
        let missing = |index: usize| {
            let files = [self.image_path(index), self.path("calib", index, "txt"), self.path("label_2", index, "txt")];
            files.into_iter().find(|path| !path.is_file()).map(|path| (index, path))
        };
        let mut incomplete = (0..self.ids.len()).filter_map(missing);
        let Some((index, expected)) = incomplete.next() else { return Ok(()) };
        let count = 1 + incomplete.count();
        Err(KittiError::Incomplete { count, total: self.ids.len(), id: self.ids[index].clone(), expected })
    }
}

impl Dataset for KittiDataset {
    fn name(&self) -> String {
        self.root.display().to_string()
    }

    fn len(&self) -> usize {
        self.ids.len()
    }

    fn id(&self, index: usize) -> String {
        self.ids[index].clone()
    }

    fn origin(&self, index: usize) -> String {
        self.image_path(index).display().to_string()
    }

    fn image(&self, index: usize) -> Result<RgbImage, DatasetError> {
        Ok(read_image(&self.image_path(index))?)
    }

    fn camera(&self, index: usize) -> Result<Camera, DatasetError> {
        Ok(Calibration::read(&self.path("calib", index, "txt"))?.camera())
    }

    fn road(&self, index: usize) -> Result<Option<RoadPlane>, DatasetError> {
        Ok(Calibration::read(&self.path("calib", index, "txt"))?.road)
    }

    fn labels(&self, index: usize) -> Result<Vec<Label>, DatasetError> {
        let mut labels = read_labels(&self.path("label_2", index, "txt"))?;
        for label in &mut labels {
            label.class = self.classes.class(label.class.name());
        }
        Ok(labels)
    }

    fn annotation_names(&self) -> Vec<&'static str> {
        self.annotations.iter().map(|format| format.name).collect()
    }

    fn annotations(&self, index: usize) -> Result<Annotations, DatasetError> {
        let mut annotations = Annotations::default();
        for format in &self.annotations {
            format.read(&self.folder, &self.ids[index], &mut annotations)?;
        }
        Ok(annotations)
    }

    fn folders(&self) -> Vec<PathBuf> {
        let annotations = self.annotations.iter().map(|format| format.name);
        FOLDERS.into_iter().chain(annotations).map(|name| self.folder.join(name)).collect()
    }

    fn label_folder(&self) -> Option<PathBuf> {
        self.classes.is_identity().then(|| self.folder.join("label_2"))
    }
}

/// The folder that the folders of the frames are in.
fn base(root: &Path) -> PathBuf {
    let training = root.join("training");
    if training.is_dir() { training } else { root.to_owned() }
}

fn frames_folder(root: &Path) -> Result<PathBuf, KittiError> {
    let folder = base(root);
    match FOLDERS.into_iter().find(|name| !folder.join(name).is_dir()) {
        None => Ok(folder),
        Some(missing) => Err(KittiError::Layout { root: root.to_owned(), missing }),
    }
}

/// A path that is a file is taken as it is; otherwise a name in `ImageSets`, which lies in the root or, for a root that
/// is itself `training`, beside it.
fn split_path(root: &Path, split: &Path) -> Result<PathBuf, KittiError> {
    let file = format!("{}.txt", split.display());
    let expected = root.join("ImageSets").join(&file);
    let candidates = [split.to_owned(), expected.clone(), root.join("..").join("ImageSets").join(&file)];
    let found = candidates.into_iter().find(|path| path.is_file());
    found.ok_or_else(|| KittiError::NoSplit { name: split.display().to_string(), expected })
}

fn ids_with_image(folder: &Path) -> Result<Vec<String>, KittiError> {
    let failed = |source| KittiError::List { path: folder.to_owned(), source };
    let mut ids = Vec::new();
    for entry in fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        let id = path.file_stem().and_then(|stem| stem.to_str()).filter(|id| has_image_extension(&path) && is_id(id));
        ids.extend(id.map(str::to_owned));
    }
    ids.sort();
    ids.dedup();
    if ids.is_empty() { Err(KittiError::NoImages { path: folder.to_owned() }) } else { Ok(ids) }
}

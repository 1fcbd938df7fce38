//! A folder of images without labels.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use farsight_core::camera::CameraError;
use farsight_core::{Camera, Label};
use image::RgbImage;
use thiserror::Error;

use super::{Dataset, DatasetError};
use crate::image_io::{ImageLimits, has_image_extension, read_header, read_image};

/// The images in a folder, sorted by name, without labels. Folders in it are not looked into.
#[derive(Debug, Clone)]
pub struct ImageFolder {
    folder: PathBuf,
    files: Vec<PathBuf>,
    camera: FolderCamera,
}

/// Which camera took the images of a folder.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FolderCamera {
    /// One that sees this angle from left to right, degrees, whatever the size of the image.
    HorizontalFov(f64),
    /// This one; all images have its size.
    Fixed(Camera),
}

/// A folder of images that cannot be used.
#[derive(Debug, Error)]
pub enum ImageFolderError {
    /// The folder cannot be listed.
    #[error("{}: cannot be listed: {source}", path.display())]
    List {
        /// The folder.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// There is no image.
    #[error("{}: no images; expected files such as 000000.png", path.display())]
    NoImages {
        /// The folder.
        path: PathBuf,
    },
    /// Two images would have the same name.
    #[error(
        "{}: there is another image of this name; expected names that differ in more than the extension",
        path.display()
    )]
    SameName {
        /// The second of them.
        path: PathBuf,
    },
    /// The angle of view is none.
    #[error("{}: {source}", path.display())]
    Camera {
        /// The image.
        path: PathBuf,
        /// What is wrong with it.
        source: CameraError,
    },
}

impl From<ImageFolderError> for DatasetError {
    fn from(error: ImageFolderError) -> Self {
        Self::other(error)
    }
}

impl ImageFolder {
    /// The images in `folder`, all taken by `camera`. A frame has its file's name without the extension.
    ///
    /// # Errors
    /// When the folder cannot be listed, has no images, or has two whose names differ in nothing but the extension.
    pub fn open(folder: &Path, camera: FolderCamera) -> Result<Self, ImageFolderError> {
        let failed = |source| ImageFolderError::List { path: folder.to_owned(), source };
        let mut files = Vec::new();
        for entry in fs::read_dir(folder).map_err(failed)? {
            let path = entry.map_err(failed)?.path();
            files.extend((has_image_extension(&path) && path.is_file()).then_some(path));
        }
        files.sort();
        if files.is_empty() {
            return Err(ImageFolderError::NoImages { path: folder.to_owned() });
        }
        match files.windows(2).find(|pair| pair[0].file_stem() == pair[1].file_stem()) {
            Some(pair) => Err(ImageFolderError::SameName { path: pair[1].clone() }),
            None => Ok(Self { folder: folder.to_owned(), files, camera }),
        }
    }
}

impl Dataset for ImageFolder {
    fn name(&self) -> String {
        self.folder.display().to_string()
    }

    fn len(&self) -> usize {
        self.files.len()
    }

    fn id(&self, index: usize) -> String {
        self.files[index].file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default()
    }

    fn origin(&self, index: usize) -> String {
        self.files[index].display().to_string()
    }

    fn image(&self, index: usize) -> Result<RgbImage, DatasetError> {
        Ok(read_image(&self.files[index])?)
    }

    fn camera(&self, index: usize) -> Result<Camera, DatasetError> {
        let hfov_deg = match self.camera {
            FolderCamera::Fixed(camera) => return Ok(camera),
            FolderCamera::HorizontalFov(degrees) => degrees,
        };
        let path = &self.files[index];
        let [width, height] = read_header(path, ImageLimits::default())?.size.map(|side| side as usize);
        let camera = Camera::from_hfov(hfov_deg, width, height);
        Ok(camera.map_err(|source| ImageFolderError::Camera { path: path.clone(), source })?)
    }

    fn is_labelled(&self) -> bool {
        false
    }

    fn labels(&self, _index: usize) -> Result<Vec<Label>, DatasetError> {
        Ok(Vec::new())
    }

    fn folders(&self) -> Vec<PathBuf> {
        vec![self.folder.clone()]
    }
}

//! Where the camera of an image comes from.

use std::path::{Path, PathBuf};

use farsight_core::Camera;
use farsight_core::camera::CameraError;
use farsight_core::lens::LensError;
use farsight_core::road::RoadPlane;
use farsight_data::kitti::{Calibration, CalibrationError};
use farsight_data::{Exif, FocalFromExif, FocalProblem, ImageError, ImageLimits, focal, read_header};
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::file_kind::{signature, start_of};

/// Horizontal field of view of KITTI's camera, degrees, for images whose camera does not matter.
pub const KITTI_HFOV_DEG: f64 = 81.4;

/// Images that are looked at before it is said that none has a camera.
const PROBED_IMAGES: usize = 200;

/// A camera that is not known.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CameraSourceError {
    /// Nothing says what the camera is.
    #[error("no camera: distances need its focal length")]
    Unknown,
    /// An image in KITTI's layout without its calibration.
    #[error("{}: no camera; expected its calibration {}", image.display(), calibration.display())]
    NoCalibration {
        /// The image.
        image: PathBuf,
        /// Where its calibration would be.
        calibration: PathBuf,
    },
    /// An image beside others that lie in KITTI's layout.
    #[error("{}: no camera, and no calibration beside it", .0.display())]
    OutsideLayout(PathBuf),
    /// The EXIF data of an image do not tell.
    #[error("{}: no camera: {problem}", image.display())]
    Exif {
        /// The image.
        image: PathBuf,
        /// What is wrong with its EXIF data.
        problem: FocalProblem,
    },
    /// A file that is plainly no calibration.
    #[error("{}: {found}; expected a calibration in KITTI's format, text with a row P2", path.display())]
    Kind {
        /// The file.
        path: PathBuf,
        /// What it is.
        found: &'static str,
    },
    /// A calibration that cannot be read.
    #[error(transparent)]
    Calibration(#[from] CalibrationError),
    /// Numbers that no camera has.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The network that estimates cameras failed.
    #[error("{}: its camera could not be estimated: {source}", image.display())]
    Estimate {
        /// The image.
        image: PathBuf,
        /// What happened.
        source: Box<crate::Error>,
    },
    /// Nothing says what the camera is, and the image was not looked at.
    #[error("{}: its camera is to be estimated from the image, which was not looked at", .0.display())]
    Unseen(PathBuf),
    /// A lens that the camera of an image cannot have.
    #[error("{}: {source}", image.display())]
    Lens {
        /// The image.
        image: PathBuf,
        /// What is wrong with the lens.
        source: LensError,
    },
}

/// What a camera is known from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum CameraOrigin {
    /// A calibration file.
    Calibration,
    /// Focal length and principal point that somebody gave.
    Intrinsics,
    /// A field of view that somebody gave.
    FieldOfView,
    /// The image's EXIF data.
    Exif,
    /// The image itself: a network's estimate.
    Estimated,
}

/// Knows the camera of every image.
#[derive(Debug, Clone, PartialEq)]
pub enum CameraSource {
    /// The same projection for all.
    Same(Camera),
    /// The same for all, over a road that is known (`farsight calibrate`).
    OverRoad(Camera, RoadPlane),
    /// A calibration file for each image, in this folder.
    Folder(PathBuf),
    /// A calibration file for each image, in the folder `calib` beside the image's folder.
    Kitti,
    /// Focal lengths and principal point; what is missing comes from the size of the image.
    Intrinsics {
        /// Horizontal focal length, pixels.
        fx: f64,
        /// Vertical focal length, pixels.
        fy: f64,
        /// Column of the principal point, pixels; the middle of the image by default.
        cx: Option<f64>,
        /// Row of the principal point, pixels; the middle of the image by default.
        cy: Option<f64>,
    },
    /// Horizontal field of view, degrees.
    FieldOfView(f64),
    /// What each image's EXIF data say.
    Exif,
    /// What each image's EXIF data say, and where they do not, what a network takes the image for: see
    /// [`crate::ViewSource`], which shows it the image.
    Estimated,
}

impl CameraSource {
    /// A calibration in KITTI's format, or a folder with one for each image, by its name.
    ///
    /// # Errors
    /// When the file is no calibration.
    pub fn from_calibration(path: &Path) -> Result<Self, CameraSourceError> {
        Ok(if path.is_dir() { Self::Folder(path.to_owned()) } else { Self::of_calibration(&read(path)?) })
    }

    /// What a calibration that was read says.
    pub fn of_calibration(calibration: &Calibration) -> Self {
        let camera = calibration.camera();
        calibration.road.map_or(Self::Same(camera), |road| Self::OverRoad(camera, road))
    }

    /// What the images themselves say: KITTI's layout when at least one of `images` lies in it, else EXIF data.
    ///
    /// # Errors
    /// When it is plain that they say nothing.
    pub fn of_images(images: &[PathBuf]) -> Result<Self, CameraSourceError> {
        if let Some(cameras) = Self::of_layout(images) {
            return Ok(cameras);
        }
        if let Some((image, calibration)) = images.iter().find_map(|image| Some((image, in_layout(image)?))) {
            return Err(CameraSourceError::NoCalibration { image: image.clone(), calibration });
        }
        Self::of_exif(images)
    }

    /// EXIF data, unless it is plain from the first images that there are none.
    fn of_exif(images: &[PathBuf]) -> Result<Self, CameraSourceError> {
        let mut told = None;
        for image in images.iter().take(PROBED_IMAGES) {
            match read_header(image, ImageLimits { max_pixels: u64::MAX }) {
                Ok(header) => match focal(&header.exif, header.size) {
                    Ok(_) => return Ok(Self::Exif),
                    Err(FocalProblem::Missing) => {}
                    Err(problem) => {
                        told.get_or_insert_with(|| unknown(image, problem));
                    }
                },
                // What it is matters more than its camera, and is told when it is its turn.
                Err(ImageError::UnsupportedFormat { .. } | ImageError::NoFile { .. }) => return Ok(Self::Exif),
                Err(_) => {}
            }
        }
        match told {
            _ if images.len() > PROBED_IMAGES => Ok(Self::Exif),
            Some(problem) => Err(problem),
            None => Err(CameraSourceError::Unknown),
        }
    }

    /// KITTI's layout, when at least one of `images` lies in it.
    pub fn of_layout(images: &[PathBuf]) -> Option<Self> {
        images.iter().any(|image| kitti_calibration(image).is_some()).then_some(Self::Kitti)
    }

    /// What the EXIF data say about the camera of an image, where nothing else does.
    pub fn from_exif(&self, path: &Path, size: [usize; 2], exif: &Exif) -> Option<Result<FocalFromExif, FocalProblem>> {
        let asked = match self {
            Self::Exif | Self::Estimated => true,
            Self::Kitti => in_layout(path).is_none(),
            _ => false,
        };
        // Sides of images are 32-bit numbers.
        asked.then(|| focal(exif, size.map(|side| side as u32)))
    }

    /// The camera of the image at `path`, which has `size` (width and height, pixels) and `exif` data.
    ///
    /// # Errors
    /// When it is not known.
    pub fn camera(&self, path: &Path, size: [usize; 2], exif: &Exif) -> Result<Camera, CameraSourceError> {
        self.known(path, size, exif).map(|(camera, _)| camera)
    }

    /// [`CameraSource::camera`], and the road under it where a calibration tells.
    pub(crate) fn known(
        &self,
        path: &Path,
        size: [usize; 2],
        exif: &Exif,
    ) -> Result<(Camera, Option<RoadPlane>), CameraSourceError> {
        let [width, height] = size;
        match self.from_exif(path, size, exif) {
            Some(Ok(found)) => return Ok((Camera::from_hfov(found.hfov_deg, width, height)?, None)),
            Some(Err(FocalProblem::Missing)) | None => {}
            Some(Err(_)) if matches!(self, Self::Estimated) => {}
            Some(Err(problem)) => return Err(unknown(path, problem)),
        }
        match self {
            Self::Same(camera) => Ok((*camera, None)),
            Self::OverRoad(camera, road) => Ok((*camera, Some(*road))),
            Self::Folder(folder) => {
                read(&folder.join(format!("{}.txt", file_stem(path)))).map(|calibration| with_road(&calibration))
            }
            Self::Kitti => {
                let calibration = in_layout(path).ok_or_else(|| CameraSourceError::OutsideLayout(path.to_owned()))?;
                if !calibration.is_file() {
                    return Err(CameraSourceError::NoCalibration { image: path.to_owned(), calibration });
                }
                read(&calibration).map(|calibration| with_road(&calibration))
            }
            Self::Intrinsics { fx, fy, cx, cy } => {
                let middle = |side: usize| (side as f64 - 1.0) / 2.0;
                let (cx, cy) = (cx.unwrap_or_else(|| middle(width)), cy.unwrap_or_else(|| middle(height)));
                Ok((Camera::from_intrinsics(*fx, *fy, cx, cy)?, None))
            }
            Self::FieldOfView(degrees) => Ok((Camera::from_hfov(*degrees, width, height)?, None)),
            Self::Exif => Err(unknown(path, FocalProblem::Missing)),
            Self::Estimated => Err(CameraSourceError::Unseen(path.to_owned())),
        }
    }

    /// What the camera of the image at `path` is known from, if it is known; of one that is estimated if nothing else
    /// is known, the latter.
    pub fn origin(&self, path: &Path) -> CameraOrigin {
        match self {
            Self::Kitti if in_layout(path).is_none() => CameraOrigin::Exif,
            Self::Same(_) | Self::OverRoad(..) | Self::Folder(_) | Self::Kitti => CameraOrigin::Calibration,
            Self::Intrinsics { .. } => CameraOrigin::Intrinsics,
            Self::FieldOfView(_) => CameraOrigin::FieldOfView,
            Self::Exif => CameraOrigin::Exif,
            Self::Estimated => CameraOrigin::Estimated,
        }
    }
}

fn unknown(image: &Path, problem: FocalProblem) -> CameraSourceError {
    CameraSourceError::Exif { image: image.to_owned(), problem }
}

fn read(path: &Path) -> Result<Calibration, CameraSourceError> {
    if let Some(found) = start_of(path).ok().and_then(|start| signature(&start)) {
        return Err(CameraSourceError::Kind { path: path.to_owned(), found });
    }
    Ok(Calibration::read(path)?)
}

fn with_road(calibration: &Calibration) -> (Camera, Option<RoadPlane>) {
    (calibration.camera(), calibration.road)
}

/// The file's name without folder and extension, by which calibrations and outputs go.
pub fn file_stem(path: &Path) -> String {
    path.file_stem().map_or_else(|| "image".to_owned(), |stem| stem.to_string_lossy().into_owned())
}

/// The calibration of an image in KITTI's layout, when it is there.
fn kitti_calibration(image: &Path) -> Option<PathBuf> {
    in_layout(image).filter(|file| file.is_file())
}

/// `calib/ID.txt` beside the folder `image_2` of `image`, when both folders are there.
fn in_layout(image: &Path) -> Option<PathBuf> {
    // A relative path such as `000001.png` has its folder's name only after this.
    let image = image.canonicalize().ok()?;
    let folder = image.parent().filter(|folder| folder.ends_with("image_2"))?;
    let calibrations = Some(folder.with_file_name("calib")).filter(|folder| folder.is_dir())?;
    Some(calibrations.join(format!("{}.txt", file_stem(&image))))
}

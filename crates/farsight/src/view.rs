//! How an image was taken: its camera, the lens before it, the road under it.

use std::borrow::Cow;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use farsight_core::road::{Road, RoadPlane};
use farsight_core::{Box2d, Camera, Lens};
use farsight_data::{Dataset, DatasetError, Exif, Undistorter};
use farsight_methods::DetectError;
use farsight_methods::camera_estimator::CameraEstimate;
use image::RgbImage;

use crate::camera_estimates::CameraEstimates;
use crate::camera_source::{CameraOrigin, CameraSource, CameraSourceError};
use farsight_core::lens::LensError;

/// What is known of how an image was taken.
#[derive(Debug, Clone)]
pub struct View {
    camera: Camera,
    road: Option<RoadPlane>,
    /// Of the camera above its road, metres.
    height_m: Option<f64>,
    undistorter: Option<Arc<Undistorter>>,
    estimate: Option<CameraEstimate>,
}

impl From<Camera> for View {
    /// A pinhole, and nothing known of its road.
    fn from(camera: Camera) -> Self {
        Self { camera, road: None, height_m: None, undistorter: None, estimate: None }
    }
}

impl View {
    /// How frame `index` of `dataset` was taken.
    ///
    /// # Errors
    /// When its camera cannot be read.
    pub fn of_frame(dataset: &dyn Dataset, index: usize) -> Result<Self, DatasetError> {
        Ok(Self { road: dataset.road(index)?, ..Self::from(dataset.camera(index)?) })
    }

    /// The camera; behind a lens the pinhole that would see the same without it.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// The road under a camera that was calibrated.
    pub fn road(&self) -> Option<RoadPlane> {
        self.road
    }

    /// As it is, by a camera so high above the road, metres; where its calibration tells the road, that counts.
    #[must_use]
    pub fn above_road(self, height_m: f64) -> Self {
        Self { height_m: Some(height_m), ..self }
    }

    /// What is known of the road: by calibration, or by the height of the camera.
    pub(crate) fn known_road(&self) -> Option<Road> {
        self.road.map(Road::Known).or(self.height_m.map(Road::BelowBy))
    }

    /// What the image says of its camera, where nothing else is known of it.
    pub fn estimate(&self) -> Option<CameraEstimate> {
        self.estimate
    }

    /// What its camera is known from, which is one of `cameras` and took the image at `path`.
    pub(crate) fn origin(&self, cameras: &CameraSource, path: &Path) -> CameraOrigin {
        match cameras.origin(path) {
            // Only what says nothing itself is estimated.
            CameraOrigin::Estimated if self.estimate.is_none() => CameraOrigin::Exif,
            origin => origin,
        }
    }

    /// Standard deviation of the logarithm of the focal length: of one that is estimated. All distances are wrong by as
    /// much as it is.
    pub fn focal_log_sigma(&self) -> f64 {
        self.estimate.map_or(0.0, |estimate| estimate.focal_log_sigma)
    }

    /// What distorts the image.
    pub fn lens(&self) -> Option<Lens> {
        self.undistorter.as_ref().map(|undistorter| undistorter.lens())
    }

    /// `image` as the pinhole would have taken it, of the same size.
    ///
    /// # Errors
    /// When it has another size than the one that the view was made for.
    pub fn straightened<'a>(&self, image: &'a RgbImage) -> Result<Cow<'a, RgbImage>, DetectError> {
        let Some(undistorter) = &self.undistorter else { return Ok(Cow::Borrowed(image)) };
        undistorter.undistorted(image).map(Cow::Owned).ok_or_else(|| DetectError::ImageSize {
            found: [image.width(), image.height()],
            expected: undistorter.size(),
        })
    }

    /// Where the image shows what the pinhole sees in `found`, pixels.
    pub fn shown(&self, found: &Box2d) -> Box2d {
        self.undistorter.as_ref().map_or(*found, |undistorter| undistorter.distorted_box(found))
    }
}

/// Knows how each image was taken: its camera by a [`CameraSource`], and one lens for all.
#[derive(Debug, Clone)]
pub struct ViewSource {
    cameras: CameraSource,
    lens: Option<Lens>,
    /// Of the latest camera with a lens: the images of one camera share it.
    latest: Arc<Mutex<Option<Arc<Undistorter>>>>,
    estimates: CameraEstimates,
}

impl From<CameraSource> for ViewSource {
    fn from(cameras: CameraSource) -> Self {
        Self { cameras, lens: None, latest: Arc::default(), estimates: CameraEstimates::default() }
    }
}

impl ViewSource {
    /// As it is, with a lens that distorts all images; `None` for pinholes.
    #[must_use]
    pub fn with_lens(self, lens: Option<Lens>) -> Self {
        Self { lens, ..self }
    }

    /// As it is, with another network to estimate cameras ([`CameraSource::Estimated`]).
    #[must_use]
    pub fn with_estimates(self, estimates: CameraEstimates) -> Self {
        Self { estimates, ..self }
    }

    /// Where the cameras come from.
    pub fn cameras(&self) -> &CameraSource {
        &self.cameras
    }

    /// What distorts all images.
    pub fn lens(&self) -> Option<Lens> {
        self.lens
    }

    /// How `image` was taken, which is at `path` and has these `exif` data.
    ///
    /// # Errors
    /// When its camera is not known, or the lens folds its image.
    pub fn view(&self, path: &Path, image: &RgbImage, exif: &Exif) -> Result<View, CameraSourceError> {
        let size = [image.width() as usize, image.height() as usize];
        let (camera, road, estimate) = match self.cameras.known(path, size, exif) {
            Ok((camera, road)) => (camera, road, None),
            Err(CameraSourceError::Unseen(_)) => {
                let failed = |source| CameraSourceError::Estimate { image: path.to_owned(), source: Box::new(source) };
                let estimate = self.estimates.estimate(image).map_err(failed)?;
                (estimate.camera(size)?, None, Some(estimate))
            }
            Err(error) => return Err(error),
        };
        let undistorter = self.lens.map(|lens| self.undistorter(&camera, lens, size.map(|side| side as u32)));
        let folds = |source| CameraSourceError::Lens { image: path.to_owned(), source };
        let undistorter = undistorter.transpose().map_err(folds)?;
        Ok(View { camera, road, height_m: None, undistorter, estimate })
    }

    fn undistorter(&self, camera: &Camera, lens: Lens, size: [u32; 2]) -> Result<Arc<Undistorter>, LensError> {
        let mut latest = self.latest.lock().unwrap_or_else(PoisonError::into_inner);
        let fits = |known: &&Arc<Undistorter>| (*known.camera(), known.lens(), known.size()) == (*camera, lens, size);
        if let Some(known) = latest.as_ref().filter(fits) {
            return Ok(Arc::clone(known));
        }
        let made = Arc::new(Undistorter::new(camera, lens, size)?);
        *latest = Some(Arc::clone(&made));
        Ok(made)
    }
}

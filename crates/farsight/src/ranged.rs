//! From an image file to its answer: what all front ends do with one image.

use std::path::Path;

use farsight_data::{ImageError, LoadedImage};
use farsight_methods::{DetectError, UnfamiliarCamera};
use farsight_runtime::StageTimes;
use thiserror::Error;

use crate::camera_source::CameraSourceError;
use crate::json::ImageRecord;
use crate::object::DetectedObject;
use crate::pipeline::Pipeline;
use crate::view::{View, ViewSource};

/// An image that gets no answer.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RangeError {
    /// It cannot be read.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// Its camera is not known.
    #[error(transparent)]
    Camera(#[from] CameraSourceError),
    /// The model failed.
    #[error(transparent)]
    Detect(#[from] DetectError),
}

/// What is known of an image that was looked at.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct RangedImage {
    /// How it was taken.
    pub view: View,
    /// What is in it, highest score first; boxes where the image shows them.
    pub objects: Vec<DetectedObject>,
    /// What `farsight range --json` writes of it.
    pub record: ImageRecord,
    /// A camera that the model does not know.
    pub unfamiliar: Option<UnfamiliarCamera>,
    /// The time of each stage.
    pub times: StageTimes,
}

impl Pipeline {
    /// What is in the image called `name`, of which `views` knows how it was taken.
    ///
    /// # Errors
    /// When its camera is not known, or the model fails.
    pub fn range_image(&self, name: &Path, image: &LoadedImage, views: &ViewSource) -> Result<RangedImage, RangeError> {
        let LoadedImage { pixels, exif, .. } = image;
        let size = [pixels.width() as usize, pixels.height() as usize];
        let view = views.view(name, size, exif)?;
        let (objects, times) = self.detect_view(pixels, &view)?;
        let record = ImageRecord::new(name, pixels, view.camera(), &objects, self);
        let record = record.with_camera_origin(views.cameras().origin(name)).with_lens(view.lens());
        let unfamiliar = self.unfamiliar(size, view.camera());
        Ok(RangedImage { view, objects, record, unfamiliar, times })
    }
}

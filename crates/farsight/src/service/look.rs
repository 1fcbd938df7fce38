//! What is done with an image.

use std::path::Path;

use farsight_data::{ImageError, ImageLimits, decode_image};
use thiserror::Error;

use super::MAX_PIXELS;
use crate::json::ImageRecord;
use crate::{CameraSource, CameraSourceError, DetectError, Pipeline};

/// An image that gets no answer.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LookError {
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

/// Looks at images, on several threads at once.
pub trait Look: Send + Sync + 'static {
    /// What is in the image file `bytes`, called `name`, whose camera `cameras` knows.
    ///
    /// # Errors
    /// When it is no image, its camera is not known, or the model fails.
    fn look(&self, bytes: &[u8], name: &Path, cameras: &CameraSource) -> Result<ImageRecord, LookError>;
}

impl Look for Pipeline {
    fn look(&self, bytes: &[u8], name: &Path, cameras: &CameraSource) -> Result<ImageRecord, LookError> {
        let max_pixels = MAX_PIXELS.min(ImageLimits::default().max_pixels);
        let image = decode_image(bytes, name, ImageLimits { max_pixels })?;
        let size = [image.pixels.width() as usize, image.pixels.height() as usize];
        let camera = cameras.camera(name, size, &image.exif)?;
        let objects = self.detect(&image.pixels, &camera)?;
        let record = ImageRecord::new(name, &image.pixels, &camera, &objects, self);
        let mut record = record.with_camera_origin(cameras.origin(name));
        if let Some(model) = &mut record.model {
            model.name = model_name(self);
        }
        Ok(record)
    }
}

/// The model's name, or of a file its name without the folder: clients need not know where things lie.
fn model_name(pipeline: &Pipeline) -> String {
    let name = Path::new(&pipeline.info().name);
    name.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned())
}

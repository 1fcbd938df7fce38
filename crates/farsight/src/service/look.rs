//! What is done with an image.

use std::path::Path;

use farsight_data::{ImageError, ImageLimits, decode_image};
use farsight_runtime::StageTimes;
use farsight_runtime::timing::timed;
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

/// An answer, and what it took.
#[derive(Debug, Clone, PartialEq)]
pub struct Looked {
    /// The answer.
    pub record: ImageRecord,
    /// The time of each stage.
    pub times: StageTimes,
}

/// What clients are told of a model.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ModelCard {
    /// Its name, which stands in addresses.
    pub name: String,
    /// Version of the program.
    pub version: String,
    /// What runs it.
    pub platform: String,
}

/// Looks at images, on several threads at once.
pub trait Look: Send + Sync + 'static {
    /// What is in the image file `bytes`, called `name`, whose camera `cameras` knows.
    ///
    /// # Errors
    /// When it is no image, its camera is not known, or the model fails.
    fn look(&self, bytes: &[u8], name: &Path, cameras: &CameraSource) -> Result<Looked, LookError>;

    /// What looks.
    fn card(&self) -> ModelCard;
}

impl Look for Pipeline {
    fn look(&self, bytes: &[u8], name: &Path, cameras: &CameraSource) -> Result<Looked, LookError> {
        let max_pixels = MAX_PIXELS.min(ImageLimits::default().max_pixels);
        let (image, load) = timed(|| decode_image(bytes, name, ImageLimits { max_pixels }));
        let image = image?;
        let size = [image.pixels.width() as usize, image.pixels.height() as usize];
        let camera = cameras.camera(name, size, &image.exif)?;
        let (mut answers, times) = self.detect_batch(&[(&image.pixels, &camera)])?;
        let record = ImageRecord::new(name, &image.pixels, &camera, &answers.pop().unwrap_or_default(), self);
        let mut record = record.with_camera_origin(cameras.origin(name));
        if let Some(model) = &mut record.model {
            model.name = model_name(self);
        }
        Ok(Looked { record, times: StageTimes { load, ..times } })
    }

    fn card(&self) -> ModelCard {
        ModelCard {
            name: model_name(self),
            version: crate::VERSION.to_owned(),
            platform: format!("farsight_{}", self.engine()),
        }
    }
}

/// The model's name, or of a file its name without the folder: clients need not know where things lie.
fn model_name(pipeline: &Pipeline) -> String {
    let name = Path::new(&pipeline.info().name);
    name.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned())
}

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
use crate::together::answer_good;
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
        let view = seen_by(name, image, views)?;
        let seen = self.detect_view(&image.pixels, &view)?;
        Ok(self.ranged((name, image, views), view, seen))
    }

    /// [`Pipeline::range_image`] for several images, which are seen together where that is possible
    /// ([`Pipeline::detect_views`]): an answer for each, in their order.
    pub fn range_images(&self, images: &[(&Path, &LoadedImage, &ViewSource)]) -> Vec<Result<RangedImage, RangeError>> {
        let viewed = images.iter().map(|asked @ (name, image, views)| Ok((*asked, seen_by(name, image, views)?)));
        answer_good(viewed.collect(), |viewed| {
            let asked: Vec<_> = viewed.iter().map(|((_, image, _), view)| (&image.pixels, view)).collect();
            let seen = self.detect_views(&asked);
            viewed.into_iter().zip(seen).map(|((asked, view), seen)| Ok(self.ranged(asked, view, seen?))).collect()
        })
    }

    fn ranged(
        &self,
        (name, image, views): (&Path, &LoadedImage, &ViewSource),
        view: View,
        (objects, times): (Vec<DetectedObject>, StageTimes),
    ) -> RangedImage {
        let pixels = &image.pixels;
        let record = ImageRecord::new(name, pixels, view.camera(), &objects, self);
        let record = record.with_camera_origin(view.origin(views.cameras(), name)).with_lens(view.lens());
        let record = record.with_camera_estimate(view.estimate());
        let unfamiliar = self.unfamiliar(size_of(image), view.camera());
        RangedImage { view, objects, record, unfamiliar, times }
    }
}

fn size_of(image: &LoadedImage) -> [usize; 2] {
    [image.pixels.width() as usize, image.pixels.height() as usize]
}

/// How an image was taken.
fn seen_by(name: &Path, image: &LoadedImage, views: &ViewSource) -> Result<View, CameraSourceError> {
    views.view(name, &image.pixels, &image.exif)
}

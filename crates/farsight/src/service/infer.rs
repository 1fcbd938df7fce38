//! What is done with an image.

use std::path::Path;

use farsight_data::{ImageLimits, decode_image};
use farsight_runtime::StageTimes;
use farsight_runtime::timing::timed;

use super::MAX_PIXELS;
use crate::json::ImageRecord;
use crate::{Pipeline, RangeError, RangedImage, ViewSource};

/// An answer, and what it took.
#[derive(Debug, Clone, PartialEq)]
pub struct Inference {
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
pub trait Infer: Send + Sync + 'static {
    /// What is in the image file `bytes`, called `name`, of which `views` knows how it was taken.
    ///
    /// # Errors
    /// When it is no image, its camera is not known, or the model fails.
    fn infer(&self, bytes: &[u8], name: &Path, views: &ViewSource) -> Result<Inference, RangeError>;

    /// What looks.
    fn card(&self) -> ModelCard;
}

impl Infer for Pipeline {
    fn infer(&self, bytes: &[u8], name: &Path, views: &ViewSource) -> Result<Inference, RangeError> {
        let max_pixels = MAX_PIXELS.min(ImageLimits::default().max_pixels);
        let (image, load) = timed(|| decode_image(bytes, name, ImageLimits { max_pixels }));
        let RangedImage { mut record, times, .. } = self.range_image(name, &image?, views)?;
        if let Some(model) = &mut record.model {
            model.name = model_name(self);
        }
        Ok(Inference { record, times: StageTimes { load, ..times } })
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

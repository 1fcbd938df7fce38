//! What is done with an image.

use std::path::Path;
use std::time::Duration;

use farsight_data::{ImageLimits, LoadedImage, decode_image};
use farsight_runtime::StageTimes;
use farsight_runtime::timing::timed;

use super::MAX_PIXELS;
use crate::json::ImageRecord;
use crate::together::answer_good;
use crate::{Pipeline, RangeError, RangedImage, ViewSource};

/// An answer, and what it took.
#[derive(Debug, Clone, PartialEq)]
pub struct Inference {
    /// The answer.
    pub record: ImageRecord,
    /// The time of each stage; of images that were looked at together each has its share.
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

/// An image that is asked about.
#[derive(Debug, Clone, Copy)]
pub struct AskedImage<'a> {
    /// The image file.
    pub bytes: &'a [u8],
    /// Its name.
    pub name: &'a Path,
    /// What knows how it was taken.
    pub views: &'a ViewSource,
}

/// Looks at images, on several threads at once.
pub trait Infer: Send + Sync + 'static {
    /// What is in the image file `bytes`, called `name`, of which `views` knows how it was taken.
    ///
    /// # Errors
    /// When it is no image, its camera is not known, or the model fails.
    fn infer(&self, bytes: &[u8], name: &Path, views: &ViewSource) -> Result<Inference, RangeError>;

    /// [`Infer::infer`] for several images that came together: an answer for each, in their order. They are looked at
    /// one after the other where nothing is gained by looking at them together.
    fn infer_batch(&self, images: &[AskedImage<'_>]) -> Vec<Result<Inference, RangeError>> {
        images.iter().map(|AskedImage { bytes, name, views }| self.infer(bytes, name, views)).collect()
    }

    /// What looks.
    fn card(&self) -> ModelCard;
}

impl Infer for Pipeline {
    fn infer(&self, bytes: &[u8], name: &Path, views: &ViewSource) -> Result<Inference, RangeError> {
        let (image, load) = decoded(bytes, name)?;
        Ok(inference(self, self.range_image(name, &image, views)?, load))
    }

    fn infer_batch(&self, images: &[AskedImage<'_>]) -> Vec<Result<Inference, RangeError>> {
        let decoded = images.iter().map(|asked| Ok((asked, decoded(asked.bytes, asked.name)?))).collect();
        answer_good(decoded, |decoded| {
            let asked: Vec<_> = decoded.iter().map(|(asked, (image, _))| (asked.name, image, asked.views)).collect();
            let ranged = self.range_images(&asked).into_iter();
            ranged.zip(&decoded).map(|(ranged, (_, (_, load)))| Ok(inference(self, ranged?, *load))).collect()
        })
    }

    fn card(&self) -> ModelCard {
        ModelCard {
            name: model_name(self),
            version: crate::VERSION.to_owned(),
            platform: format!("farsight_{}", self.engine()),
        }
    }
}

/// The image in a file, and how long that took.
fn decoded(bytes: &[u8], name: &Path) -> Result<(LoadedImage, Duration), RangeError> {
    let max_pixels = MAX_PIXELS.min(ImageLimits::default().max_pixels);
    let (image, load) = timed(|| decode_image(bytes, name, ImageLimits { max_pixels }));
    Ok((image?, load))
}

fn inference(pipeline: &Pipeline, ranged: RangedImage, load: Duration) -> Inference {
    let RangedImage { mut record, times, .. } = ranged;
    if let Some(model) = &mut record.model {
        model.name = model_name(pipeline);
    }
    Inference { record, times: StageTimes { load, ..times } }
}

/// The model's name, or of a file its name without the folder: clients need not know where things lie.
fn model_name(pipeline: &Pipeline) -> String {
    let name = Path::new(&pipeline.info().name);
    name.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned())
}

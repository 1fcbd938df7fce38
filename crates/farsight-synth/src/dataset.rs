//! Rendered scenes as a data set.

use std::sync::Arc;

use farsight_core::{Camera, Label};
use farsight_data::annotations::{Annotation, Annotations, DepthMap, Plates};
use farsight_data::{Dataset, DatasetError, Frame};
use image::RgbImage;

use crate::generator::generate_scene;
use crate::stream::SceneStream;

/// Scenes of a stream: an endless data set, in which every frame of every epoch is a new one, rendered when it is asked
/// for.
///
/// Labels follow from what the image shows, so whatever is asked for but the camera renders the frame.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneDataset {
    stream: SceneStream,
    frames_per_epoch: usize,
}

impl SceneDataset {
    /// Scenes of `stream`, so many an epoch. Frame number `index` is the scene of that number.
    pub fn new(stream: SceneStream, frames_per_epoch: usize) -> Self {
        Self { stream, frames_per_epoch }
    }
}

impl Dataset for SceneDataset {
    fn name(&self) -> String {
        format!("rendered scenes of seed {}", self.stream.seed)
    }

    fn len(&self) -> usize {
        self.frames_per_epoch
    }

    fn is_endless(&self) -> bool {
        true
    }

    fn id(&self, index: usize) -> String {
        SceneStream::id(index as u64)
    }

    fn image(&self, index: usize) -> Result<RgbImage, DatasetError> {
        Ok(self.stream.frame(index as u64).image)
    }

    fn camera(&self, index: usize) -> Result<Camera, DatasetError> {
        Ok(generate_scene(&self.stream.config, self.stream.seed, index as u64).scene.camera)
    }

    fn labels(&self, index: usize) -> Result<Vec<Label>, DatasetError> {
        Ok(self.stream.frame(index as u64).labels)
    }

    fn annotation_names(&self) -> Vec<&'static str> {
        vec![DepthMap::NAME, Plates::NAME]
    }

    fn annotations(&self, index: usize) -> Result<Annotations, DatasetError> {
        Ok(self.stream.frame(index as u64).annotations)
    }

    fn frame(&self, index: usize) -> Result<Arc<Frame>, DatasetError> {
        Ok(Arc::new(self.stream.frame(index as u64)))
    }
}

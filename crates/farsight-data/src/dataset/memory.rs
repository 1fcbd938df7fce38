//! Frames in memory.

use std::sync::Arc;

use farsight_core::road::RoadPlane;
use farsight_core::{Camera, Label, Pose};
use image::RgbImage;

use super::{Dataset, DatasetError};
use crate::annotations::Annotations;
use crate::frame::Frame;

/// Frames that somebody has made or read already.
#[derive(Debug, Clone)]
pub struct MemoryDataset {
    name: String,
    frames: Vec<Arc<Frame>>,
    is_labelled: bool,
}

impl MemoryDataset {
    /// A data set of these frames, which messages call `name`.
    pub fn new(name: impl Into<String>, frames: impl IntoIterator<Item = Frame>) -> Self {
        Self { name: name.into(), frames: frames.into_iter().map(Arc::new).collect(), is_labelled: true }
    }

    /// The same frames, of which nobody has said what they show.
    pub fn unlabelled(self) -> Self {
        Self { is_labelled: false, ..self }
    }
}

impl Dataset for MemoryDataset {
    fn name(&self) -> String {
        self.name.clone()
    }

    fn len(&self) -> usize {
        self.frames.len()
    }

    fn id(&self, index: usize) -> String {
        self.frames[index].id.clone()
    }

    fn image(&self, index: usize) -> Result<RgbImage, DatasetError> {
        Ok(self.frames[index].image.clone())
    }

    fn camera(&self, index: usize) -> Result<Camera, DatasetError> {
        Ok(self.frames[index].camera)
    }

    fn road(&self, index: usize) -> Result<Option<RoadPlane>, DatasetError> {
        Ok(self.frames[index].road)
    }

    fn is_labelled(&self) -> bool {
        self.is_labelled
    }

    fn labels(&self, index: usize) -> Result<Vec<Label>, DatasetError> {
        Ok(self.frames[index].labels.clone())
    }

    fn timestamp_ns(&self, index: usize) -> Result<Option<i64>, DatasetError> {
        Ok(self.frames[index].timestamp_ns)
    }

    fn world_from_camera(&self, index: usize) -> Result<Option<Pose>, DatasetError> {
        Ok(self.frames[index].world_from_camera)
    }

    /// The kinds that every frame has.
    fn annotation_names(&self) -> Vec<&'static str> {
        let [first, rest @ ..] = &self.frames[..] else { return Vec::new() };
        let in_all = |name: &&str| rest.iter().all(|frame| frame.annotations.names().any(|other| other == *name));
        first.annotations.names().filter(in_all).collect()
    }

    fn annotations(&self, index: usize) -> Result<Annotations, DatasetError> {
        Ok(self.frames[index].annotations.clone())
    }

    fn frame(&self, index: usize) -> Result<Arc<Frame>, DatasetError> {
        Ok(Arc::clone(&self.frames[index]))
    }
}

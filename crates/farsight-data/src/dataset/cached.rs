//! A data set whose frames stay in memory.

use std::path::PathBuf;
use std::sync::{Arc, OnceLock};

use farsight_core::{Camera, Label, Pose};
use image::RgbImage;

use super::{Dataset, DatasetError};
use crate::annotations::Annotations;
use crate::frame::Frame;

/// Another data set, each of whose frames is read once. What is endless is not kept.
#[derive(Debug)]
pub struct CachedDataset {
    dataset: Arc<dyn Dataset>,
    frames: Vec<OnceLock<Arc<Frame>>>,
}

impl CachedDataset {
    /// Keeps the frames of `dataset` that are asked for, decoded: 1.4 MB a frame of KITTI.
    pub fn new(dataset: Arc<dyn Dataset>) -> Self {
        let count = if dataset.is_endless() { 0 } else { dataset.len() };
        Self { dataset, frames: (0..count).map(|_| OnceLock::new()).collect() }
    }

    fn kept(&self, index: usize) -> Option<&Arc<Frame>> {
        self.frames.get(index)?.get()
    }
}

impl Dataset for CachedDataset {
    fn name(&self) -> String {
        self.dataset.name()
    }

    fn len(&self) -> usize {
        self.dataset.len()
    }

    fn is_endless(&self) -> bool {
        self.dataset.is_endless()
    }

    fn id(&self, index: usize) -> String {
        self.dataset.id(index)
    }

    fn origin(&self, index: usize) -> String {
        self.dataset.origin(index)
    }

    fn image(&self, index: usize) -> Result<RgbImage, DatasetError> {
        Ok(self.frame(index)?.image.clone())
    }

    fn camera(&self, index: usize) -> Result<Camera, DatasetError> {
        self.kept(index).map_or_else(|| self.dataset.camera(index), |frame| Ok(frame.camera))
    }

    fn is_labelled(&self) -> bool {
        self.dataset.is_labelled()
    }

    fn labels(&self, index: usize) -> Result<Vec<Label>, DatasetError> {
        self.kept(index).map_or_else(|| self.dataset.labels(index), |frame| Ok(frame.labels.clone()))
    }

    fn timestamp_ns(&self, index: usize) -> Result<Option<i64>, DatasetError> {
        self.kept(index).map_or_else(|| self.dataset.timestamp_ns(index), |frame| Ok(frame.timestamp_ns))
    }

    fn world_from_camera(&self, index: usize) -> Result<Option<Pose>, DatasetError> {
        self.kept(index).map_or_else(|| self.dataset.world_from_camera(index), |frame| Ok(frame.world_from_camera))
    }

    fn annotation_names(&self) -> Vec<&'static str> {
        self.dataset.annotation_names()
    }

    fn annotations(&self, index: usize) -> Result<Annotations, DatasetError> {
        self.kept(index).map_or_else(|| self.dataset.annotations(index), |frame| Ok(frame.annotations.clone()))
    }

    fn frame(&self, index: usize) -> Result<Arc<Frame>, DatasetError> {
        let Some(place) = self.frames.get(index) else { return self.dataset.frame(index) };
        match place.get() {
            Some(frame) => Ok(Arc::clone(frame)),
            // Two threads may read the same frame at once; one of the two is kept.
            None => self.dataset.frame(index).map(|frame| Arc::clone(place.get_or_init(|| frame))),
        }
    }

    fn folders(&self) -> Vec<PathBuf> {
        self.dataset.folders()
    }

    fn label_folder(&self) -> Option<PathBuf> {
        self.dataset.label_folder()
    }
}

//! A data set whose frames stay in memory.

use std::sync::{Arc, OnceLock};

use super::{Dataset, DatasetError, DatasetLayer};
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
}

impl DatasetLayer for CachedDataset {
    fn below(&self) -> &Arc<dyn Dataset> {
        &self.dataset
    }

    fn kept(&self, index: usize) -> Option<&Arc<Frame>> {
        self.frames.get(index)?.get()
    }

    fn layered(&self, index: usize) -> Result<Arc<Frame>, DatasetError> {
        let Some(place) = self.frames.get(index) else { return self.dataset.frame(index) };
        match place.get() {
            Some(frame) => Ok(Arc::clone(frame)),
            // Two threads may read the same frame at once; one of the two is kept.
            None => self.dataset.frame(index).map(|frame| Arc::clone(place.get_or_init(|| frame))),
        }
    }
}

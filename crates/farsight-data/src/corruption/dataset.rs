//! A data set whose images are made worse.

use std::sync::Arc;

use image::RgbImage;

use super::Corruption;
use crate::dataset::{Dataset, DatasetError, DatasetLayer};
use crate::frame::Frame;

/// Another data set with the same corruption of each image; cameras and labels stay.
#[derive(Debug)]
pub struct CorruptedDataset {
    dataset: Arc<dyn Dataset>,
    corruption: Corruption,
    severity: u8,
}

impl CorruptedDataset {
    /// The images of `dataset` at one of [`SEVERITIES`](super::SEVERITIES). What is random follows from a frame's
    /// number.
    pub fn new(dataset: Arc<dyn Dataset>, corruption: Corruption, severity: u8) -> Self {
        Self { dataset, corruption, severity }
    }

    fn corrupted(&self, image: &RgbImage, index: usize) -> RgbImage {
        self.corruption.applied(image, self.severity, index as u64)
    }
}

impl DatasetLayer for CorruptedDataset {
    fn below(&self) -> &Arc<dyn Dataset> {
        &self.dataset
    }

    fn layered_name(&self) -> String {
        format!("{}, {} {}", self.dataset.name(), self.corruption, self.severity)
    }

    fn layered_image(&self, index: usize) -> Result<RgbImage, DatasetError> {
        Ok(self.corrupted(&self.dataset.image(index)?, index))
    }

    fn layered(&self, index: usize) -> Result<Arc<Frame>, DatasetError> {
        let frame = self.dataset.frame(index)?;
        Ok(Arc::new(Frame { image: self.corrupted(&frame.image, index), ..Frame::clone(&frame) }))
    }
}

//! A data set whose images are made worse.

use std::sync::Arc;

use farsight_core::{Camera, Label};
use image::RgbImage;

use super::Corruption;
use crate::dataset::{Dataset, DatasetError};

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
}

impl Dataset for CorruptedDataset {
    fn name(&self) -> String {
        format!("{}, {} {}", self.dataset.name(), self.corruption, self.severity)
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
        Ok(self.corruption.applied(&self.dataset.image(index)?, self.severity, index as u64))
    }

    fn camera(&self, index: usize) -> Result<Camera, DatasetError> {
        self.dataset.camera(index)
    }

    fn is_labelled(&self) -> bool {
        self.dataset.is_labelled()
    }

    fn labels(&self, index: usize) -> Result<Vec<Label>, DatasetError> {
        self.dataset.labels(index)
    }
}

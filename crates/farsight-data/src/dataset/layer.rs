//! Data sets over another one.

use std::fmt::Debug;
use std::path::PathBuf;
use std::sync::Arc;

use farsight_core::road::RoadPlane;
use farsight_core::{Camera, Label, Pose};
use image::RgbImage;

use super::{Dataset, DatasetError};
use crate::annotations::Annotations;
use crate::frame::Frame;

/// A data set that gives the frames of another one, changed or kept. What a layer does not say is as below.
pub trait DatasetLayer: Debug + Send + Sync {
    /// The other one.
    fn below(&self) -> &Arc<dyn Dataset>;

    /// What messages call it.
    fn layered_name(&self) -> String {
        self.below().name()
    }

    /// All of a frame.
    ///
    /// # Errors
    /// When something of it cannot be read.
    fn layered(&self, index: usize) -> Result<Arc<Frame>, DatasetError>;

    /// The pixels of a frame.
    ///
    /// # Errors
    /// When they cannot be read.
    fn layered_image(&self, index: usize) -> Result<RgbImage, DatasetError> {
        Ok(self.layered(index)?.image.clone())
    }

    /// A frame that need not be read again.
    fn kept(&self, index: usize) -> Option<&Arc<Frame>> {
        let _ = index;
        None
    }
}

impl<L: DatasetLayer> Dataset for L {
    fn name(&self) -> String {
        self.layered_name()
    }

    fn len(&self) -> usize {
        self.below().len()
    }

    fn is_endless(&self) -> bool {
        self.below().is_endless()
    }

    fn id(&self, index: usize) -> String {
        self.below().id(index)
    }

    fn origin(&self, index: usize) -> String {
        self.below().origin(index)
    }

    fn image(&self, index: usize) -> Result<RgbImage, DatasetError> {
        self.layered_image(index)
    }

    fn camera(&self, index: usize) -> Result<Camera, DatasetError> {
        self.kept(index).map_or_else(|| self.below().camera(index), |frame| Ok(frame.camera))
    }

    fn road(&self, index: usize) -> Result<Option<RoadPlane>, DatasetError> {
        self.kept(index).map_or_else(|| self.below().road(index), |frame| Ok(frame.road))
    }

    fn is_labelled(&self) -> bool {
        self.below().is_labelled()
    }

    fn labels(&self, index: usize) -> Result<Vec<Label>, DatasetError> {
        self.kept(index).map_or_else(|| self.below().labels(index), |frame| Ok(frame.labels.clone()))
    }

    fn timestamp_ns(&self, index: usize) -> Result<Option<i64>, DatasetError> {
        self.kept(index).map_or_else(|| self.below().timestamp_ns(index), |frame| Ok(frame.timestamp_ns))
    }

    fn world_from_camera(&self, index: usize) -> Result<Option<Pose>, DatasetError> {
        self.kept(index).map_or_else(|| self.below().world_from_camera(index), |frame| Ok(frame.world_from_camera))
    }

    fn annotation_names(&self) -> Vec<&'static str> {
        self.below().annotation_names()
    }

    fn annotations(&self, index: usize) -> Result<Annotations, DatasetError> {
        self.kept(index).map_or_else(|| self.below().annotations(index), |frame| Ok(frame.annotations.clone()))
    }

    fn frame(&self, index: usize) -> Result<Arc<Frame>, DatasetError> {
        self.layered(index)
    }

    fn folders(&self) -> Vec<PathBuf> {
        self.below().folders()
    }

    fn label_folder(&self) -> Option<PathBuf> {
        self.below().label_folder()
    }
}

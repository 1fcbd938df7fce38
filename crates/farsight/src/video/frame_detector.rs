//! What is in single frames: pipeline and cameras, without tracks.

use std::sync::{Arc, OnceLock};

use image::RgbImage;

use super::error::VideoError;
use super::source::VideoFrame;
use crate::camera_source::CameraSource;
use crate::object::DetectedObject;
use crate::pipeline::Pipeline;
use crate::view::{View, ViewSource};

/// Finds what is in the frames of one video, each by itself. A clone is the same one, and several threads may use it:
/// [`Pipeline::side_by_side`] says how many do best.
#[derive(Clone)]
pub struct FrameDetector {
    shared: Arc<Shared>,
    /// Of the camera above its road, metres.
    height_m: Option<f64>,
}

struct Shared {
    pipeline: Pipeline,
    views: ViewSource,
    /// The camera that was estimated from the first frame, and the size of that, pixels.
    estimated: OnceLock<([usize; 2], View)>,
}

impl FrameDetector {
    pub(super) fn new(pipeline: Pipeline, views: ViewSource) -> Self {
        Self { shared: Arc::new(Shared { pipeline, views, estimated: OnceLock::new() }), height_m: None }
    }

    pub(super) fn above_road(self, height_m: f64) -> Self {
        Self { height_m: Some(height_m), ..self }
    }

    /// The pipeline that looks at the frames.
    pub fn pipeline(&self) -> &Pipeline {
        &self.shared.pipeline
    }

    pub(super) fn cameras(&self) -> &CameraSource {
        self.shared.views.cameras()
    }

    /// How a frame was taken. A camera that is estimated is that of the first frame that is asked for: one film has
    /// one.
    ///
    /// # Errors
    /// When its camera is not known, or the lens folds it.
    pub fn view(&self, frame: &VideoFrame) -> Result<View, VideoError> {
        let view = self.view_as_known(frame)?;
        Ok(match self.height_m {
            Some(height_m) => view.above_road(height_m),
            None => view,
        })
    }

    fn view_as_known(&self, frame: &VideoFrame) -> Result<View, VideoError> {
        let estimated = &self.shared.estimated;
        if let Some((_, view)) = estimated.get().filter(|(known, _)| *known == size(&frame.image)) {
            return Ok(view.clone());
        }
        let view = self.shared.views.view(&frame.path, &frame.image, &frame.exif)?;
        if view.estimate().is_some() {
            estimated.get_or_init(|| (size(&frame.image), view.clone()));
        }
        Ok(view)
    }

    /// What is in a frame that was taken so; boxes are those that the pinhole of `view` sees ([`View::straightened`]).
    ///
    /// # Errors
    /// When the pipeline fails.
    pub fn detect(&self, frame: &VideoFrame, view: &View) -> Result<Vec<DetectedObject>, VideoError> {
        let found = self.shared.pipeline.detect_straightened(&frame.image, view);
        let (objects, _) =
            found.map_err(|source| VideoError::Detect { place: frame.place(), source: Box::new(source) })?;
        Ok(objects)
    }
}

/// Width and height, pixels.
pub(super) fn size(image: &RgbImage) -> [usize; 2] {
    [image.width(), image.height()].map(|side| side as usize)
}

//! One labelled image.

use farsight_core::road::RoadPlane;
use farsight_core::{Camera, Label, Pose};
use image::RgbImage;

use crate::annotations::{Annotation, Annotations};

/// An image with the camera that took it, the objects in it, and what else is known of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Name of the frame, KITTI's six digits for instance.
    pub id: String,
    /// Pixels, red, green, blue.
    pub image: RgbImage,
    /// The camera of `image`.
    pub camera: Camera,
    /// The road under a camera that was calibrated.
    pub road: Option<RoadPlane>,
    /// What is in it, in the order of the label file.
    pub labels: Vec<Label>,
    /// When it was taken, nanoseconds from a zero that the frames of one sequence share.
    pub timestamp_ns: Option<i64>,
    /// Where the camera was, in a world that the frames of one sequence share.
    pub world_from_camera: Option<Pose>,
    /// What else a data set knows.
    pub annotations: Annotations,
}

impl Frame {
    /// A frame of which nothing else is known.
    pub fn new(id: impl Into<String>, image: RgbImage, camera: Camera, labels: Vec<Label>) -> Self {
        let (road, timestamp_ns, world_from_camera, annotations) = (None, None, None, Annotations::default());
        Self { id: id.into(), image, camera, road, labels, timestamp_ns, world_from_camera, annotations }
    }

    /// The same frame with one more annotation.
    pub fn with<A: Annotation>(mut self, annotation: A) -> Self {
        self.annotations.insert(annotation);
        self
    }

    /// The annotation of this kind, if there is one.
    pub fn annotation<A: Annotation>(&self) -> Option<&A> {
        self.annotations.get()
    }

    /// Width and height of the image, pixels.
    pub fn image_size(&self) -> [usize; 2] {
        [self.image.width() as usize, self.image.height() as usize]
    }
}

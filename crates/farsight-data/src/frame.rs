//! One labelled image.

use farsight_core::{Camera, Label};
use image::RgbImage;

use crate::Plate;

/// An image with the camera that took it and the objects in it.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Name of the frame, KITTI's six digits for instance.
    pub id: String,
    /// Pixels, red, green, blue.
    pub image: RgbImage,
    /// The camera of `image`.
    pub camera: Camera,
    /// What is in it, in the order of the label file.
    pub labels: Vec<Label>,
    /// z of what each pixel shows, metres, row by row, infinite for the sky; known for rendered frames.
    pub depth_m: Option<Vec<f32>>,
    /// Number plates that the image shows; known for rendered frames.
    pub plates: Vec<Plate>,
}

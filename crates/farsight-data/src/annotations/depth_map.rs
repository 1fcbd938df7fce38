//! The depth of every pixel.

use super::Annotation;

/// z of what each pixel of an image shows, camera coordinates. Rendered frames have it.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthMap {
    /// `[height, width]` of the image, row by row, metres; infinite for the sky.
    pub depth_m: Vec<f32>,
}

impl Annotation for DepthMap {
    const NAME: &'static str = "depth_map";
}

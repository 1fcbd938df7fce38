//! What a scene is rendered to.

use crate::scene::{Color, InstanceId};

/// A rendered scene. Images are row by row from the top left, `width * height` values.
#[derive(Debug, Clone, PartialEq)]
pub struct Rendered {
    /// Width and height, pixels.
    pub size: [usize; 2],
    /// Colour, linear light, not limited to 1.
    pub color: Vec<Color>,
    /// z of what most of the pixel shows, metres; infinite for the sky. At the pixel's centre, or amid the samples
    /// that see it.
    pub depth_m: Vec<f32>,
    /// Instance that most of the pixel shows; 0 for the background and the sky.
    pub instance: Vec<InstanceId>,
    /// Samples (four a pixel) in which each instance is seen, by instance.
    pub visible: Vec<u32>,
    /// Samples inside the image that each instance would fill if nothing hid it, by instance; 0 for the background.
    pub amodal: Vec<u32>,
}

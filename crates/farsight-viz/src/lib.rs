//! Detections drawn on the image and seen from above.
//!
//! [`picture`] is the one to show: the annotated image with the bird's-eye view beside or below it. [`annotate`] and [`birds_eye`]
//! are its two halves. All of them take a [`Scene`] and answer an RGB image; sizes of lines and text follow the size of the image.
//! No fonts or libraries of the system are needed. What does not fit in the picture is cut off; nothing here fails or panics on odd input.
//!
//! The front of a vehicle is its crossed, tinted face in the image and its arrow head from above. In the bird's-eye view the camera looks up
//! the page, the rings are distances over the ground.

mod annotate;
mod birds_eye;
mod canvas;
mod legend;
mod palette;
mod picture;
mod placing;
mod text;
mod wireframe;

use farsight_core::{Box3d, Camera, Detection, Label};

pub use annotate::{annotate, annotate_named};
pub use birds_eye::birds_eye;
pub use palette::distance_text;
pub use picture::{picture, picture_divisor};

/// What there is to draw.
#[derive(Debug, Clone, Copy)]
pub struct Scene<'a> {
    /// The camera of the image.
    pub camera: &'a Camera,
    /// What was found.
    pub detections: &'a [Detection],
    /// What is known to be there, drawn in thin dashed white; often empty.
    pub truth: &'a [Label],
}

/// What to call the parts of a [`Scene`].
#[derive(Debug, Clone, Copy)]
pub struct Names<'a> {
    /// Names of the detections, in their order.
    pub detections: &'a [String],
    /// Names of the ground truth, in its order.
    pub truth: &'a [String],
}

/// What the colour of a box tells.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ColorBy {
    /// How far away it is: warm is near, cool is far.
    #[default]
    Distance,
    /// What it is.
    Class,
}

/// How to draw a [`Scene`].
#[derive(Debug, Clone, Copy)]
pub struct DrawOptions {
    /// What colours tell.
    pub color_by: ColorBy,
    /// The distance that labels give, metres.
    pub distance_m: fn(&Box3d) -> f64,
}

impl Default for DrawOptions {
    /// Coloured and labelled by depth along the optical axis.
    fn default() -> Self {
        Self { color_by: ColorBy::Distance, distance_m: Box3d::depth_m }
    }
}

/// Length of the longer side, pixels, at which lines and text have their nominal size: KITTI's width.
const NOMINAL_SIDE_PX: f64 = 1242.0;

/// Least factor on lines and text; below it nobody can read them.
const MIN_SCALE: f64 = 0.75;

/// Factor on lines and text for an image of this width and height, pixels.
fn drawing_scale(image_size: [u32; 2]) -> f64 {
    let [width, height] = image_size.map(f64::from);
    (width.max(height) / NOMINAL_SIDE_PX).max(MIN_SCALE)
}

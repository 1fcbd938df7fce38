//! What to draw, and how.

use farsight_core::{Box3d, Camera, Detection, Label, Lens};

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
    /// What bends the image; boxes are drawn bent alike.
    pub lens: Option<Lens>,
    /// How far down the camera looks, radians: boxes stand upright on the road, not across the camera's axis.
    pub pitch_rad: f64,
}

impl Default for DrawOptions {
    /// Coloured and labelled by depth along the optical axis.
    fn default() -> Self {
        Self { color_by: ColorBy::Distance, distance_m: Box3d::depth_m, lens: None, pitch_rad: 0.0 }
    }
}

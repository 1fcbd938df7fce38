//! One row of ground truth.

use crate::{Box2d, Box3d, ObjectClass};

/// One labelled object of a frame, as KITTI writes it.
///
/// `DontCare` rows carry -1, -10 and -1000 where they have no value; they are kept as they are.
#[derive(Debug, Clone, PartialEq)]
pub struct Label {
    /// What it is.
    pub class: ObjectClass,
    /// Share of the object outside the image, 0 to 1.
    pub truncation: f64,
    /// 0 visible, 1 partly occluded, 2 largely occluded, 3 unknown, -1 `DontCare`.
    pub occlusion: i32,
    /// Observation angle, radians in `[-pi, pi]`.
    pub alpha: f64,
    /// Annotated box, pixels of the original image.
    pub box2d: Box2d,
    /// Annotated box in rectified camera coordinates, metres.
    pub box3d: Box3d,
}

//! One row of ground truth.

use crate::overlap::{covered_share_2d, iou_2d};
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

impl Label {
    /// How much of `box2d`, pixels of the original image, lies on this: of a region that was not labelled the share
    /// that it covers, as in the devkit, of an object intersection over union.
    pub fn overlap_2d(&self, box2d: &Box2d) -> f64 {
        if self.class.eq_ignore_case(&ObjectClass::DontCare) {
            covered_share_2d(box2d, &self.box2d)
        } else {
            iou_2d(box2d, &self.box2d)
        }
    }
}

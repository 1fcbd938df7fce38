//! KITTI labels from the scene and from what the image shows of it.
//!
//! The 3D box is the object's own, the 2D box is the one around its projection, truncation is the share of the 2D box
//! outside the image, and occlusion follows from counted samples.
//!
//! KITTI's 2D boxes are projections too, corrected by hand: on 18 cars in full view their mean overlap with the
//! projected 3D box is 0.97, with the box around the outline of a car built into the same 3D box 0.90, because
//! outlines are round where boxes have corners.

use farsight_core::{Box2d, Box3d, Dimensions, Label, ObjectClass};

use crate::render::Rendered;
use crate::scene::{InstanceId, LabelledObject, Scene};

/// When an object is labelled, and how its occlusion is graded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LabelRules {
    /// Boxes lower than this in the image are `DontCare`, pixels. KITTI's lowest labelled vehicles have 15.
    pub min_height_px: f64,
    /// Boxes lower than this are left out altogether, pixels. KITTI's lowest `DontCare` boxes have 4.6.
    pub min_dont_care_px: f64,
    /// Objects farther than this are `DontCare`, metres of depth.
    pub farthest_m: f64,
    /// Visible shares from which on an object is not occluded (0), partly (1) and largely (2); `DontCare` below the
    /// last.
    pub visible_shares: [f64; 3],
}

/// Width of KITTI's images, pixels.
const KITTI_WIDTH_PX: f64 = 1242.0;

impl Default for LabelRules {
    fn default() -> Self {
        Self { min_height_px: 15.0, min_dont_care_px: 4.0, farthest_m: 100.0, visible_shares: [0.8, 0.4, 0.1] }
    }
}

impl LabelRules {
    /// The default rules, made for KITTI's images, for images `width` pixels wide.
    pub fn for_width(width: usize) -> Self {
        let scale = width as f64 / KITTI_WIDTH_PX;
        let kitti = Self::default();
        Self { min_height_px: kitti.min_height_px * scale, min_dont_care_px: kitti.min_dont_care_px * scale, ..kitti }
    }

    /// The labels of the objects that the image shows, in their order. Objects of whom nothing is seen have none.
    pub fn labels(&self, scene: &Scene, objects: &[LabelledObject], rendered: &Rendered) -> Vec<Label> {
        let [width, height] = scene.image_size.map(|s| s as f64);
        let labels = objects.iter().filter_map(|object| {
            let visible = share_visible(rendered, object.instance)?;
            let whole = object.box3d.projected(&scene.camera)?;
            let box2d = whole.clamped(width - 1.0, height - 1.0);
            let truncation = if whole.area() > 0.0 { 1.0 - box2d.area() / whole.area() } else { 0.0 };
            self.label(object, box2d, truncation, visible)
        });
        labels.collect()
    }

    pub(crate) fn label(&self, object: &LabelledObject, box2d: Box2d, truncation: f64, visible: f64) -> Option<Label> {
        if box2d.height() < self.min_dont_care_px {
            return None;
        }
        let hidden = self.visible_shares.iter().position(|&least| visible >= least);
        let clear = box2d.height() >= self.min_height_px && object.box3d.depth_m() <= self.farthest_m;
        let Some(occlusion) = hidden.filter(|_| clear) else { return Some(dont_care(box2d)) };
        Some(Label {
            class: object.class.clone(),
            truncation,
            occlusion: occlusion as i32,
            alpha: object.box3d.alpha(),
            box2d,
            box3d: object.box3d,
        })
    }
}

/// Share of an object's part of the image that nothing hides; none when nothing of it is seen.
fn share_visible(rendered: &Rendered, instance: InstanceId) -> Option<f64> {
    let count = |counts: &[u32]| counts.get(usize::from(instance)).copied().filter(|&samples| samples > 0);
    Some(f64::from(count(&rendered.visible)?) / f64::from(count(&rendered.amodal)?))
}

/// A region without a label, with KITTI's marks for "no value".
fn dont_care(box2d: Box2d) -> Label {
    Label {
        class: ObjectClass::DontCare,
        truncation: -1.0,
        occlusion: -1,
        alpha: -10.0,
        box2d,
        box3d: Box3d {
            dimensions: Dimensions { height: -1.0, width: -1.0, length: -1.0 },
            location: [-1000.0; 3],
            yaw: -10.0,
        },
    }
}

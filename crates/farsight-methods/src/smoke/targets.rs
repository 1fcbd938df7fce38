//! What the network is asked to answer for one image.

use serde::{Deserialize, Serialize};

use super::codec::STRIDE;
use farsight_core::heatmap::HeatmapRule;
use farsight_core::{Affine2, Box2d, Box3d, Camera, Label};

use super::Codec;

/// The box whose size sets the width of an object's Gaussian.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HeatmapBox {
    /// Around the projected corners, clipped to the map (as official SMOKE).
    #[default]
    Projected,
    /// The annotated 2D box.
    Annotated,
}

/// How targets are made.
#[derive(Debug, Clone, PartialEq)]
pub struct TargetRules {
    /// Classes and reference constants.
    pub codec: Codec,
    /// Width of the Gaussians.
    pub heatmap: HeatmapRule,
    /// The box that the rule looks at.
    pub heatmap_box: HeatmapBox,
}

/// One object that the regression head learns from.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectTarget {
    /// Channel of the heatmap.
    pub class: usize,
    /// Column and row of its cell.
    pub cell: [usize; 2],
    /// Where it is, metres.
    pub box3d: Box3d,
}

/// Targets of one image.
#[derive(Debug, Clone, PartialEq)]
pub struct Targets {
    /// Heatmaps, `[classes, height, width]`, 1 at every centre.
    pub heatmap: Vec<f32>,
    /// Width and height of the feature map, cells.
    pub map_size: [usize; 2],
    /// Objects whose centre lies in the image.
    pub objects: Vec<ObjectTarget>,
    /// The camera of the feature map.
    pub camera: Camera,
}

/// The camera of the feature map that belongs to the camera of the network's input.
pub fn feature_camera(input_camera: &Camera) -> Camera {
    input_camera.transformed(&Affine2::scaling(1.0 / STRIDE as f64))
}

impl TargetRules {
    /// Targets for `labels` in a network input of `input_size` (width, height, pixels) seen by `input_camera`.
    ///
    /// Objects of other classes and those whose projected centre lies outside the image are left out, as in official
    /// SMOKE (spec section 6).
    pub fn targets(&self, labels: &[Label], input_camera: &Camera, input_size: [usize; 2]) -> Targets {
        let camera = feature_camera(input_camera);
        let map_size @ [width, height] = input_size.map(|s| s / STRIDE);
        let area = width * height;
        let mut heatmap = vec![0.0; self.codec.classes.len() * area];
        let mut objects = Vec::new();
        for label in labels {
            let Some(target) = self.object_target(label, &camera, map_size) else { continue };
            let extent = self.heatmap_extent(label, &camera, map_size);
            let factor = self.codec.classes[target.class].heatmap_factor;
            let channel = &mut heatmap[target.class * area..][..area];
            self.heatmap.gaussian(extent.width(), extent.height(), factor).draw(channel, width, target.cell);
            objects.push(target);
        }
        Targets { heatmap, map_size, objects, camera }
    }

    fn object_target(&self, label: &Label, camera: &Camera, map_size: [usize; 2]) -> Option<ObjectTarget> {
        let class = self.codec.classes.iter().position(|c| c.class == label.class)?;
        let center = camera.pixel_from_point(label.box3d.center())?;
        let inside = (0..2).all(|i| center[i] > 0.0 && center[i] < map_size[i] as f64);
        inside.then(|| ObjectTarget { class, cell: center.map(|v| v as usize), box3d: label.box3d })
    }

    fn heatmap_extent(&self, label: &Label, camera: &Camera, map_size: [usize; 2]) -> Box2d {
        let extent = match self.heatmap_box {
            HeatmapBox::Projected => label.box3d.projected(camera),
            HeatmapBox::Annotated => Some(label.box2d.transformed(&Affine2::scaling(1.0 / STRIDE as f64))),
        };
        let [max_x, max_y] = map_size.map(|s| s as f64 - 1.0);
        extent.unwrap_or(Box2d::new(0.0, 0.0, 0.0, 0.0)).clamped(max_x, max_y)
    }
}

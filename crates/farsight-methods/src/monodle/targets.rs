//! What the network is asked to answer for one image.

use farsight_core::heatmap::HeatmapRule;
use farsight_core::{Affine2, Camera, ClassReference, Label};

use super::codec::{Codec, Encoded};
use crate::center_map::{STRIDE, feature_camera};

/// Targets of one image.
#[derive(Debug, Clone, PartialEq)]
pub struct Targets {
    /// Heatmaps, `[classes, height, width]`, 1 at every centre.
    pub heatmap: Vec<f32>,
    /// Width and height of the maps, cells.
    pub map_size: [usize; 2],
    /// What stands at the cells of the objects.
    pub objects: Vec<Encoded>,
}

/// Targets for `labels` in a network input of `input_size` (width, height, pixels) seen by `input_camera`.
///
/// The keypoint is the projected centre of the 3D box; the Gaussian is as wide as the annotated 2D box, cut to the
/// image, asks for. Objects of other classes, those whose centre lies outside and those without a 2D box are left out.
pub fn targets<'a>(
    labels: impl IntoIterator<Item = &'a Label>,
    classes: &[ClassReference],
    rule: &HeatmapRule,
    codec: &Codec,
    input_camera: &Camera,
    input_size: [usize; 2],
) -> Targets {
    let camera = feature_camera(input_camera);
    let map_size @ [width, height] = input_size.map(|side| side / STRIDE);
    let area = width * height;
    let mut heatmap = vec![0.0; classes.len() * area];
    let mut objects = Vec::new();
    for label in labels {
        let Some(class) = classes.iter().position(|known| known.class == label.class) else { continue };
        let whole = label.box2d.transformed(&Affine2::scaling(1.0 / STRIDE as f64));
        let seen = whole.clamped(width as f64 - 1.0, height as f64 - 1.0);
        if !(seen.width() > 0.0 && seen.height() > 0.0) {
            continue;
        }
        let Some(encoded) = codec.encode(&label.box3d, &seen, &camera, map_size) else { continue };
        let channel = &mut heatmap[class * area..][..area];
        rule.gaussian(seen.width(), seen.height(), classes[class].heatmap_factor).draw(channel, width, encoded.cell);
        objects.push(encoded);
    }
    Targets { heatmap, map_size, objects }
}

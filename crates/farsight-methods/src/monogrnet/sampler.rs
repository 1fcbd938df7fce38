//! What stands between the three graphs: maps are cropped to boxes of the image and resized.

use farsight_core::samplers::{FeatureMap, roi_align};
use farsight_core::{Affine2, Box2d};

use super::layout::{CELL_STRIDE, MAP_STRIDE, SIDE};

/// Samples of a box.
pub const SAMPLES: usize = SIDE * SIDE;

/// A box on the grid as one on the maps that are read there.
pub fn on_map(box2d: &Box2d) -> Box2d {
    box2d.transformed(&Affine2::scaling((CELL_STRIDE / MAP_STRIDE) as f64))
}

/// What `map` shows in several boxes on the grid: `[boxes, channels, side, side]`, one sample each.
pub fn sample(map: FeatureMap<'_>, boxes: &[Box2d]) -> Vec<f32> {
    let boxes: Vec<Box2d> = boxes.iter().map(on_map).collect();
    roi_align(map, &boxes, [SIDE, SIDE], 1)
}

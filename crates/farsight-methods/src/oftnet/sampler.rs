//! The orthographic feature transform: means of the image's maps over what each voxel is seen as. What it makes is the
//! input of the second graph.

use farsight_core::samplers::{FeatureMap, IntegralImage};
use farsight_core::{Affine2, Box2d, Camera};

use super::grid::Grid;

/// Strides of the maps that are read.
pub const STRIDES: [usize; 3] = [8, 16, 32];

/// Where each map is read, in its own pixels: the boxes of all voxels ([`Grid::voxel_boxes`]), for each of [`STRIDES`].
pub fn boxes(grid: &Grid, input_camera: &Camera) -> [Vec<Box2d>; STRIDES.len()] {
    STRIDES.map(|stride| grid.voxel_boxes(&input_camera.transformed(&Affine2::scaling(1.0 / stride as f64))))
}

/// Means of each map over its boxes: `[maps slabs channels, rows, columns]`, written behind what `features` has. Where
/// a voxel is not seen there are zeros.
pub fn sample(features: &mut Vec<f32>, maps: [FeatureMap<'_>; STRIDES.len()], boxes: &[Vec<Box2d>], slabs: usize) {
    for (map, boxes) in maps.into_iter().zip(boxes) {
        let means = IntegralImage::new(map).means(boxes);
        let cells = boxes.len() / slabs.max(1);
        for slab in 0..slabs {
            for channel in means.chunks_exact(boxes.len().max(1)) {
                features.extend_from_slice(&channel[slab * cells..(slab + 1) * cells]);
            }
        }
    }
}

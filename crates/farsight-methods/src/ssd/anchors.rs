//! Anchors: boxes of fixed sizes around every cell, of which the network says how far the true ones are off.
//!
//! They are those of an image of 300 x 300 pixels, in pixels: in a larger one there are more of them, and none is
//! larger.

use farsight_core::Box2d;
use farsight_graph::layers::inverted_residuals::Convention;

/// Maps with anchors.
pub const LEVELS: usize = 6;

/// Pixels of the input a cell of each map.
pub const STRIDES: [usize; LEVELS] = [16, 32, 64, 128, 256, 512];

/// The side of the image that the network learnt from, pixels.
pub const SIDE_PX: f64 = 300.0;

/// Cells of each map along a side of that image.
const CELLS_300: [usize; LEVELS] = [19, 10, 5, 3, 2, 1];

/// Sides of the anchors of each level, and of what would be the next level's, as shares of the image.
const SCALES: [f64; LEVELS + 1] = [0.2, 0.35, 0.5, 0.65, 0.8, 0.95, 1.0];

/// Width over height.
const RATIOS: [f64; 5] = [1.0, 2.0, 0.5, 3.0, 0.3333];

/// What the network's numbers for the centre and for the size are divided by.
const CENTER_SCALE: f64 = 10.0;
const SIZE_SCALE: f64 = 5.0;

/// Cells of each level along a side of so many pixels, a multiple of 32.
pub fn cells(side: usize) -> [usize; LEVELS] {
    let mut cells = [side / STRIDES[0], side / STRIDES[1], 0, 0, 0, 0];
    for level in 2..LEVELS {
        let window = Convention::Tensorflow300.window(3, STRIDES[level - 1], 2);
        cells[level] = window.output_size(cells[level - 1]).unwrap_or(0);
    }
    cells
}

/// Height and width of a level's anchors, pixels, in the order of the channels.
pub fn shapes(level: usize) -> Vec<[f64; 2]> {
    let shape = |ratio: f64, scale: f64| [SIDE_PX * scale / ratio.sqrt(), SIDE_PX * scale * ratio.sqrt()];
    let scale = SCALES[level];
    if level == 0 {
        return vec![shape(1.0, 0.1), shape(2.0, scale), shape(0.5, scale)];
    }
    let between = (scale * SCALES[level + 1]).sqrt();
    RATIOS.into_iter().map(|ratio| shape(ratio, scale)).chain([shape(1.0, between)]).collect()
}

/// Where the first cell of a level has its anchors, pixels from the edge of the input.
///
/// The network learnt with a cell's anchors at `(i + 1/2) 300 / cells`, a little less than a stride apart. Its features
/// are a stride apart, and what a cell says does not depend on which one it is. So anchors stand a stride apart, and
/// where they were in the mean over the cells of that image: their middle is its middle. At half a stride they would be
/// 2 pixels off at the first level and 106 at the last, because every other convolution has its odd zero at the end.
fn first_anchor(level: usize) -> f64 {
    (SIDE_PX - (CELLS_300[level] - 1) as f64 * STRIDES[level] as f64) / 2.0
}

/// The box that `encoded` (y, x, height, width) stands for at `cell` (column, row) of a level with an anchor of `shape`
/// (height, width). Pixels of the input, whose edges, not middles, are whole numbers.
pub fn decoded(level: usize, cell: [usize; 2], shape: [f64; 2], encoded: [f64; 4]) -> Box2d {
    let stride = STRIDES[level] as f64;
    let [x, y] = cell.map(|place| first_anchor(level) + place as f64 * stride);
    let [anchor_height, anchor_width] = shape;
    let center = [x + encoded[1] / CENTER_SCALE * anchor_width, y + encoded[0] / CENTER_SCALE * anchor_height];
    let [height, width] = [(encoded[2], anchor_height), (encoded[3], anchor_width)]
        .map(|(encoded, anchor)| (encoded / SIZE_SCALE).exp() * anchor);
    Box2d::new(center[0] - width / 2.0, center[1] - height / 2.0, center[0] + width / 2.0, center[1] + height / 2.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_of_300_pixels_has_1917_anchors() {
        let of_level = |(level, cells): (usize, usize)| cells.pow(2) * shapes(level).len();
        let anchors: usize = CELLS_300.into_iter().enumerate().map(of_level).sum();
        assert_eq!(anchors, 1917);
    }

    #[test]
    fn anchors_lie_in_the_mean_where_the_network_learnt_them() {
        for (level, cells) in CELLS_300.into_iter().enumerate() {
            assert_eq!(cells, 300_usize.div_ceil(STRIDES[level]), "level {level}");
            let middle = |cell: usize| decoded(level, [cell, 0], [0.0; 2], [0.0; 4]).x1;
            let mean = (0..cells).map(middle).sum::<f64>() / cells as f64;
            assert!((mean - SIDE_PX / 2.0).abs() < 1e-9, "level {level}: {mean}");
            // As docs/onnx.md has them.
            assert!((middle(0) - [6.0, 6.0, 22.0, 22.0, 22.0, 150.0][level]).abs() < 1e-9, "level {level}");
        }
    }

    #[test]
    fn zeros_stand_for_the_anchor_itself() {
        let found = decoded(0, [2, 3], [60.0, 120.0], [0.0; 4]);
        assert_eq!(found, Box2d::new(38.0 - 60.0, 54.0 - 30.0, 38.0 + 60.0, 54.0 + 30.0));
        // Ten for the centre is a whole anchor.
        let moved = decoded(0, [2, 3], [60.0, 120.0], [10.0, -10.0, 5.0 * 2.0_f64.ln(), 0.0]);
        assert!((moved.height() - 120.0).abs() < 1e-9 && (moved.width() - 120.0).abs() < 1e-9);
        assert!((moved.x1 - (38.0 - 120.0 - 60.0)).abs() < 1e-9 && (moved.y1 - (54.0 + 60.0 - 60.0)).abs() < 1e-9);
    }
}

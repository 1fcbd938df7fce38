//! Lamps, and in which parts of the image their light may be.

use super::view::{NEAR_M, View};
use crate::scene::{Lamp, Scene};

/// Side of a tile, pixels.
const TILE: usize = 32;

/// The lamps whose light may fall on what a tile of the image shows.
pub(crate) struct Lamps<'a> {
    columns: usize,
    tiles: Vec<Vec<&'a Lamp>>,
}

impl<'a> Lamps<'a> {
    /// Sorts the lamps of a scene into tiles.
    pub(crate) fn of(scene: &'a Scene, view: &View) -> Self {
        let [columns, rows] = scene.image_size.map(|s| s.div_ceil(TILE));
        let mut tiles = vec![Vec::new(); columns * rows];
        for lamp in &scene.lamps {
            let [x0, y0, x1, y1] = lit_pixels(lamp, view, scene.image_size);
            for row in y0 / TILE..y1.div_ceil(TILE) {
                for column in x0 / TILE..x1.div_ceil(TILE) {
                    tiles[row * columns + column].push(lamp);
                }
            }
        }
        Self { columns, tiles }
    }

    /// The lamps to consider at a pixel.
    #[inline]
    pub(crate) fn at(&self, x: usize, y: usize) -> &[&'a Lamp] {
        &self.tiles[y / TILE * self.columns + x / TILE]
    }
}

/// Columns and rows around the projection of all that a lamp reaches: first column and row, end column and row.
fn lit_pixels(lamp: &Lamp, view: &View, [width, height]: [usize; 2]) -> [usize; 4] {
    let everywhere = [0, 0, width, height];
    let mut bounds = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    let mut behind = 0;
    for corner in 0..8 {
        let sign = |axis: usize| if corner >> axis & 1 == 0 { -1.0 } else { 1.0 };
        let reach = [0, 1, 2].map(|axis| lamp.position[axis] + sign(axis) * lamp.reach_m);
        let [u, v, w] = view.homogeneous(reach);
        behind += usize::from(w < NEAR_M);
        let [u, v] = [u / w, v / w];
        bounds = [bounds[0].min(u), bounds[1].min(v), bounds[2].max(u), bounds[3].max(v)];
    }
    match behind {
        0 => {
            let limited = |value: f64, most: usize| value.clamp(0.0, most as f64) as usize;
            let [left, top, right, bottom] = bounds;
            [limited(left, width), limited(top, height), limited(right + 2.0, width), limited(bottom + 2.0, height)]
        }
        8 => [0; 4],
        _ => everywhere,
    }
}

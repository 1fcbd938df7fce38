//! Lamps, and where in the image their light may be.

use super::view::{NEAR_M, View};
use crate::scene::{Lamp, Scene};

/// Height of the bands that lamps are sorted into, pixels.
const BAND: usize = 16;

/// A lamp and the columns, first and end, in which its light may be.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LitColumns<'a> {
    /// The lamp.
    pub(crate) lamp: &'a Lamp,
    columns: [u32; 2],
}

impl LitColumns<'_> {
    /// Whether its light may be between two columns.
    #[inline]
    pub(crate) fn may_light(&self, [first, last]: [u32; 2]) -> bool {
        self.columns[0] <= last && first < self.columns[1]
    }
}

/// The lamps whose light may fall on what a band of rows shows.
pub(crate) struct Lamps<'a> {
    bands: Vec<Vec<LitColumns<'a>>>,
}

impl<'a> Lamps<'a> {
    /// Sorts the lamps of a scene into bands.
    pub(crate) fn of(scene: &'a Scene, view: &View) -> Self {
        let mut bands = vec![Vec::new(); scene.image_size[1].div_ceil(BAND)];
        for lamp in &scene.lamps {
            let [x0, y0, x1, y1] = lit_pixels(lamp, view, scene.image_size);
            for band in &mut bands[y0 / BAND..y1.div_ceil(BAND)] {
                band.push(LitColumns { lamp, columns: [x0 as u32, x1 as u32] });
            }
        }
        Self { bands }
    }

    /// The lamps to consider in a row of pixels.
    #[inline]
    pub(crate) fn in_row(&self, row: usize) -> &[LitColumns<'a>] {
        &self.bands[row / BAND]
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

//! The grid on the ground, and the voxels above it.

use farsight_core::{Box2d, Camera};
use serde::{Deserialize, Serialize};

/// No grid has more cells a side.
const MAX_CELLS: usize = 1024;

/// No grid has more slabs.
const MAX_SLABS: usize = 32;

/// Lengths of a grid, metres, are below this.
const MAX_M: f64 = 1000.0;

/// A grid in camera coordinates (x right, y down, z ahead), level with the camera, which stands amid its near edge.
///
/// Rows are counted from the camera on, columns from left to right.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Grid {
    /// Side of a cell, metres.
    pub cell_m: f64,
    /// Cells across.
    pub columns: usize,
    /// Cells ahead.
    pub rows: usize,
    /// How far the ground lies below the camera, metres.
    pub plane_m: f64,
    /// Slabs of voxels, one above the other.
    pub slabs: usize,
    /// Height of a slab, metres.
    pub slab_m: f64,
    /// Upper edge of the highest slab above the ground, metres. The authors' slabs reach as far below the ground, but
    /// for one.
    pub top_m: f64,
}

impl Default for Grid {
    /// The authors' at test time.
    fn default() -> Self {
        Self { cell_m: 0.5, columns: 160, rows: 160, plane_m: 1.74, slabs: 7, slab_m: 0.5, top_m: 2.0 }
    }
}

impl Grid {
    /// Cells.
    pub fn cells(&self) -> usize {
        self.columns * self.rows
    }

    /// The middle of a cell on the ground, camera coordinates, metres.
    pub fn center(&self, [column, row]: [usize; 2]) -> [f64; 3] {
        [self.left_m(column as f64 + 0.5), self.plane_m, (row as f64 + 0.5) * self.cell_m]
    }

    /// How far right of the camera something is that lies so many columns from the grid's left edge, metres.
    fn left_m(&self, columns: f64) -> f64 {
        (columns - self.columns as f64 / 2.0) * self.cell_m
    }

    /// The column and row of the cell above or below which a point lies; none outside the grid.
    pub fn cell(&self, [x, _, z]: [f64; 3]) -> Option<[usize; 2]> {
        let at = [x / self.cell_m + self.columns as f64 / 2.0, z / self.cell_m];
        let is_inside = (0.0..self.columns as f64).contains(&at[0]) && (0.0..self.rows as f64).contains(&at[1]);
        is_inside.then(|| at.map(|place| place as usize))
    }

    /// What each voxel is seen as by `camera` (of a map): the box around its eight corners, not yet cut to the map.
    /// They come slab by slab from the highest, row by row. Voxels of which a corner is not before the camera have a
    /// box that holds nothing.
    pub fn voxel_boxes(&self, camera: &Camera) -> Vec<Box2d> {
        let (columns, rows) = (self.columns + 1, self.rows + 1);
        let corner = |slab: usize, row: usize, column: usize| {
            let y = self.plane_m - self.top_m + slab as f64 * self.slab_m;
            camera.pixel_from_point([self.left_m(column as f64), y, row as f64 * self.cell_m])
        };
        let corners: Vec<Option<[f64; 2]>> = (0..=self.slabs)
            .flat_map(|slab| (0..rows).flat_map(move |row| (0..columns).map(move |column| (slab, row, column))))
            .map(|(slab, row, column)| corner(slab, row, column))
            .collect();
        let at = |slab: usize, row: usize, column: usize| corners[(slab * rows + row) * columns + column];
        let nothing = Box2d::new(f64::NAN, f64::NAN, f64::NAN, f64::NAN);
        let mut boxes = Vec::with_capacity(self.slabs * self.cells());
        for slab in 0..self.slabs {
            for row in 0..self.rows {
                for column in 0..self.columns {
                    let seen: [Option<[f64; 2]>; 8] =
                        std::array::from_fn(|k| at(slab + (k >> 2), row + (k >> 1 & 1), column + (k & 1)));
                    let is_before = seen.iter().all(Option::is_some);
                    let around = Box2d::bounding(seen.into_iter().flatten()).filter(|_| is_before);
                    boxes.push(around.unwrap_or(nothing));
                }
            }
        }
        boxes
    }

    /// Why there can be no such grid, if there cannot.
    pub fn problem(&self) -> Option<String> {
        let Self { cell_m, columns, rows, plane_m, slabs, slab_m, top_m } = *self;
        if !(1..=MAX_CELLS).contains(&columns) || !(1..=MAX_CELLS).contains(&rows) {
            return Some(format!("has {columns} x {rows} cells; expected 1 to {MAX_CELLS} a side"));
        }
        if !(1..=MAX_SLABS).contains(&slabs) {
            return Some(format!("has {slabs} slabs; expected 1 to {MAX_SLABS}"));
        }
        let lengths = [("cell_m", cell_m), ("plane_m", plane_m), ("slab_m", slab_m)];
        let wrong = lengths.iter().find(|(_, length)| !(*length > 0.0 && *length < MAX_M));
        wrong
            .map(|(name, length)| format!("has {name} {length}; expected a positive number below {MAX_M}"))
            .or_else(|| (top_m.abs() >= MAX_M || top_m.is_nan()).then(|| format!("has top_m {top_m}; expected metres")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SMALL: Grid = Grid { cell_m: 2.0, columns: 6, rows: 9, plane_m: 1.7, slabs: 2, slab_m: 1.0, top_m: 2.0 };

    #[test]
    fn cells_hold_their_own_middles() {
        for row in 0..SMALL.rows {
            for column in 0..SMALL.columns {
                assert_eq!(SMALL.cell(SMALL.center([column, row])), Some([column, row]));
            }
        }
        for outside in [[6.1, 0.0, 5.0], [-6.1, 0.0, 5.0], [0.0, 0.0, 18.1], [0.0, 0.0, -0.1], [f64::NAN, 0.0, 5.0]] {
            assert_eq!(SMALL.cell(outside), None, "{outside:?}");
        }
    }

    #[test]
    fn a_voxel_is_seen_where_its_inside_is() {
        let camera = Camera::from_hfov(80.0, 320, 96).unwrap();
        let boxes = SMALL.voxel_boxes(&camera);
        assert_eq!(boxes.len(), SMALL.slabs * SMALL.cells());
        for (k, seen) in boxes.iter().enumerate() {
            let (slab, row, column) = (k / SMALL.cells(), k % SMALL.cells() / SMALL.columns, k % SMALL.columns);
            let [x, plane, z] = SMALL.center([column, row]);
            if row == 0 {
                // Its near corners lie in the plane of the camera.
                assert!(seen.x1.is_nan(), "{seen:?}");
                continue;
            }
            let lowest = plane - SMALL.top_m + SMALL.slab_m * (slab as f64 + 1.0);
            for (dx, dy, dz) in [(0.0, 0.5, 0.0), (0.99, 0.01, -0.99), (-0.99, 0.99, 0.99)] {
                let [u, v] = camera.pixel_from_point([x + dx, lowest - dy, z + dz]).unwrap();
                assert!((seen.x1..=seen.x2).contains(&u) && (seen.y1..=seen.y2).contains(&v), "{seen:?}: {u} {v}");
            }
            let [u, v] = camera.pixel_from_point([x, lowest + 4.0, z]).unwrap();
            assert!(!((seen.x1..=seen.x2).contains(&u) && (seen.y1..=seen.y2).contains(&v)), "what lies below is not");
        }
    }
}

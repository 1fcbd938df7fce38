//! Where a picture has texture that can be found again.

use crate::grey::Grey;

/// Sides of the blocks of which windows are made (two by two), and of the cells that give one corner each, pixels.
const BLOCK: usize = 4;
const CELL_BLOCKS: usize = 4;

/// The strong direction counts this share beside the weak one: an edge says something, too.
const EDGE_SHARE: f32 = 0.03;

/// Least score: mean squared slope over a window, (grey levels a pixel)². Asphalt has little.
const LEAST_SCORE: f32 = 0.05;

/// A place with texture.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Corner {
    /// Pixels.
    pub(crate) place: [f32; 2],
    pub(crate) score: f32,
}

/// The best place of each cell for which `may` holds.
pub(crate) fn corners(picture: &Grey, may: impl Fn([f32; 2]) -> bool) -> Vec<Corner> {
    let blocks = tensors(picture);
    let [columns, rows] = picture.size.map(|side| side / BLOCK);
    let mut best: Vec<Option<Corner>> = vec![None; columns.div_ceil(CELL_BLOCKS) * rows.div_ceil(CELL_BLOCKS)];
    for row in 1..rows {
        for column in 1..columns {
            let sum = |k: usize| {
                let at = |row: usize, column: usize| blocks[row * columns + column][k];
                at(row - 1, column - 1) + at(row - 1, column) + at(row, column - 1) + at(row, column)
            };
            let [xx, xy, yy] = [0, 1, 2].map(|k| sum(k) / (4 * BLOCK * BLOCK) as f32);
            let (mean, spread) = (0.5 * (xx + yy), (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt());
            let score = mean - spread + EDGE_SHARE * (mean + spread);
            let cell = &mut best[row / CELL_BLOCKS * columns.div_ceil(CELL_BLOCKS) + column / CELL_BLOCKS];
            if score > LEAST_SCORE.max(cell.map_or(0.0, |corner| corner.score)) {
                let place = [column, row].map(|k| (k * BLOCK) as f32 - 0.5);
                if may(place) {
                    *cell = Some(Corner { place, score });
                }
            }
        }
    }
    best.into_iter().flatten().collect()
}

/// The sums of products of the slopes over each block.
fn tensors(picture: &Grey) -> Vec<[f32; 3]> {
    let [columns, rows] = picture.size.map(|side| side / BLOCK);
    let mut blocks = vec![[0.0; 3]; columns * rows];
    for y in 1..picture.size[1].saturating_sub(1).min(rows * BLOCK) {
        let (above, row, below) = (picture.row(y - 1), picture.row(y), picture.row(y + 1));
        let line = &mut blocks[y / BLOCK * columns..][..columns];
        for (column, block) in line.iter_mut().enumerate() {
            let first = (column * BLOCK).max(1);
            let last = ((column + 1) * BLOCK).min(picture.size[0] - 1);
            for x in first..last {
                let (dx, dy) = (0.5 * (row[x + 1] - row[x - 1]), 0.5 * (below[x] - above[x]));
                block[0] += dx * dx;
                block[1] += dx * dy;
                block[2] += dy * dy;
            }
        }
    }
    blocks
}

//! Glare: bright lights spread over their surroundings.

use crate::scene::Color;
use crate::vector::{add, add_scaled, float, mix, scale};

/// Side of the squares that glare is computed in, pixels.
const SQUARE: usize = 8;

/// Half width of the glare's box, squares; three boxes after each other are close to a Gaussian.
const REACH: usize = 3;

/// The most of one pixel's light that is spread, so that the sun does not drown the picture.
const MOST: f32 = 30.0;

/// Adds `share` of the light above white, spread widely, to all pixels.
pub(super) fn spread(light: &mut [Color], size: [usize; 2], exposure: f32, share: f32) {
    if share <= 0.0 {
        return;
    }
    let grid = size.map(|s| s.div_ceil(SQUARE));
    let mut squares = excess(light, size, grid, exposure);
    if squares.as_flattened().iter().all(|&light| light <= 0.0) {
        return;
    }
    for _ in 0..3 {
        squares = boxed(&squares, grid, 1, grid[0]);
        squares = boxed(&squares, grid, grid[0], grid[1]);
    }
    let share = share / exposure;
    let places: Vec<(usize, f32)> = (0..size[0]).map(place).collect();
    for (y, row) in light.chunks_exact_mut(size[0]).enumerate() {
        let line = mixed_line(&squares, grid, y);
        for (pixel, &(square, part)) in row.iter_mut().zip(&places) {
            *pixel = add_scaled(*pixel, mix(line[square], line[square + 1], part), share);
        }
    }
}

/// Mean light above white of each square.
fn excess(light: &[Color], size: [usize; 2], grid: [usize; 2], exposure: f32) -> Vec<Color> {
    let mut squares = vec![[0.0; 3]; grid[0] * grid[1]];
    for (y, row) in light.chunks_exact(size[0]).enumerate() {
        let line = &mut squares[y / SQUARE * grid[0]..][..grid[0]];
        for (square, pixels) in line.iter_mut().zip(row.chunks(SQUARE)) {
            for &[r, g, b] in pixels.iter().filter(|[r, g, b]| r.max(*g).max(*b) * exposure > 1.0) {
                let above = |value: f32| (value * exposure - 1.0).clamp(0.0, MOST);
                *square = add_scaled(*square, [above(r), above(g), above(b)], 1.0 / (SQUARE * SQUARE) as f32);
            }
        }
    }
    squares
}

/// Mean over `2 * REACH + 1` squares along one axis; `step` from one to the next, `count` of them.
fn boxed(squares: &[Color], grid: [usize; 2], step: usize, count: usize) -> Vec<Color> {
    let mean = |index: usize| {
        let place = index / step % count;
        let from = place.saturating_sub(REACH);
        let to = (place + REACH).min(count - 1);
        let first = index - (place - from) * step;
        let sum = (0..=to - from).fold([0.0; 3], |sum, i| add(sum, squares[first + i * step]));
        scale(sum, 1.0 / (2 * REACH + 1) as f32)
    };
    (0..grid[0] * grid[1]).map(mean).collect()
}

/// The squares around one line of pixels, mixed into one row; its last square twice.
fn mixed_line(squares: &[Color], [columns, rows]: [usize; 2], y: usize) -> Vec<Color> {
    let (row, share) = place(y);
    let line = |row: usize| &squares[row.min(rows - 1) * columns..][..columns];
    let mut mixed: Vec<Color> = line(row).iter().zip(line(row + 1)).map(|(&a, &b)| mix(a, b, share)).collect();
    mixed.push(mixed[columns - 1]);
    mixed
}

/// The square whose centre is before a pixel, and how far on to the next centre the pixel is.
fn place(pixel: usize) -> (usize, f32) {
    let at = ((float(pixel) + 0.5) / SQUARE as f32 - 0.5).max(0.0);
    (at as usize, at - at.floor())
}

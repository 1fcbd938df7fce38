//! Mean values over boxes by an integral image.

use super::feature_map::FeatureMap;
use crate::Box2d;

/// Sums over all rectangles of a map that begin at its upper left corner, from which the mean over any box follows.
///
/// Each cell counts with the share of it that a box covers, so boxes need not end at the borders of cells.
#[derive(Debug, Clone, PartialEq)]
pub struct IntegralImage {
    /// `[channels, height + 1, width + 1]`: the first row and column are zeros.
    sums: Vec<f64>,
    shape: [usize; 3],
}

impl IntegralImage {
    /// Sums of `map`.
    pub fn new(map: FeatureMap) -> Self {
        let [channels, height, width] = map.shape();
        let stride = width + 1;
        let mut sums = vec![0.0; channels * (height + 1) * stride];
        for channel in 0..channels {
            let plane = map.plane(channel);
            let sums = &mut sums[channel * (height + 1) * stride..(channel + 1) * (height + 1) * stride];
            for y in 0..height {
                let mut of_row = 0.0;
                for x in 0..width {
                    of_row += f64::from(plane[y * width + x]);
                    sums[(y + 1) * stride + x + 1] = sums[y * stride + x + 1] + of_row;
                }
            }
        }
        Self { sums, shape: map.shape() }
    }

    /// Mean values over `boxes`: `[channels, boxes]`. What of a box lies outside the map does not count; a box of which
    /// nothing is inside has zeros.
    pub fn means(&self, boxes: &[Box2d]) -> Vec<f32> {
        let [channels, height, width] = self.shape;
        let corners: Vec<Option<Rectangle>> =
            boxes.iter().map(|area| Rectangle::within(area, [width, height])).collect();
        let plane_len = (height + 1) * (width + 1);
        let mut means = Vec::with_capacity(channels * boxes.len());
        for channel in 0..channels {
            let sums = &self.sums[channel * plane_len..(channel + 1) * plane_len];
            means.extend(
                corners.iter().map(|corners| corners.as_ref().map_or(0.0, |corners| corners.mean(sums) as f32)),
            );
        }
        means
    }
}

/// The part of a box that is inside a map, as places between the sums of an [`IntegralImage`].
#[derive(Debug, Clone, Copy)]
struct Rectangle {
    /// Left, upper, right and lower edge, cells from the map's border.
    edges: [f64; 4],
    /// Cells in a row of the sums, and rows of them.
    size: [usize; 2],
}

impl Rectangle {
    fn within(area: &Box2d, [width, height]: [usize; 2]) -> Option<Self> {
        let edge = |at: f64, side: usize| (at + 0.5).clamp(0.0, side as f64);
        let edges = [edge(area.x1, width), edge(area.y1, height), edge(area.x2, width), edge(area.y2, height)];
        let [left, upper, right, lower] = edges;
        // What is no number is not larger, either.
        (right > left && lower > upper).then_some(Self { edges, size: [width + 1, height + 1] })
    }

    fn mean(&self, sums: &[f64]) -> f64 {
        let [left, upper, right, lower] = self.edges;
        let sum = self.sum_to(sums, right, lower) - self.sum_to(sums, left, lower) - self.sum_to(sums, right, upper)
            + self.sum_to(sums, left, upper);
        sum / ((right - left) * (lower - upper))
    }

    /// The sum from the corner of the map to here. Within a cell it grows evenly in both directions, so it lies
    /// bilinearly between the sums around it.
    fn sum_to(&self, sums: &[f64], x: f64, y: f64) -> f64 {
        let [stride, rows] = self.size;
        let (column, row) = ((x as usize).min(stride - 1), (y as usize).min(rows - 1));
        let (next_column, next_row) = ((column + 1).min(stride - 1), (row + 1).min(rows - 1));
        let (across, down) = (x - column as f64, y - row as f64);
        let between = |row: usize| {
            let (left, right) = (sums[row * stride + column], sums[row * stride + next_column]);
            left + (right - left) * across
        };
        let (upper, lower) = (between(row), between(next_row));
        upper + (lower - upper) * down
    }
}

//! Mean values over boxes by an integral image.

use super::feature_map::FeatureMap;
use crate::Box2d;

/// Sums over all rectangles of a map that begin at its upper left corner, from which the mean over any box follows.
///
/// Each cell counts with the share of it that a box covers, so boxes need not end at the borders of cells.
#[derive(Debug, Clone, PartialEq)]
pub struct IntegralImage {
    /// `[height + 1, width + 1, channels]`: the first row and column are zeros. Channels come last, as all of them are
    /// summed over the same boxes.
    sums: Vec<f64>,
    shape: [usize; 3],
}

impl IntegralImage {
    /// Sums of `map`.
    pub fn new(map: FeatureMap) -> Self {
        let [channels, height, width] = map.shape();
        let row_len = (width + 1) * channels;
        let mut sums = vec![0.0; (height + 1) * row_len];
        for channel in 0..channels {
            let plane = map.plane(channel);
            for y in 0..height {
                let mut of_row = 0.0;
                let (above, own) = sums[y * row_len..(y + 2) * row_len].split_at_mut(row_len);
                for (x, value) in plane[y * width..(y + 1) * width].iter().enumerate() {
                    of_row += f64::from(*value);
                    let place = (x + 1) * channels + channel;
                    own[place] = above[place] + of_row;
                }
            }
        }
        Self { sums, shape: map.shape() }
    }

    /// Mean values over `boxes`: `[channels, boxes]`. What of a box lies outside the map does not count; a box of which
    /// nothing is inside has zeros.
    pub fn means(&self, boxes: &[Box2d]) -> Vec<f32> {
        let [channels, height, width] = self.shape;
        let mut means = vec![0.0; channels * boxes.len()];
        let mut mean = vec![0.0; channels];
        for (i, area) in boxes.iter().enumerate() {
            let Some((rows, columns)) = between(area.y1, area.y2, height).zip(between(area.x1, area.x2, width)) else {
                continue;
            };
            mean.fill(0.0);
            for (row, row_share) in rows {
                for (column, column_share) in columns {
                    let share = row_share * column_share;
                    let start = (row * (width + 1) + column) * channels;
                    for (mean, sum) in mean.iter_mut().zip(&self.sums[start..start + channels]) {
                        *mean += share * sum;
                    }
                }
            }
            for (channel, mean) in mean.iter().enumerate() {
                means[channel * boxes.len() + i] = *mean as f32;
            }
        }
        means
    }
}

/// The sums along a side of `size` cells that the mean between two edges is made of, and what each counts. None where
/// nothing lies between them.
///
/// A sum up to a place within a cell grows evenly in both directions, so it lies between those around it, and a mean is
/// made of the sums up to four corners: of 16 sums.
fn between(low: f64, high: f64, size: usize) -> Option<[(usize, f64); 4]> {
    // A cell reaches half a cell to both sides of its whole number.
    let edge = |at: f64| (at + 0.5).clamp(0.0, size as f64);
    let (low, high) = (edge(low), edge(high));
    let around = |at: f64, sign: f64| {
        let first = (at as usize).min(size);
        let share = at - first as f64;
        let scale = sign / (high - low);
        [(first, (1.0 - share) * scale), ((first + 1).min(size), share * scale)]
    };
    let ([a, b], [c, d]) = (around(low, -1.0), around(high, 1.0));
    // What is no number is not larger, either.
    (high > low).then_some([a, b, c, d])
}

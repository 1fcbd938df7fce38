//! Shrinking without aliases: means over what an output pixel covers, first along the rows, then down the columns.

use std::collections::VecDeque;
use std::ops::Range;

use farsight_core::Affine2;
use image::RgbImage;

use super::row_planes::Planes;
use super::taps::covered_range;

/// The source pixels that one output pixel is a mean of, along one axis.
#[derive(Debug, Clone, PartialEq)]
struct Support {
    /// Number of the first, from 0.
    first: usize,
    /// Their weights. Together with those of pixels beyond the border, which are black, they add up to 1.
    weights: Vec<f32>,
}

impl Support {
    /// What the output pixel at the source's `position` sees on an axis of `len` pixels; a triangle that reaches
    /// `reach` pixels either way.
    fn new(position: f64, reach: f64, len: usize) -> Self {
        let weight = |pixel: f64| (1.0 - (pixel - position).abs() / reach).max(0.0);
        let [low, high] = [(position - reach).ceil(), (position + reach).floor()];
        let total: f64 = (0..=(high - low) as usize).map(|i| weight(low + i as f64)).sum();
        let first = low.max(0.0) as usize;
        let end = (high + 1.0).clamp(0.0, len as f64) as usize;
        Self { first, weights: (first..end).map(|pixel| (weight(pixel as f64) / total) as f32).collect() }
    }

    fn range(&self) -> Range<usize> {
        self.first..self.first + self.weights.len()
    }
}

/// Supports of `count` output pixels, the first at `start` and each `step` further, and the range of those that see the
/// source.
fn supports(start: f64, step: f64, count: usize, len: usize) -> (Vec<Support>, Range<usize>) {
    let reach = step.abs().max(1.0);
    let all: Vec<Support> = (0..count).map(|i| Support::new(start + step * i as f64, reach, len)).collect();
    let covered = covered_range(all.iter().map(|support| support.weights.iter().any(|weight| *weight > 0.0)));
    (all, covered)
}

/// As [`super::resample::rows`], for maps that shrink the image along an axis and do not turn it.
pub(super) fn rows(
    image: &RgbImage,
    source_from_output: &Affine2,
    [width, height]: [usize; 2],
    mut emit: impl FnMut(usize, Range<usize>, [&[f32]; 3]),
) {
    let [[step_x, _, start_x], [_, step_y, start_y]] = source_from_output.matrix;
    let (column_supports, columns) = supports(start_x, step_x, width, image.width() as usize);
    let (row_supports, rows) = supports(start_y, step_y, height, image.height() as usize);
    if columns.is_empty() {
        return;
    }
    let mut filtered = FilteredRows { image, columns: &column_supports[columns.clone()], kept: VecDeque::new() };
    let mut mean = Planes::new(columns.len());
    for row in rows {
        let support = &row_supports[row];
        filtered.keep(&support.range());
        mean.0.fill(0.0);
        for (source, &weight) in support.range().zip(&support.weights) {
            for (out, &value) in mean.0.iter_mut().zip(&filtered.row(source).0) {
                *out += weight * value;
            }
        }
        emit(row, columns.clone(), mean.channels());
    }
}

/// Source rows filtered to the output's columns. An output row shares most of its source rows with the one before.
struct FilteredRows<'a> {
    image: &'a RgbImage,
    columns: &'a [Support],
    /// Numbers of source rows, and the rows.
    kept: VecDeque<(usize, Planes)>,
}

impl FilteredRows<'_> {
    /// Forgets rows outside `range`: rows go up or down, so they are not asked for again.
    fn keep(&mut self, range: &Range<usize>) {
        self.kept.retain(|(row, _)| range.contains(row));
    }

    fn row(&mut self, row: usize) -> &Planes {
        let place = self.kept.iter().position(|(kept, _)| *kept == row).unwrap_or_else(|| {
            self.kept.push_back((row, self.filter(row)));
            self.kept.len() - 1
        });
        &self.kept[place].1
    }

    fn filter(&self, row: usize) -> Planes {
        let width = self.image.width() as usize;
        let (pixels, _) = self.image.as_raw()[3 * width * row..][..3 * width].as_chunks::<3>();
        let mut planes = Planes::new(self.columns.len());
        let (red, rest) = planes.0.split_at_mut(self.columns.len());
        let (green, blue) = rest.split_at_mut(self.columns.len());
        for (((support, r), g), b) in self.columns.iter().zip(red).zip(green).zip(blue) {
            for (pixel, weight) in pixels[support.range()].iter().zip(&support.weights) {
                *r += weight * f32::from(pixel[0]);
                *g += weight * f32::from(pixel[1]);
                *b += weight * f32::from(pixel[2]);
            }
        }
        planes
    }
}

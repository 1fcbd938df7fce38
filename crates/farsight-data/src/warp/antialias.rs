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
    /// Numbers of the pixels, from 0.
    pixels: Range<usize>,
    /// Where their weights begin among those of all output pixels.
    weights: usize,
}

/// What the output pixels of one axis see.
#[derive(Debug, Default)]
struct Supports {
    each: Vec<Support>,
    /// Weights of a pixel's support, together with those of pixels beyond the border, which are black, add up to 1.
    weights: Vec<f32>,
}

impl Supports {
    /// Adds what the output pixel at the source's `position` sees on an axis of `len` pixels: a triangle that reaches
    /// `reach` pixels either way.
    fn push(&mut self, position: f64, reach: f64, len: usize) {
        let weight = |pixel: f64| (1.0 - (pixel - position).abs() / reach).max(0.0);
        let [low, high] = [(position - reach).ceil(), (position + reach).floor()];
        let total: f64 = (0..=(high - low) as usize).map(|i| weight(low + i as f64)).sum();
        let first = low.max(0.0) as usize;
        let end = (high + 1.0).clamp(0.0, len as f64) as usize;
        let weights = self.weights.len();
        self.weights.extend((first..end).map(|pixel| (weight(pixel as f64) / total) as f32));
        self.each.push(Support { pixels: first..first + self.weights.len() - weights, weights });
    }

    /// Makes them those of `count` output pixels, the first at `start` and each `step` further; the range of those that
    /// see the source.
    fn set(&mut self, start: f64, step: f64, count: usize, len: usize) -> Range<usize> {
        self.each.clear();
        self.weights.clear();
        let reach = step.abs().max(1.0);
        for i in 0..count {
            self.push(start + step * i as f64, reach, len);
        }
        covered_range(self.each.iter().map(|support| self.weights(support).iter().any(|weight| *weight > 0.0)))
    }

    fn weights(&self, support: &Support) -> &[f32] {
        &self.weights[support.weights..][..support.pixels.len()]
    }
}

/// What [`rows`] works in.
#[derive(Debug, Default)]
pub(super) struct FilterBuffers {
    columns: Supports,
    rows: Supports,
    kept: VecDeque<(usize, Planes)>,
    spare: Vec<Planes>,
    mean: Planes,
}

/// As [`super::resample::rows`], for maps that shrink the image along an axis and do not turn it.
pub(super) fn rows(
    image: &RgbImage,
    source_from_output: &Affine2,
    [width, height]: [usize; 2],
    buffers: &mut FilterBuffers,
    mut emit: impl FnMut(usize, Range<usize>, [&[f32]; 3]),
) {
    let FilterBuffers { columns: column_supports, rows: row_supports, kept, spare, mean } = buffers;
    let [[step_x, _, start_x], [_, step_y, start_y]] = source_from_output.matrix;
    let columns = column_supports.set(start_x, step_x, width, image.width() as usize);
    let rows = row_supports.set(start_y, step_y, height, image.height() as usize);
    if columns.is_empty() {
        return;
    }
    spare.extend(kept.drain(..).map(|(_, planes)| planes));
    let mut filtered = FilteredRows { image, supports: column_supports, columns: columns.clone(), kept, spare };
    mean.resize(columns.len());
    for row in rows {
        let support = &row_supports.each[row];
        filtered.keep(&support.pixels);
        mean.0.fill(0.0);
        for (source, &weight) in support.pixels.clone().zip(row_supports.weights(support)) {
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
    supports: &'a Supports,
    columns: Range<usize>,
    /// Numbers of source rows, and the rows.
    kept: &'a mut VecDeque<(usize, Planes)>,
    spare: &'a mut Vec<Planes>,
}

impl FilteredRows<'_> {
    /// Forgets rows outside `range`: rows go up or down, so they are not asked for again.
    fn keep(&mut self, range: &Range<usize>) {
        let mut place = 0;
        while place < self.kept.len() {
            if range.contains(&self.kept[place].0) {
                place += 1;
            } else {
                self.spare.extend(self.kept.remove(place).map(|(_, planes)| planes));
            }
        }
    }

    fn row(&mut self, row: usize) -> &Planes {
        let place = self.kept.iter().position(|(kept, _)| *kept == row).unwrap_or_else(|| {
            let mut planes = self.spare.pop().unwrap_or_default();
            self.filter(row, &mut planes);
            self.kept.push_back((row, planes));
            self.kept.len() - 1
        });
        &self.kept[place].1
    }

    fn filter(&self, row: usize, planes: &mut Planes) {
        let width = self.image.width() as usize;
        let (pixels, _) = self.image.as_raw()[3 * width * row..][..3 * width].as_chunks::<3>();
        planes.resize(self.columns.len());
        planes.0.fill(0.0);
        let (red, rest) = planes.0.split_at_mut(self.columns.len());
        let (green, blue) = rest.split_at_mut(self.columns.len());
        for (((support, r), g), b) in self.supports.each[self.columns.clone()].iter().zip(red).zip(green).zip(blue) {
            for (pixel, weight) in pixels[support.pixels.clone()].iter().zip(self.supports.weights(support)) {
                *r += weight * f32::from(pixel[0]);
                *g += weight * f32::from(pixel[1]);
                *b += weight * f32::from(pixel[2]);
            }
        }
    }
}

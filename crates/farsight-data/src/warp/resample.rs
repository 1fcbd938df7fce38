//! Rows of the warped image, as planes of 0 to 255, not yet rounded.

use std::ops::Range;

use farsight_core::Affine2;
use farsight_core::input::Sampling;
use image::RgbImage;

use super::antialias;
use super::row_planes::Planes;
use super::taps::{Taps, axis_taps, covered_range, taps};

/// Hands the rows of the output to `emit`: row number, columns that see the source, and their red, green and blue.
///
/// Rows and columns that see nothing are left out.
pub(super) fn rows(
    image: &RgbImage,
    source_from_output: &Affine2,
    size: [usize; 2],
    sampling: Sampling,
    emit: impl FnMut(usize, Range<usize>, [&[f32]; 3]),
) {
    let [[_, shear_x, _], [shear_y, _, _]] = source_from_output.matrix;
    if image.is_empty() || size.contains(&0) {
        return;
    }
    let shrinks = || (0..2).any(|axis| source_from_output.matrix[axis][axis].abs() > 1.0);
    if shear_x != 0.0 || shear_y != 0.0 {
        turned_rows(image, source_from_output, size, sampling, emit);
    } else if sampling == Sampling::Antialias && shrinks() {
        antialias::rows(image, source_from_output, size, emit);
    } else {
        upright_rows(image, source_from_output, size, sampling, emit);
    }
}

/// Mirror, crop and scale: rows stay rows, so each source row is stretched once and output rows lie between two
/// stretched rows.
fn upright_rows(
    image: &RgbImage,
    source_from_output: &Affine2,
    [width, height]: [usize; 2],
    sampling: Sampling,
    mut emit: impl FnMut(usize, Range<usize>, [&[f32]; 3]),
) {
    let [[step_x, _, start_x], [_, step_y, start_y]] = source_from_output.matrix;
    let (column_taps, columns) = axis_taps(start_x, step_x, width, image.width() as usize, sampling);
    let (row_taps, rows) = axis_taps(start_y, step_y, height, image.height() as usize, sampling);
    if columns.is_empty() {
        return;
    }
    let mut stretched = StretchedRows::new(image, &column_taps[columns.clone()]);
    let mut between = Planes::new(columns.len());
    for row in rows {
        let Taps { first, second, weight } = row_taps[row];
        let [upper, lower] = stretched.pair(first, second);
        for ((out, &a), &b) in between.0.iter_mut().zip(&upper.0).zip(&lower.0) {
            *out = a + (b - a) * weight;
        }
        emit(row, columns.clone(), between.channels());
    }
}

/// Any other map, pixel by pixel.
fn turned_rows(
    image: &RgbImage,
    source_from_output: &Affine2,
    [width, height]: [usize; 2],
    sampling: Sampling,
    mut emit: impl FnMut(usize, Range<usize>, [&[f32]; 3]),
) {
    let [source_width, source_height] = [image.width() as usize, image.height() as usize];
    let mut found = Vec::with_capacity(width);
    for row in 0..height {
        found.clear();
        found.extend((0..width).map(|column| {
            let [x, y] = source_from_output.apply([column as f64, row as f64]);
            taps(x, source_width, sampling).zip(taps(y, source_height, sampling))
        }));
        let columns = covered_range(found.iter().map(Option::is_some));
        let mut values = Planes::new(columns.len());
        for (i, tap) in found[columns.clone()].iter().enumerate() {
            let Some((x, y)) = tap else { continue };
            values.set(i, bilinear(image, x, y));
        }
        emit(row, columns, values.channels());
    }
}

fn bilinear(image: &RgbImage, x: &Taps, y: &Taps) -> [f32; 3] {
    let pixel = |column: usize, row: usize| {
        let inside = (1..=image.width() as usize).contains(&column) && (1..=image.height() as usize).contains(&row);
        if inside { image.get_pixel(column as u32 - 1, row as u32 - 1).0.map(f32::from) } else { [0.0; 3] }
    };
    let across = |row: usize| lerp(pixel(x.first, row), pixel(x.second, row), x.weight);
    lerp(across(y.first), across(y.second), y.weight)
}

fn lerp(a: [f32; 3], b: [f32; 3], weight: f32) -> [f32; 3] {
    [0, 1, 2].map(|c| a[c] + (b[c] - a[c]) * weight)
}

/// Source rows stretched to the output's columns. The last two are kept: the next output row mostly needs one of them
/// again.
struct StretchedRows<'a> {
    image: &'a RgbImage,
    columns: &'a [Taps],
    /// One source row with a black pixel at either end.
    padded: Vec<[u8; 3]>,
    /// Number of the source row in each slot, from 1, and the row.
    slots: [(Option<usize>, Planes); 2],
}

impl<'a> StretchedRows<'a> {
    fn new(image: &'a RgbImage, columns: &'a [Taps]) -> Self {
        let slot = || (None, Planes::new(columns.len()));
        Self { image, columns, padded: vec![[0; 3]; image.width() as usize + 2], slots: [slot(), slot()] }
    }

    /// Source rows `first` and `second`, counted from 1; the one before the first and the one after the last are black.
    fn pair(&mut self, first: usize, second: usize) -> [&Planes; 2] {
        let slot_of = |slots: &[(Option<usize>, Planes); 2], row| slots.iter().position(|(kept, _)| *kept == Some(row));
        let first_slot = slot_of(&self.slots, first).unwrap_or_else(|| {
            let free = slot_of(&self.slots, second).map_or(0, |taken| 1 - taken);
            self.stretch(first, free);
            free
        });
        let second_slot = slot_of(&self.slots, second).unwrap_or_else(|| {
            self.stretch(second, 1 - first_slot);
            1 - first_slot
        });
        [&self.slots[first_slot].1, &self.slots[second_slot].1]
    }

    fn stretch(&mut self, row: usize, slot: usize) {
        let (kept, planes) = &mut self.slots[slot];
        *kept = Some(row);
        let width = self.image.width() as usize;
        if !(1..=self.image.height() as usize).contains(&row) {
            planes.0.fill(0.0);
            return;
        }
        let (pixels, _) = self.image.as_raw()[3 * width * (row - 1)..][..3 * width].as_chunks::<3>();
        self.padded[1..=width].copy_from_slice(pixels);
        let (red, rest) = planes.0.split_at_mut(self.columns.len());
        let (green, blue) = rest.split_at_mut(self.columns.len());
        for (((tap, r), g), b) in self.columns.iter().zip(red).zip(green).zip(blue) {
            let ends = [tap.first, tap.second].map(|column| self.padded[column].map(f32::from));
            [*r, *g, *b] = lerp(ends[0], ends[1], tap.weight);
        }
    }
}

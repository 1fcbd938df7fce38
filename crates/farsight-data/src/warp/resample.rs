//! Rows of the warped image, as planes of 0 to 255, not yet rounded.

use std::cell::RefCell;
use std::ops::Range;

use farsight_core::Affine2;
use farsight_core::input::Sampling;
use image::RgbImage;

use super::antialias::{self, FilterBuffers};
use super::row_planes::Planes;
use super::taps::{Taps, axis_taps, covered_range, taps};

thread_local! {
    /// Kept from warp to warp, as fresh memory costs time: an image has one cut-out or more for each object.
    static BUFFERS: RefCell<(StretchBuffers, FilterBuffers)> = RefCell::default();
}

/// Hands the rows of the output to `emit`: row number, columns that see the source, and their red, green and blue.
///
/// Rows and columns that see nothing are left out. `emit` warps nothing itself.
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
        BUFFERS.with_borrow_mut(|(_, buffers)| antialias::rows(image, source_from_output, size, buffers, emit));
    } else {
        BUFFERS.with_borrow_mut(|(buffers, _)| upright_rows(image, source_from_output, size, sampling, buffers, emit));
    }
}

/// What [`upright_rows`] works in.
#[derive(Debug, Default)]
struct StretchBuffers {
    column_taps: Vec<Taps>,
    row_taps: Vec<Taps>,
    padded: Vec<[u8; 3]>,
    /// Stretched rows.
    slots: [Planes; 2],
    between: Planes,
}

/// Mirror, crop and scale: rows stay rows, so each source row is stretched once and output rows lie between two
/// stretched rows.
fn upright_rows(
    image: &RgbImage,
    source_from_output: &Affine2,
    [width, height]: [usize; 2],
    sampling: Sampling,
    StretchBuffers { column_taps, row_taps, padded, slots, between }: &mut StretchBuffers,
    mut emit: impl FnMut(usize, Range<usize>, [&[f32]; 3]),
) {
    let [[step_x, _, start_x], [_, step_y, start_y]] = source_from_output.matrix;
    let columns = axis_taps(column_taps, start_x, step_x, width, image.width() as usize, sampling);
    let rows = axis_taps(row_taps, start_y, step_y, height, image.height() as usize, sampling);
    if columns.is_empty() {
        return;
    }
    let mut stretched = StretchedRows::new(image, &column_taps[columns.clone()], padded, slots);
    between.resize(columns.len());
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
        let mut values = Planes::default();
        values.resize(columns.len());
        values.0.fill(0.0);
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
    /// Which of a source row's pixels the columns see, counted from 1; there is a black one at either end.
    seen: Range<usize>,
    /// These of one source row.
    padded: &'a mut Vec<[u8; 3]>,
    slots: &'a mut [Planes; 2],
    /// Number of the source row in each slot, from 1.
    kept: [Option<usize>; 2],
}

impl<'a> StretchedRows<'a> {
    fn new(image: &'a RgbImage, columns: &'a [Taps], padded: &'a mut Vec<[u8; 3]>, slots: &'a mut [Planes; 2]) -> Self {
        let first = columns.iter().map(|taps| taps.first).min().unwrap_or(0);
        let last = columns.iter().map(|taps| taps.second).max().unwrap_or(0);
        let seen = first..last + 1;
        padded.clear();
        padded.resize(seen.len(), [0; 3]);
        for slot in &mut *slots {
            slot.resize(columns.len());
        }
        Self { image, columns, seen, padded, slots, kept: [None; 2] }
    }

    /// Source rows `first` and `second`, counted from 1; the one before the first and the one after the last are black.
    fn pair(&mut self, first: usize, second: usize) -> [&Planes; 2] {
        let slot_of = |kept: &[Option<usize>; 2], row| kept.iter().position(|kept| *kept == Some(row));
        let first_slot = slot_of(&self.kept, first).unwrap_or_else(|| {
            let free = slot_of(&self.kept, second).map_or(0, |taken| 1 - taken);
            self.stretch(first, free);
            free
        });
        let second_slot = slot_of(&self.kept, second).unwrap_or_else(|| {
            self.stretch(second, 1 - first_slot);
            1 - first_slot
        });
        [&self.slots[first_slot], &self.slots[second_slot]]
    }

    fn stretch(&mut self, row: usize, slot: usize) {
        self.kept[slot] = Some(row);
        let planes = &mut self.slots[slot];
        let width = self.image.width() as usize;
        if !(1..=self.image.height() as usize).contains(&row) {
            planes.0.fill(0.0);
            return;
        }
        let (pixels, _) = self.image.as_raw()[3 * width * (row - 1)..][..3 * width].as_chunks::<3>();
        let inside = self.seen.start.max(1)..self.seen.end.min(width + 1);
        let from = inside.start - self.seen.start;
        self.padded[from..][..inside.len()].copy_from_slice(&pixels[inside.start - 1..inside.end - 1]);
        let (red, rest) = planes.0.split_at_mut(self.columns.len());
        let (green, blue) = rest.split_at_mut(self.columns.len());
        for (((tap, r), g), b) in self.columns.iter().zip(red).zip(green).zip(blue) {
            let ends = [tap.first, tap.second].map(|column| self.padded[column - self.seen.start].map(f32::from));
            [*r, *g, *b] = lerp(ends[0], ends[1], tap.weight);
        }
    }
}

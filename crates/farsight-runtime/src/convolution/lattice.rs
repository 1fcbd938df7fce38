//! How an input is laid out so that windows are read where they lie.

use std::ops::Range;

use farsight_graph::graph::Window;

use super::sums::PADDING;

/// How an input is laid out: for each remainder of row and column by the stride that taps have, a plane of its own.
pub(super) struct Lattice {
    window: Window,
    /// Remainders of row and column.
    phases: Vec<[usize; 2]>,
    /// Rows and columns that the last tap is after the first one in its plane.
    pub(super) reach: usize,
    /// Numbers in a row of a plane.
    pub(super) pitch: usize,
}

/// Some rows of one channel of a map.
#[derive(Clone, Copy)]
pub(super) struct Rows<'a> {
    pub(super) values: &'a [f32],
    /// Where the first one is in the map.
    pub(super) first: usize,
    /// Height and width of the map.
    pub(super) size: [usize; 2],
}

impl Lattice {
    /// That of an output of so many columns.
    pub(super) fn new(window: Window, columns: usize) -> Self {
        let Window { kernel, stride, dilation, .. } = window;
        let mut remainders: Vec<usize> = (0..kernel).map(|tap| tap * dilation % stride).collect();
        remainders.sort_unstable();
        remainders.dedup();
        let phases = remainders.iter().flat_map(|&y| remainders.iter().map(move |&x| [y, x])).collect();
        let reach = (kernel - 1) * dilation / stride;
        Self { window, phases, reach, pitch: columns + reach }
    }

    /// Numbers in a plane for so many rows of the output.
    pub(super) fn plane(&self, rows: usize) -> usize {
        (rows + self.reach) * self.pitch
    }

    /// Numbers in all planes of a channel, for so many rows of the output.
    pub(super) fn channel(&self, rows: usize) -> usize {
        self.phases.len() * self.plane(rows)
    }

    /// Where the taps of the first cell are, for each channel and tap, in planes of this size.
    pub(super) fn taps(&self, channels: usize, plane: usize) -> Vec<usize> {
        let Window { kernel, stride, dilation, .. } = self.window;
        let tap = |y: usize, x: usize| {
            let [y, x] = [y * dilation, x * dilation];
            let phase = [y % stride, x % stride];
            let place = self.phases.iter().position(|other| *other == phase).unwrap_or_default();
            place * plane + y / stride * self.pitch + x / stride
        };
        let of_window: Vec<usize> =
            (0..kernel).flat_map(|y| (0..kernel).map(move |x| (y, x))).map(|(y, x)| tap(y, x)).collect();
        let a_channel = self.phases.len() * plane;
        (0..channels).flat_map(|channel| of_window.iter().map(move |tap| channel * a_channel + tap)).collect()
    }

    /// Copies what the rows `from..to` of the output are made of, of all channels.
    pub(super) fn copy_rows(
        &self,
        image: &[f32],
        size @ [height, width]: [usize; 2],
        [from, to]: [usize; 2],
        copy: &mut Vec<f32>,
    ) {
        let channels = image.chunks(height * width);
        let a_channel = self.channel(to - from);
        let length = channels.len() * a_channel;
        copy.resize(length + PADDING, 0.0);
        for (planes, values) in copy[..length].chunks_mut(a_channel).zip(channels) {
            self.fill(Rows { values, first: 0, size }, planes, from, 0..to - from + self.reach);
        }
    }

    /// Fills these rows of the planes of a channel, whose first ones belong to the row `from` of the output.
    pub(super) fn fill(&self, source: Rows<'_>, planes: &mut [f32], from: usize, rows: Range<usize>) {
        let Window { stride, padding, .. } = self.window;
        let [height, width] = source.size;
        let plane = planes.len() / self.phases.len();
        for (plane, &[y, x]) in planes.chunks_mut(plane).zip(&self.phases) {
            // Columns of the plane that lie in the image.
            let first = padding.saturating_sub(x).div_ceil(stride).min(self.pitch);
            let end = (width + padding).saturating_sub(x).div_ceil(stride).clamp(first, self.pitch);
            for row in rows.clone() {
                let copied = &mut plane[row * self.pitch..][..self.pitch];
                let line = ((from + row) * stride + y).checked_sub(padding).filter(|line| *line < height);
                let Some(line) = line else {
                    copied.fill(0.0);
                    continue;
                };
                copied[..first].fill(0.0);
                copied[end..].fill(0.0);
                if first < end {
                    let line = line - source.first;
                    let start = line * width + first * stride + x - padding;
                    let values = &source.values[start..(line + 1) * width];
                    if stride == 1 {
                        copied[first..end].copy_from_slice(&values[..end - first]);
                    } else {
                        for (copied, value) in copied[first..end].iter_mut().zip(values.iter().step_by(stride)) {
                            *copied = *value;
                        }
                    }
                }
            }
        }
    }

    /// The lines of a map of this height that [`Lattice::fill`] reads.
    pub(super) fn lines(&self, from: usize, rows: Range<usize>, height: usize) -> Range<usize> {
        let Window { stride, padding, .. } = self.window;
        let last_phase = self.phases.iter().map(|[y, _]| *y).max().unwrap_or_default();
        let line = |row: usize, phase: usize| ((from + row) * stride + phase).saturating_sub(padding).min(height);
        let end = rows.end.checked_sub(1).map_or(0, |last| line(last, last_phase + 1));
        line(rows.start, 0).min(end)..end
    }

    /// Makes the last rows of the planes of a channel, for so many rows of the output, the first ones: those that the
    /// next rows of the output share.
    pub(super) fn carry(&self, planes: &mut [f32], rows: usize) {
        let plane = planes.len() / self.phases.len();
        for plane in planes.chunks_mut(plane) {
            plane.copy_within(rows * self.pitch..(rows + self.reach) * self.pitch, 0);
        }
    }
}

/// Copies rows that begin every `pitch` numbers.
pub(super) fn copy_out(made: &[f32], pitch: usize, rows: &mut [f32], columns: usize) {
    for (row, made) in rows.chunks_mut(columns).zip(made.chunks(pitch)) {
        row.copy_from_slice(&made[..columns]);
    }
}

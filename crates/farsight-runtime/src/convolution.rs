//! Convolutions on the CPU at hand, by its vector instructions.
//!
//! rten unrolls the windows of a convolution into a matrix, which takes a third of the time of our networks, and computes
//! depthwise ones number by number. Here windows are read where they lie: an input is copied once, with its zeros around,
//! into planes of every `stride`-th row and column. Within these each tap of a window is a fixed distance, whatever the
//! output cell, and a vector of neighbouring cells is one load.

use farsight_graph::graph::Window;
use farsight_onnx::{Convolution, ConvolutionKind};
use rayon::prelude::*;
use rten_simd::ops::{BitOps, NumOps};
use rten_simd::{Isa, SimdOp};

use crate::library::Failure;

/// Output channels that are computed together.
const BLOCK: usize = 8;

/// Vectors of cells that are computed together.
const VECTORS: usize = 3;

/// The same of a depthwise convolution, where a tap is one number.
const DEPTHWISE_VECTORS: usize = 8;

/// Lanes of the widest vectors.
const MAX_LANES: usize = 16;

/// Numbers that are copied for some rows of the output: they stay in the second-level cache.
const STRIP: usize = 1 << 16;

/// A convolution that is ready to run.
#[derive(Debug)]
pub(crate) struct ConvolutionLayer {
    kind: ConvolutionKind,
    window: Window,
    channels: [usize; 2],
    /// `[block][in, ky, kx]` of a dense one, `[channel][ky, kx]` in the first place of the others.
    weights: Weights,
    biases: Vec<f32>,
    limits: [f32; 2],
}

#[derive(Debug)]
enum Weights {
    Blocks(Vec<[f32; BLOCK]>),
    Single(Vec<f32>),
}

/// A map, `[batch, channels, height, width]`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MapView<'a> {
    pub(crate) shape: [usize; 4],
    pub(crate) values: &'a [f32],
}

impl ConvolutionLayer {
    pub(crate) fn new(convolution: &Convolution) -> Self {
        let Convolution { kind, window, weight, bias, limits, .. } = convolution;
        let [out, of_group, kernel, _] = weight.shape[..] else { unreachable!("a weight of four axes") };
        let channels = [if *kind == ConvolutionKind::Dense { of_group } else { out }, out];
        let weights = match kind {
            ConvolutionKind::Dense => Weights::Blocks(blocks(&weight.values, of_group * kernel * kernel)),
            ConvolutionKind::Depthwise | ConvolutionKind::Upsampling => Weights::Single(weight.values.clone()),
        };
        let mut biases = bias.clone();
        biases.resize(out.next_multiple_of(BLOCK), 0.0);
        Self { kind: *kind, window: *window, channels, weights, biases, limits: *limits }
    }

    /// What it makes of `input`, and its shape. Runs in the thread pool of the caller.
    pub(crate) fn run(&self, input: MapView<'_>) -> Result<(Vec<f32>, [usize; 4]), Failure> {
        let [batch, channels, height, width] = input.shape;
        let [expected, out] = self.channels;
        if channels != expected {
            return Err(format!("a map of {channels} channels; expected {expected}").into());
        }
        let [rows, columns] = match self.kind {
            ConvolutionKind::Upsampling => [height, width].map(|side| side * self.window.stride),
            ConvolutionKind::Dense | ConvolutionKind::Depthwise => {
                let sides = [height, width].map(|side| self.window.output_size(side));
                let [Some(rows), Some(columns)] = sides else {
                    return Err(format!("a map of {width}x{height} cells is smaller than a window").into());
                };
                [rows, columns]
            }
        };
        let mut output = vec![0.0; batch * out * rows * columns];
        let shape = [batch, out, rows, columns];
        if output.is_empty() {
            return Ok((output, shape));
        }
        match &self.weights {
            Weights::Blocks(weights) => self.dense(input, weights, &mut output, [rows, columns]),
            Weights::Single(weights) => {
                let planes = input.values.par_chunks(height * width).zip(output.par_chunks_mut(rows * columns));
                planes.enumerate().for_each_init(Scratch::default, |scratch, (place, (input, output))| {
                    let channel = place % out;
                    let weights = &weights[channel * self.window.kernel.pow(2)..][..self.window.kernel.pow(2)];
                    let plane = Plane { input, size: [height, width], weights, bias: self.biases[channel] };
                    match self.kind {
                        ConvolutionKind::Upsampling => self.enlarged(&plane, output, scratch),
                        _ => self.depthwise(&plane, output, [rows, columns], scratch),
                    }
                });
            }
        }
        Ok((output, shape))
    }

    fn dense(&self, input: MapView<'_>, weights: &[[f32; BLOCK]], output: &mut [f32], [rows, columns]: [usize; 2]) {
        let [_, channels, height, width] = input.shape;
        let [_, out] = self.channels;
        // A window of one cell knows no rows.
        let Window { kernel, stride, padding, end_padding, .. } = self.window;
        let is_pointwise = kernel == 1 && stride == 1 && padding == 0 && end_padding == 0;
        let (size, [rows, columns]) =
            if is_pointwise { ([1, height * width], [1, rows * columns]) } else { ([height, width], [rows, columns]) };
        let lattice = Lattice::new(self.window, columns);
        // Strips of rows, or of a single row.
        let strips: Vec<[usize; 2]> = if is_pointwise {
            let step = (STRIP / channels.max(1)).next_multiple_of(VECTORS * MAX_LANES);
            (0..columns).step_by(step).map(|from| [from, columns.min(from + step)]).collect()
        } else {
            let a_row = channels * lattice.pitch * lattice.phases.len();
            let step = (STRIP / a_row.max(1)).saturating_sub(lattice.reach).max(lattice.reach.max(1));
            (0..rows).step_by(step).map(|from| [from, rows.min(from + step)]).collect()
        };
        let cells_of = |[from, to]: [usize; 2]| if is_pointwise { to - from } else { (to - from) * columns };

        let mut tasks = Vec::new();
        let images = input.values.chunks(channels * height * width);
        for (image, output) in images.zip(output.chunks_mut(out * rows * columns)) {
            let mut planes: Vec<&mut [f32]> = output.chunks_mut(rows * columns).collect();
            for &strip in &strips {
                let parts = planes.iter_mut().map(|plane| {
                    let (part, rest) = std::mem::take(plane).split_at_mut(cells_of(strip));
                    *plane = rest;
                    part
                });
                tasks.push((image, strip, parts.collect::<Vec<_>>()));
            }
        }
        tasks.into_par_iter().for_each_init(Scratch::default, |scratch, (image, strip, mut parts)| {
            let Scratch { input, output } = scratch;
            let [from, to] = strip;
            let (count, pitch, columns) = if is_pointwise {
                lattice.copy_columns(image, size, strip, input);
                (to - from, to - from, to - from)
            } else {
                lattice.copy_rows(image, size, strip, input);
                ((to - from - 1) * lattice.pitch + columns, lattice.pitch, columns)
            };
            let planes = if is_pointwise { pitch } else { lattice.plane(to - from) };
            let taps = lattice.taps(channels, planes);
            let row_length = count.next_multiple_of(MAX_LANES);
            output.resize(BLOCK * row_length, 0.0);
            let blocks = weights.chunks(taps.len()).zip(self.biases.as_chunks::<BLOCK>().0);
            for ((weights, biases), parts) in blocks.zip(parts.chunks_mut(BLOCK)) {
                let used = parts.len();
                let limits = self.limits;
                Block { input, taps: &taps, weights, biases, limits, count, row_length, used, output }.dispatch();
                for (part, made) in parts.iter_mut().zip(output.chunks(row_length)) {
                    for (row, made) in part.chunks_mut(columns).zip(made.chunks(pitch)) {
                        row.copy_from_slice(&made[..columns]);
                    }
                }
            }
        });
    }

    fn depthwise(&self, plane: &Plane<'_>, result: &mut [f32], [rows, columns]: [usize; 2], scratch: &mut Scratch) {
        let Scratch { input, output } = scratch;
        let lattice = Lattice::new(self.window, columns);
        lattice.copy_rows(plane.input, plane.size, [0, rows], input);
        let taps = lattice.taps(1, lattice.plane(rows));
        let count = (rows - 1) * lattice.pitch + columns;
        let row_length = count.next_multiple_of(MAX_LANES);
        output.resize(row_length, 0.0);
        let Plane { weights, bias, .. } = *plane;
        Single { input, taps: &taps, weights, bias, limits: self.limits, count, output }.dispatch();
        for (row, made) in result.chunks_mut(columns).zip(output.chunks(lattice.pitch)) {
            row.copy_from_slice(&made[..columns]);
        }
    }

    /// A depthwise transposed convolution whose kernel is twice as wide as its stride: each cell of the output is made of
    /// two by two cells of the input, by weights that depend on its place in the enlarged cell.
    fn enlarged(&self, plane: &Plane<'_>, result: &mut [f32], scratch: &mut Scratch) {
        let Scratch { input, output } = scratch;
        let Window { kernel, stride: factor, padding, .. } = self.window;
        let Plane { size: [height, width], weights, bias, .. } = *plane;
        // Between the cells, and at both ends.
        let between = Window { kernel: 2, stride: 1, padding: 1, end_padding: 0, dilation: 1 };
        let (rows, columns) = (height + 1, width + 1);
        let lattice = Lattice::new(between, columns);
        lattice.copy_rows(plane.input, plane.size, [0, rows], input);
        let taps = lattice.taps(1, lattice.plane(rows));
        let count = (rows - 1) * lattice.pitch + columns;
        output.resize(count.next_multiple_of(MAX_LANES), 0.0);
        for place in 0..factor * factor {
            let [y, x] = [place / factor, place % factor];
            // The earlier cell is seen through the later half of the kernel.
            let of = [[y + factor, x + factor], [y + factor, x], [y, x + factor], [y, x]];
            let weights = of.map(|[y, x]| weights[y * kernel + x]);
            Single { input, taps: &taps, weights: &weights, bias, limits: self.limits, count, output }.dispatch();
            // Of enlarged cells that begin `padding` before the map.
            let [first_row, first_column] = [y, x].map(|at| usize::from(at < padding));
            let made_rows = output.chunks(lattice.pitch).enumerate().skip(first_row).take(height);
            for (row, made) in made_rows {
                let line = (row * factor + y - padding) * width * factor;
                let start = line + first_column * factor + x - padding;
                let cells = result[start..line + width * factor].iter_mut().step_by(factor);
                for (cell, made) in cells.zip(&made[first_column..]) {
                    *cell = *made;
                }
            }
        }
    }
}

/// Weights of eight output channels together, for each tap; what is left over is zero.
fn blocks(weights: &[f32], taps: usize) -> Vec<[f32; BLOCK]> {
    let mut blocks = Vec::with_capacity(weights.len().div_ceil(BLOCK));
    for channels in weights.chunks(BLOCK * taps) {
        let weight = |channel: usize, tap: usize| channels.get(channel * taps + tap).copied().unwrap_or_default();
        blocks.extend((0..taps).map(|tap| std::array::from_fn(|channel| weight(channel, tap))));
    }
    blocks
}

/// One channel of a depthwise convolution.
struct Plane<'a> {
    input: &'a [f32],
    size: [usize; 2],
    weights: &'a [f32],
    bias: f32,
}

/// Memory of a thread.
#[derive(Debug, Default)]
struct Scratch {
    input: Vec<f32>,
    output: Vec<f32>,
}

/// How an input is laid out: for each remainder of row and column by the stride that taps have, a plane of its own.
struct Lattice {
    window: Window,
    /// Remainders of row and column.
    phases: Vec<[usize; 2]>,
    /// Rows and columns that the last tap is after the first one in its plane.
    reach: usize,
    /// Numbers in a row of a plane.
    pitch: usize,
}

impl Lattice {
    fn new(window: Window, columns: usize) -> Self {
        let Window { kernel, stride, dilation, .. } = window;
        let mut remainders: Vec<usize> = (0..kernel).map(|tap| tap * dilation % stride).collect();
        remainders.sort_unstable();
        remainders.dedup();
        let phases = remainders.iter().flat_map(|&y| remainders.iter().map(move |&x| [y, x])).collect();
        let reach = (kernel - 1) * dilation / stride;
        Self { window, phases, reach, pitch: columns + reach }
    }

    /// Numbers in a plane for so many rows of the output.
    fn plane(&self, rows: usize) -> usize {
        (rows + self.reach) * self.pitch
    }

    /// Where the taps of the first cell are, for each channel and tap, in planes of this size.
    fn taps(&self, channels: usize, plane: usize) -> Vec<usize> {
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
    fn copy_rows(&self, image: &[f32], [height, width]: [usize; 2], [from, to]: [usize; 2], copy: &mut Vec<f32>) {
        let Window { stride, padding, .. } = self.window;
        let plane = self.plane(to - from);
        let channels = image.len() / (height * width);
        let length = channels * self.phases.len() * plane;
        copy.resize(length + VECTORS.max(DEPTHWISE_VECTORS) * MAX_LANES, 0.0);
        let planes = copy[..length].chunks_mut(plane);
        let sources =
            image.chunks(height * width).flat_map(|channel| self.phases.iter().map(move |phase| (channel, phase)));
        for (plane, (channel, &[y, x])) in planes.zip(sources) {
            // Columns of the plane that lie in the image.
            let first = padding.saturating_sub(x).div_ceil(stride).min(self.pitch);
            let end = (width + padding).saturating_sub(x).div_ceil(stride).clamp(first, self.pitch);
            for (row, copied) in plane.chunks_mut(self.pitch).enumerate() {
                let line = ((from + row) * stride + y).checked_sub(padding).filter(|line| *line < height);
                let Some(line) = line else {
                    copied.fill(0.0);
                    continue;
                };
                copied[..first].fill(0.0);
                copied[end..].fill(0.0);
                if first < end {
                    let start = line * width + first * stride + x - padding;
                    let source = &channel[start..(line + 1) * width];
                    if stride == 1 {
                        copied[first..end].copy_from_slice(&source[..end - first]);
                    } else {
                        for (copied, value) in copied[first..end].iter_mut().zip(source.iter().step_by(stride)) {
                            *copied = *value;
                        }
                    }
                }
            }
        }
    }

    /// Copies columns of an image of one row.
    fn copy_columns(&self, image: &[f32], [_, width]: [usize; 2], [from, to]: [usize; 2], copy: &mut Vec<f32>) {
        copy.clear();
        for row in image.chunks(width) {
            copy.extend_from_slice(&row[from..to]);
        }
        copy.resize(copy.len() + VECTORS * MAX_LANES, 0.0);
    }
}

/// Eight channels of a strip.
struct Block<'a> {
    input: &'a [f32],
    taps: &'a [usize],
    weights: &'a [[f32; BLOCK]],
    biases: &'a [f32; BLOCK],
    limits: [f32; 2],
    /// Cells to be computed.
    count: usize,
    /// Numbers from one channel of the output to the next.
    row_length: usize,
    /// Channels that are there.
    used: usize,
    output: &'a mut [f32],
}

impl SimdOp for Block<'_> {
    type Output = ();

    #[inline(always)]
    fn eval<I: Isa>(self, isa: I) {
        let Self { input, taps, weights, biases, limits, count, row_length, used, output } = self;
        let lanes = isa.f32().len();
        // As many sums as there are registers for.
        let has_many = lanes == MAX_LANES || cfg!(target_arch = "aarch64");
        let mut at = 0;
        while at < count {
            let vectors = (count - at).div_ceil(lanes).min(VECTORS);
            let window = Sums { input: &input[at..], taps, limits };
            let output = &mut output[at..];
            if has_many {
                match vectors {
                    3 => window.run::<I, BLOCK, BLOCK, 3>(isa, weights, biases, 0, output, row_length),
                    2 => window.run::<I, BLOCK, BLOCK, 2>(isa, weights, biases, 0, output, row_length),
                    _ => window.run::<I, BLOCK, BLOCK, 1>(isa, weights, biases, 0, output, row_length),
                }
            } else {
                for first in (0..used).step_by(BLOCK / 2) {
                    match vectors {
                        3 => window.run::<I, BLOCK, 4, 3>(isa, weights, biases, first, output, row_length),
                        2 => window.run::<I, BLOCK, 4, 2>(isa, weights, biases, first, output, row_length),
                        _ => window.run::<I, BLOCK, 4, 1>(isa, weights, biases, first, output, row_length),
                    }
                }
            }
            at += vectors * lanes;
        }
    }
}

/// One channel of a depthwise convolution.
struct Single<'a> {
    input: &'a [f32],
    taps: &'a [usize],
    weights: &'a [f32],
    bias: f32,
    limits: [f32; 2],
    count: usize,
    output: &'a mut [f32],
}

impl SimdOp for Single<'_> {
    type Output = ();

    #[inline(always)]
    fn eval<I: Isa>(self, isa: I) {
        let Self { input, taps, weights, bias, limits, count, output } = self;
        let weights = weights.as_chunks::<1>().0;
        let lanes = isa.f32().len();
        let mut at = 0;
        while at < count {
            let vectors = (count - at).div_ceil(lanes);
            let window = Sums { input: &input[at..], taps, limits };
            let output = &mut output[at..];
            let vectors = match vectors {
                DEPTHWISE_VECTORS.. => {
                    window.run::<I, 1, 1, DEPTHWISE_VECTORS>(isa, weights, &[bias], 0, output, 0);
                    DEPTHWISE_VECTORS
                }
                4.. => {
                    window.run::<I, 1, 1, 4>(isa, weights, &[bias], 0, output, 0);
                    4
                }
                _ => {
                    window.run::<I, 1, 1, 1>(isa, weights, &[bias], 0, output, 0);
                    1
                }
            };
            at += vectors * lanes;
        }
    }
}

/// Sums of products that are kept in registers.
#[derive(Clone, Copy)]
struct Sums<'a> {
    input: &'a [f32],
    taps: &'a [usize],
    limits: [f32; 2],
}

impl Sums<'_> {
    /// `VECTORS` vectors of neighbouring cells, of `CHANNELS` of the `WIDTH` channels from `first` on.
    #[inline(always)]
    fn run<I: Isa, const WIDTH: usize, const CHANNELS: usize, const VECTORS: usize>(
        self,
        isa: I,
        weights: &[[f32; WIDTH]],
        biases: &[f32; WIDTH],
        first: usize,
        output: &mut [f32],
        row_length: usize,
    ) {
        let ops = isa.f32();
        let span = VECTORS * ops.len();
        let channels = first..first + CHANNELS;
        let biases = &biases[channels.clone()];
        let mut sums: [[I::F32; VECTORS]; CHANNELS] =
            std::array::from_fn(|channel| [ops.splat(biases[channel]); VECTORS]);
        for (tap, weights) in self.taps.iter().zip(weights) {
            let cells: [I::F32; VECTORS] = ops.load_many(&self.input[*tap..tap + span]);
            for (sums, weight) in sums.iter_mut().zip(&weights[channels.clone()]) {
                let weight = ops.splat(*weight);
                for (sum, cells) in sums.iter_mut().zip(cells) {
                    *sum = ops.mul_add(cells, weight, *sum);
                }
            }
        }
        let [low, high] = self.limits.map(|limit| ops.splat(limit));
        for (channel, sums) in sums.into_iter().enumerate() {
            let row = &mut output[(first + channel) * row_length..][..span];
            for (sum, row) in sums.into_iter().zip(row.chunks_mut(ops.len())) {
                ops.store(ops.min(ops.max(sum, low), high), row);
            }
        }
    }
}

//! Convolutions on the CPU at hand, by its vector instructions.
//!
//! Windows are read where they lie: an input is copied once, with its zeros around, into planes of every `stride`-th
//! row and column. Within these each tap of a window is a fixed distance, whatever the output cell, and a vector of
//! neighbouring cells is one load. rten unrolls windows into a matrix number by number, which takes a third of the
//! time of our networks, and its depthwise convolutions know no vectors.

mod inverted_residual;
mod lattice;
mod sums;

pub(crate) use inverted_residual::InvertedResidual;

use farsight_graph::graph::Window;
use farsight_onnx::{Convolution, ConvolutionKind};
use rayon::prelude::*;
use rten_simd::SimdOp;

use crate::library::Failure;
use lattice::{Lattice, copy_out};
use sums::{BLOCK, Block, MAX_LANES, Single, VECTORS};

/// Numbers that are copied for some rows of the output: they stay in the second-level cache.
const STRIP: usize = 1 << 16;

/// A convolution that is ready to run.
#[derive(Debug)]
pub(crate) struct ConvolutionLayer {
    kind: ConvolutionKind,
    window: Window,
    channels: [usize; 2],
    /// `[block][in, ky, kx]` of a dense one, `[channel][ky, kx]` of the others.
    weights: Weights,
    biases: Vec<f32>,
    limits: [f32; 2],
    /// Whether windows of a dense one are one cell, and every cell has one.
    is_pointwise: bool,
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
        let is_pointwise = convolution.is_pointwise();
        Self { kind: *kind, window: *window, channels, weights, biases, limits: *limits, is_pointwise }
    }

    /// What it makes of `input`, and its shape. Runs in the thread pool of the caller.
    pub(crate) fn run(&self, input: MapView<'_>) -> Result<(Vec<f32>, [usize; 4]), Failure> {
        self.check(input)?;
        let [batch, _, height, width] = input.shape;
        let [_, out] = self.channels;
        let [rows, columns] = self.output_size([height, width])?;
        let mut output = vec![0.0; batch * out * rows * columns];
        let shape = [batch, out, rows, columns];
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

    /// Refuses what it cannot read.
    fn check(&self, input: MapView<'_>) -> Result<(), Failure> {
        let [_, channels, height, width] = input.shape;
        let [expected, _] = self.channels;
        if channels != expected {
            return Err(format!("a map of {channels} channels; expected {expected}").into());
        }
        if input.values.is_empty() {
            return Err(format!("a map of {width}x{height} cells is empty").into());
        }
        Ok(())
    }

    /// Height and width of what it makes of a map of this size.
    fn output_size(&self, [height, width]: [usize; 2]) -> Result<[usize; 2], Failure> {
        if self.kind == ConvolutionKind::Upsampling {
            return Ok([height, width].map(|side| side * self.window.stride));
        }
        let sides = [height, width].map(|side| self.window.output_size(side));
        let [Some(rows), Some(columns)] = sides else {
            return Err(format!("a map of {width}x{height} cells is smaller than a window").into());
        };
        Ok([rows, columns])
    }

    /// Eight output channels of a dense one whose windows are one cell, for `count` cells; the first cell of each
    /// channel is where `taps` say.
    fn block<'a>(&'a self, block: usize, input: &'a [f32], taps: &'a [usize], count: usize) -> Block<'a> {
        let Weights::Blocks(weights) = &self.weights else { unreachable!("a dense convolution") };
        let weights = &weights[block * taps.len()..][..taps.len()];
        let biases = &self.biases.as_chunks::<BLOCK>().0[block];
        Block { input, taps, weights, biases, limits: self.limits, count }
    }

    fn dense(&self, input: MapView<'_>, weights: &[[f32; BLOCK]], output: &mut [f32], [rows, columns]: [usize; 2]) {
        let [_, channels, height, width] = input.shape;
        let [_, out] = self.channels;
        let lattice = Lattice::new(self.window, columns);
        let cells = rows * columns;
        // Ranges of cells; of whole rows, unless a window is one cell.
        let strips: Vec<[usize; 2]> = if self.is_pointwise {
            // What is left over for less than a vector is a strip of its own.
            let whole = cells - cells % MAX_LANES;
            let step = (STRIP / channels.max(1)).next_multiple_of(VECTORS * MAX_LANES);
            let strips = (0..whole).step_by(step).map(|from| [from, whole.min(from + step)]);
            strips.chain((whole < cells).then_some([whole, cells])).collect()
        } else {
            let a_row = lattice.channel(1) * channels / (1 + lattice.reach);
            let step = (STRIP / a_row.max(1)).saturating_sub(lattice.reach).max(lattice.reach.max(1));
            (0..rows).step_by(step).map(|from| [from, rows.min(from + step)].map(|row| row * columns)).collect()
        };
        let mut tasks = Vec::new();
        let images = input.values.chunks(channels * height * width);
        for (image, output) in images.zip(output.chunks_mut(out * cells)) {
            let mut planes: Vec<&mut [f32]> = output.chunks_mut(cells).collect();
            for &[from, to] in &strips {
                let parts = planes.iter_mut().map(|plane| plane.split_off_mut(..to - from).unwrap_or_default());
                tasks.push((image, [from, to], parts.collect::<Vec<_>>()));
            }
        }
        tasks.into_par_iter().for_each_init(Scratch::default, |scratch, (image, [from, to], mut parts)| {
            let Scratch { input, output } = scratch;
            let is_whole = self.is_pointwise && (to - from).is_multiple_of(MAX_LANES);
            // A window of one cell has one row.
            let (input, count, plane, [columns, pitch]) = if is_whole {
                (&image[from..], to - from, cells, [to - from; 2])
            } else if self.is_pointwise {
                copy_cells(image, cells, [from, to], input);
                (&input[..], to - from, to - from, [to - from; 2])
            } else {
                let [from, to] = [from, to].map(|cell| cell / columns);
                lattice.copy_rows(image, [height, width], [from, to], input);
                let count = (to - from - 1) * lattice.pitch + columns;
                (&input[..], count, lattice.plane(to - from), [columns, lattice.pitch])
            };
            let taps = lattice.taps(channels, plane);
            let row_length = count.next_multiple_of(MAX_LANES);
            output.resize(BLOCK * row_length, 0.0);
            let blocks = weights.chunks(taps.len()).zip(self.biases.as_chunks::<BLOCK>().0);
            for ((weights, biases), parts) in blocks.zip(parts.chunks_mut(BLOCK)) {
                let block = Block { input, taps: &taps, weights, biases, limits: self.limits, count };
                if is_whole {
                    block.run(parts);
                    continue;
                }
                let mut made: Vec<&mut [f32]> = output.chunks_mut(row_length).take(parts.len()).collect();
                block.run(&mut made);
                for (part, made) in parts.iter_mut().zip(made) {
                    copy_out(made, pitch, part, columns);
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
        copy_out(output, lattice.pitch, result, columns);
    }

    /// A depthwise transposed convolution whose kernel is twice as wide as its stride: each cell of the output is made
    /// of two by two cells of the input, by weights that depend on its place in the enlarged cell.
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

/// Copies some cells of all channels.
fn copy_cells(image: &[f32], plane: usize, [from, to]: [usize; 2], copy: &mut Vec<f32>) {
    copy.clear();
    for channel in image.chunks(plane) {
        copy.extend_from_slice(&channel[from..to]);
    }
    copy.resize(copy.len() + VECTORS * MAX_LANES, 0.0);
}

#[cfg(test)]
pub(crate) mod tests {
    use farsight_graph::weights::WeightTensor;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    pub(super) fn numbers(random: &mut Pcg64Mcg, count: usize) -> Vec<f32> {
        (0..count).map(|_| random.random_range(-1.0..1.0)).collect()
    }

    pub(super) fn convolution(
        random: &mut Pcg64Mcg,
        kind: ConvolutionKind,
        channels: [usize; 2],
        window: Window,
    ) -> Convolution {
        let [of_group, out] = channels;
        let shape = vec![out, of_group, window.kernel, window.kernel];
        let weight = WeightTensor::new(shape.clone(), numbers(random, shape.iter().product())).unwrap();
        let limits = if random.random() { [0.0, 1.0] } else { [f32::NEG_INFINITY, f32::INFINITY] };
        let [input, output] = ["x", "y"].map(str::to_owned);
        Convolution { input, output, kind, window, weight, bias: numbers(random, out), limits }
    }

    /// Sums in double precision, cell by cell; transposed ones by where each cell of the input goes.
    fn expected(convolution: &Convolution, input: MapView<'_>, [rows, columns]: [usize; 2]) -> Vec<f64> {
        let Convolution { kind, window, weight, bias, limits, .. } = convolution;
        let Window { kernel, stride, padding, dilation, .. } = *window;
        let [batch, channels, height, width] = input.shape;
        let [out, of_group] = [weight.shape[0], weight.shape[1]];
        let mut sums = vec![0.0; batch * out * rows * columns];
        for ((image, to), (ky, kx)) in (0..batch)
            .flat_map(|image| (0..out).map(move |to| (image, to)))
            .flat_map(|place| (0..kernel * kernel).map(move |tap| (place, (tap / kernel, tap % kernel))))
        {
            let from = if *kind == ConvolutionKind::Dense { 0..channels } else { to..to + 1 };
            for (group, from) in from.enumerate() {
                let weight = f64::from(weight.values[((to * of_group + group) * kernel + ky) * kernel + kx]);
                let source =
                    |y: usize, x: usize| f64::from(input.values[((image * channels + from) * height + y) * width + x]);
                let mut add = |y: usize, x: usize, value: f64| {
                    sums[((image * out + to) * rows + y) * columns + x] += weight * value;
                };
                if *kind == ConvolutionKind::Upsampling {
                    for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
                        let at = [(y * stride + ky).checked_sub(padding), (x * stride + kx).checked_sub(padding)];
                        if let [Some(row), Some(column)] = at
                            && row < rows
                            && column < columns
                        {
                            add(row, column, source(y, x));
                        }
                    }
                    continue;
                }
                for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
                    let at = [row * stride + ky * dilation, column * stride + kx * dilation];
                    if let [Some(y), Some(x)] = at.map(|place| place.checked_sub(padding))
                        && y < height
                        && x < width
                    {
                        add(row, column, source(y, x));
                    }
                }
            }
        }
        let biased = sums.chunks_mut(rows * columns).zip(bias.iter().cycle());
        for (plane, bias) in biased {
            for sum in plane {
                *sum = (*sum + f64::from(*bias)).clamp(f64::from(limits[0]), f64::from(limits[1]));
            }
        }
        sums
    }

    #[test]
    fn all_windows_are_sums_of_products() {
        let mut random = Pcg64Mcg::seed_from_u64(29);
        let kinds = [ConvolutionKind::Dense, ConvolutionKind::Depthwise, ConvolutionKind::Upsampling];
        let mut computed = 0;
        for round in 0..600 {
            let kind = kinds[round % 3];
            let mut below = |most: usize| random.random_range(0..most);
            let [batch, height, width] = [1 + below(3), 1 + below(20), 1 + below(70)];
            let (from, out) =
                if kind == ConvolutionKind::Dense { (1 + below(20), 1 + below(20)) } else { (1, 1 + below(9)) };
            let window = if kind == ConvolutionKind::Upsampling {
                let stride = 2 * (1 + below(3));
                Window { kernel: 2 * stride, stride, padding: stride / 2, end_padding: 0, dilation: 1 }
            } else {
                let kernel = 1 + below(7);
                let [stride, dilation] = [1 + below(3), 1 + below(3)];
                Window { kernel, stride, padding: below(5), end_padding: below(2), dilation }
            };
            let convolution = convolution(&mut random, kind, [from, out], window);
            let channels = if kind == ConvolutionKind::Dense { from } else { out };
            let values = numbers(&mut random, batch * channels * height * width);
            let input = MapView { shape: [batch, channels, height, width], values: &values };
            let fits = [height, width].iter().all(|side| window.output_size(*side).is_some());
            let made = ConvolutionLayer::new(&convolution).run(input);
            if kind != ConvolutionKind::Upsampling && !fits {
                let told = made.unwrap_err().to_string();
                assert_eq!(told, format!("a map of {width}x{height} cells is smaller than a window"));
                continue;
            }
            let (made, [_, _, rows, columns]) = made.unwrap();
            let expected = expected(&convolution, input, [rows, columns]);
            assert_eq!(made.len(), expected.len());
            let error = made.iter().zip(expected).map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max);
            assert!(error < 1e-4, "{kind:?} {window:?} of {:?}: {error}", input.shape);
            computed += 1;
        }
        assert!(computed > 500, "{computed} of 600 windows fitted");
    }

    #[test]
    fn large_maps_are_cut_into_strips() {
        let mut random = Pcg64Mcg::seed_from_u64(30);
        for (channels, size, kernel, stride) in [(64, [24, 70], 3, 1), (3, [150, 411], 3, 2), (256, [19, 31], 1, 1)] {
            let window = Window::same(kernel, stride);
            let convolution = convolution(&mut random, ConvolutionKind::Dense, [channels, 9], window);
            let values = numbers(&mut random, channels * size[0] * size[1]);
            let input = MapView { shape: [1, channels, size[0], size[1]], values: &values };
            let (made, [_, _, rows, columns]) = ConvolutionLayer::new(&convolution).run(input).unwrap();
            let expected = expected(&convolution, input, [rows, columns]);
            let error = made.iter().zip(expected).map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max);
            assert!(error < 1e-4, "{window:?} of {:?}: {error}", input.shape);
        }
    }

    /// A limit must not hide that a network overflows.
    #[test]
    fn what_is_no_number_stays_none() {
        let mut random = Pcg64Mcg::seed_from_u64(33);
        let mut convolution = convolution(&mut random, ConvolutionKind::Dense, [1, 1], Window::same(1, 1));
        convolution.limits = [0.0, 6.0];
        let values = [0.0, f32::NAN, 0.0, 0.0];
        let (made, _) =
            ConvolutionLayer::new(&convolution).run(MapView { shape: [1, 1, 2, 2], values: &values }).unwrap();
        assert_eq!(made.iter().map(|value| value.is_nan()).collect::<Vec<_>>(), [false, true, false, false]);
    }

    #[test]
    fn maps_of_other_shapes_are_refused() {
        let mut random = Pcg64Mcg::seed_from_u64(31);
        let layer =
            ConvolutionLayer::new(&convolution(&mut random, ConvolutionKind::Dense, [3, 2], Window::same(3, 1)));
        let told = |shape: [usize; 4]| {
            let values = vec![0.0; shape.iter().product()];
            layer.run(MapView { shape, values: &values }).unwrap_err().to_string()
        };
        assert_eq!(told([1, 4, 8, 8]), "a map of 4 channels; expected 3");
        assert_eq!(told([1, 3, 0, 8]), "a map of 8x0 cells is empty");
    }
}

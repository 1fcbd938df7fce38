//! Inverted residuals (`MobileNetV2`): expansion, depthwise convolution and projection in one.
//!
//! The expanded map has six times the channels, and more numbers than all else of a network. Here it is made row by
//! row, where it is read at once: it needs no memory of its own, and hardly leaves the cache. Sums are the same as
//! those of the three convolutions.

use std::ops::Range;

use farsight_onnx::ConvolutionKind;
use rayon::prelude::*;
use rten_simd::SimdOp;

use super::lattice::{Lattice, Rows, copy_out};
use super::sums::{BLOCK, MAX_LANES, PADDING, Single};
use super::{ConvolutionLayer, MapView, Weights, copy_cells};
use crate::library::Failure;

/// Numbers of the map between depthwise convolution and projection that are made together: they stay in the
/// second-level cache.
const STRIP: usize = 1 << 17;

/// An inverted residual without its sum, or a depthwise separable convolution.
#[derive(Debug)]
pub(crate) struct InvertedResidual {
    expansion: Option<ConvolutionLayer>,
    depthwise: ConvolutionLayer,
    projection: ConvolutionLayer,
}

impl InvertedResidual {
    /// Convolutions that follow each other; the first and the last one have windows of one cell.
    pub(crate) fn new(
        expansion: Option<ConvolutionLayer>,
        depthwise: ConvolutionLayer,
        projection: ConvolutionLayer,
    ) -> Self {
        debug_assert!(depthwise.kind == ConvolutionKind::Depthwise && projection.is_pointwise, "not of this kind");
        Self { expansion, depthwise, projection }
    }

    /// What it makes of `input`, and its shape. Runs in the thread pool of the caller.
    pub(crate) fn run(&self, input: MapView<'_>) -> Result<(Vec<f32>, [usize; 4]), Failure> {
        let [batch, channels, height, width] = input.shape;
        self.expansion.as_ref().unwrap_or(&self.depthwise).check(input)?;
        let [rows, columns] = self.depthwise.output_size([height, width])?;
        let [_, out] = self.projection.channels;
        let mut output = vec![0.0; batch * out * rows * columns];
        let lattice = Lattice::new(self.depthwise.window, columns);
        // Neighbouring ranges make some rows twice, so there are no more of them than threads.
        let range = rows.div_ceil(rayon::current_num_threads());
        let step = (STRIP / (self.depthwise.channels[1] * lattice.pitch)).clamp(1, range);
        let mut tasks = Vec::new();
        let images = input.values.chunks(channels * height * width);
        for (image, output) in images.zip(output.chunks_mut(out * rows * columns)) {
            let mut planes: Vec<&mut [f32]> = output.chunks_mut(rows * columns).collect();
            for from in (0..rows).step_by(range) {
                let cells = (rows.min(from + range) - from) * columns;
                let parts = planes.iter_mut().map(|plane| plane.split_off_mut(..cells).unwrap_or_default());
                tasks.push((image, from, parts.collect::<Vec<_>>()));
            }
        }
        tasks.into_par_iter().for_each_init(Scratch::default, |scratch, (image, first, mut parts)| {
            let strips = Strips { block: self, lattice: &lattice, image, size: [height, width], columns, step };
            strips.run(first, &mut parts, scratch);
        });
        Ok((output, [batch, out, rows, columns]))
    }
}

/// Memory of a thread.
#[derive(Debug, Default)]
struct Scratch {
    /// Cells of the input.
    input: Vec<f32>,
    /// Eight channels of the expanded map.
    expanded: Vec<f32>,
    /// What the depthwise convolution reads, of all channels.
    planes: Vec<f32>,
    /// What it makes of it.
    middle: Vec<f32>,
    /// Eight channels of the output.
    output: Vec<f32>,
}

/// The rows of one image, `step` of the output at a time.
struct Strips<'a> {
    block: &'a InvertedResidual,
    lattice: &'a Lattice,
    image: &'a [f32],
    /// Height and width of the image.
    size: [usize; 2],
    /// Of the output.
    columns: usize,
    step: usize,
}

impl Strips<'_> {
    /// Makes the rows of the output from `first` on, as many as `parts` has in each of its planes.
    fn run(&self, first: usize, parts: &mut [&mut [f32]], scratch: &mut Scratch) {
        let [depth, _] = self.block.projection.channels;
        let Lattice { pitch, reach, .. } = *self.lattice;
        let rows = parts.first().map_or(0, |part| part.len() / self.columns);
        scratch.planes.resize(depth * self.lattice.channel(self.step) + PADDING, 0.0);
        for from in (0..rows).step_by(self.step) {
            let count = self.step.min(rows - from);
            // The first rows of the planes are the last ones of the strip before.
            let known = if from == 0 { 0 } else { reach };
            let cells = (count - 1) * pitch + self.columns;
            let middle_row = cells.next_multiple_of(MAX_LANES);
            scratch.middle.resize(depth * middle_row, 0.0);
            self.make_middle(first + from, [known, count + reach], cells, scratch);
            self.project(cells, scratch, parts, from * self.columns..(from + count) * self.columns);
        }
    }

    /// Expansion and depthwise convolution: `cells` of each channel, whose planes have the first `known` of `rows`.
    fn make_middle(&self, from: usize, [known, rows]: [usize; 2], cells: usize, scratch: &mut Scratch) {
        let Scratch { input, expanded, planes, middle, .. } = scratch;
        let InvertedResidual { expansion, depthwise, .. } = self.block;
        let Weights::Single(weights) = &depthwise.weights else { return };
        let [height, width] = self.size;
        let a_channel = self.lattice.channel(self.step);
        let taps = self.lattice.taps(1, self.lattice.plane(self.step));
        let lines = self.lattice.lines(from, known..rows, height);
        let read = lines.len() * width;
        let span = [lines.start * width, lines.end * width];
        if expansion.is_some() {
            copy_cells(self.image, height * width, span, input);
        }
        let depth = expansion.as_ref().map_or(0, |layer| layer.channels[0]);
        let cells_of: Vec<usize> = (0..depth).map(|channel| channel * read).collect();
        let row_length = read.next_multiple_of(MAX_LANES);
        let middle_row = cells.next_multiple_of(MAX_LANES);
        for (block, outputs) in middle.chunks_mut(BLOCK * middle_row).enumerate() {
            if let Some(layer) = expansion {
                expanded.resize(BLOCK * row_length, 0.0);
                let mut made: Vec<&mut [f32]> = expanded.chunks_mut(row_length.max(1)).collect();
                layer.block(block, input, &cells_of, read).run(&mut made);
            }
            for (place, output) in outputs.chunks_mut(middle_row).enumerate() {
                let channel = block * BLOCK + place;
                let values = match expansion {
                    Some(_) => &expanded[place * row_length..][..read],
                    None => &self.image[channel * height * width..][span[0]..span[1]],
                };
                let planes = &mut planes[channel * a_channel..];
                if known > 0 {
                    self.lattice.carry(&mut planes[..a_channel], self.step);
                }
                let source = Rows { values, first: lines.start, size: self.size };
                self.lattice.fill(source, &mut planes[..a_channel], from, known..rows);
                let weights = &weights[channel * taps.len()..][..taps.len()];
                let (bias, limits) = (depthwise.biases[channel], depthwise.limits);
                Single { input: planes, taps: &taps, weights, bias, limits, count: cells, output }.dispatch();
            }
        }
    }

    /// The projection of the `cells` in the middle; `range` is where its rows are in each of `parts`.
    fn project(&self, cells: usize, scratch: &mut Scratch, parts: &mut [&mut [f32]], range: Range<usize>) {
        let Scratch { middle, output, .. } = scratch;
        let row_length = cells.next_multiple_of(MAX_LANES);
        let taps: Vec<usize> = (0..self.block.projection.channels[0]).map(|channel| channel * row_length).collect();
        output.resize(BLOCK * row_length, 0.0);
        for (block, parts) in parts.chunks_mut(BLOCK).enumerate() {
            let mut made: Vec<&mut [f32]> = output.chunks_mut(row_length).take(parts.len()).collect();
            self.block.projection.block(block, middle, &taps, cells).run(&mut made);
            for (part, made) in parts.iter_mut().zip(made) {
                copy_out(made, self.lattice.pitch, &mut part[range.clone()], self.columns);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use farsight_graph::graph::Window;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;
    use rayon::ThreadPoolBuilder;

    use super::*;
    use crate::convolution::tests::{convolution, numbers};

    /// Sums are added up in the same order, so they are the same to the last bit.
    #[test]
    fn it_is_its_three_convolutions() {
        let mut random = Pcg64Mcg::seed_from_u64(34);
        let pools = [1, 3].map(|threads| ThreadPoolBuilder::new().num_threads(threads).build().unwrap());
        let mut computed = 0;
        for round in 0..300 {
            let mut below = |most: usize| random.random_range(0..most);
            let [batch, height, width] = [1 + below(2), 1 + below(40), 1 + below(90)];
            // With many channels a strip is a few rows.
            let depth = if round % 10 == 0 { 500 + below(500) } else { 1 + below(40) };
            let [from, out] = [1 + below(20), 1 + below(20)];
            let kernel = 1 + below(5);
            let [stride, dilation] = [1 + below(3), 1 + below(2)];
            let window = Window { kernel, stride, padding: below(4), end_padding: below(2), dilation };
            let point = Window::same(1, 1);
            let mut layer = |kind, channels, window| {
                let convolution = convolution(&mut random, kind, channels, window);
                [(); 2].map(|()| ConvolutionLayer::new(&convolution))
            };
            let [expansion, expansion_alone] = layer(ConvolutionKind::Dense, [from, depth], point);
            let [depthwise, depthwise_alone] = layer(ConvolutionKind::Depthwise, [1, depth], window);
            let [projection, projection_alone] = layer(ConvolutionKind::Dense, [depth, out], point);
            let is_expanded = round % 3 > 0;
            let channels = if is_expanded { from } else { depth };
            let values = numbers(&mut random, batch * channels * height * width);
            let input = MapView { shape: [batch, channels, height, width], values: &values };
            let (wide, shape) =
                if is_expanded { expansion_alone.run(input).unwrap() } else { (values.clone(), input.shape) };
            let block = InvertedResidual::new(is_expanded.then_some(expansion), depthwise, projection);
            let middle = depthwise_alone.run(MapView { shape, values: &wide });
            let Ok((middle, shape)) = middle else {
                assert_eq!(block.run(input).unwrap_err().to_string(), middle.unwrap_err().to_string());
                continue;
            };
            let (expected, shape) = projection_alone.run(MapView { shape, values: &middle }).unwrap();
            for pool in &pools {
                let (made, made_shape) = pool.install(|| block.run(input)).unwrap();
                assert_eq!(made_shape, shape);
                assert!(made == expected, "{window:?} of {:?}, {depth} channels between", input.shape);
            }
            computed += 1;
        }
        assert!(computed > 200, "{computed} of 300 windows fitted");
    }
}

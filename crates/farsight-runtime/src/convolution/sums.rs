//! Sums of products by vector instructions.

use rten_simd::ops::{BitOps, NumOps};
use rten_simd::{Isa, SimdOp};

/// Output channels that are computed together.
pub(super) const BLOCK: usize = 8;

/// Vectors of cells that are computed together.
pub(super) const VECTORS: usize = 3;

/// The same of a depthwise convolution, where a tap is one number.
const DEPTHWISE_VECTORS: usize = 8;

/// Lanes of the widest vectors.
pub(super) const MAX_LANES: usize = 16;

/// So many products are added up one after the other: rounding grows with their number.
const SUMMANDS: usize = 256;

/// Numbers that are read after the last one of an input.
pub(super) const PADDING: usize = DEPTHWISE_VECTORS * MAX_LANES;

/// At most eight channels of a strip.
#[derive(Clone, Copy)]
pub(super) struct Block<'a> {
    pub(super) input: &'a [f32],
    pub(super) taps: &'a [usize],
    pub(super) weights: &'a [[f32; BLOCK]],
    pub(super) biases: &'a [f32; BLOCK],
    pub(super) limits: [f32; 2],
    /// Cells to be computed.
    pub(super) count: usize,
}

impl Block<'_> {
    /// Computes the channels that there are rows for.
    pub(super) fn run(self, rows: &mut [&mut [f32]]) {
        BlockInto { block: self, rows }.dispatch();
    }
}

pub(super) struct BlockInto<'a, 'b, 'c> {
    pub(super) block: Block<'a>,
    pub(super) rows: &'b mut [&'c mut [f32]],
}

impl SimdOp for BlockInto<'_, '_, '_> {
    type Output = ();

    #[expect(clippy::inline_always, reason = "vectors are registers only inside of what is compiled for them")]
    #[inline(always)]
    fn eval<I: Isa>(self, isa: I) {
        let Self { block: Block { input, taps, weights, biases, limits, count }, rows } = self;
        let lanes = isa.f32().len();
        // As many sums as there are registers for.
        let has_many = lanes == MAX_LANES || cfg!(target_arch = "aarch64");
        let mut at = 0;
        while at < count {
            let vectors = (count - at).div_ceil(lanes).min(VECTORS);
            let sums = Sums { input: &input[at..], taps, limits, at };
            if has_many {
                match vectors {
                    3 => sums.run::<I, BLOCK, BLOCK, 3>(isa, weights, biases, 0, rows),
                    2 => sums.run::<I, BLOCK, BLOCK, 2>(isa, weights, biases, 0, rows),
                    _ => sums.run::<I, BLOCK, BLOCK, 1>(isa, weights, biases, 0, rows),
                }
            } else {
                for first in (0..rows.len()).step_by(BLOCK / 2) {
                    match vectors {
                        3 => sums.run::<I, BLOCK, 4, 3>(isa, weights, biases, first, rows),
                        2 => sums.run::<I, BLOCK, 4, 2>(isa, weights, biases, first, rows),
                        _ => sums.run::<I, BLOCK, 4, 1>(isa, weights, biases, first, rows),
                    }
                }
            }
            at += vectors * lanes;
        }
    }
}

/// One channel of a depthwise convolution.
pub(super) struct Single<'a> {
    pub(super) input: &'a [f32],
    pub(super) taps: &'a [usize],
    pub(super) weights: &'a [f32],
    pub(super) bias: f32,
    pub(super) limits: [f32; 2],
    pub(super) count: usize,
    pub(super) output: &'a mut [f32],
}

impl SimdOp for Single<'_> {
    type Output = ();

    #[expect(clippy::inline_always, reason = "vectors are registers only inside of what is compiled for them")]
    #[inline(always)]
    fn eval<I: Isa>(self, isa: I) {
        let Self { input, taps, weights, bias, limits, count, output } = self;
        let weights = weights.as_chunks::<1>().0;
        let lanes = isa.f32().len();
        let rows = &mut [output];
        let mut at = 0;
        while at < count {
            let sums = Sums { input: &input[at..], taps, limits, at };
            let vectors = match (count - at).div_ceil(lanes) {
                DEPTHWISE_VECTORS.. => {
                    sums.run::<I, 1, 1, DEPTHWISE_VECTORS>(isa, weights, &[bias], 0, rows);
                    DEPTHWISE_VECTORS
                }
                4.. => {
                    sums.run::<I, 1, 1, 4>(isa, weights, &[bias], 0, rows);
                    4
                }
                _ => {
                    sums.run::<I, 1, 1, 1>(isa, weights, &[bias], 0, rows);
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
    /// Where they belong in the rows.
    at: usize,
}

impl Sums<'_> {
    /// `VECTORS` vectors of neighbouring cells, of `CHANNELS` of the `WIDTH` channels from `first` on.
    #[expect(clippy::inline_always, reason = "vectors are registers only inside of what is compiled for them")]
    #[inline(always)]
    fn run<I: Isa, const WIDTH: usize, const CHANNELS: usize, const VECTORS: usize>(
        self,
        isa: I,
        weights: &[[f32; WIDTH]],
        biases: &[f32; WIDTH],
        first: usize,
        rows: &mut [&mut [f32]],
    ) {
        let ops = isa.f32();
        let span = VECTORS * ops.len();
        let channels = first..first + CHANNELS;
        let [low, high] = self.limits.map(|limit| ops.splat(limit));
        let biases = &biases[channels.clone()];
        let rows = &mut rows[first..];
        let parts = self.taps.chunks(SUMMANDS).zip(weights.chunks(SUMMANDS));
        let last = parts.len() - 1;
        for (place, (taps, weights)) in parts.enumerate() {
            let mut sums: [[I::F32; VECTORS]; CHANNELS] = std::array::from_fn(|channel| {
                [if place == 0 { ops.splat(biases[channel]) } else { ops.zero() }; VECTORS]
            });
            for (tap, weights) in taps.iter().zip(weights) {
                let cells: [I::F32; VECTORS] = ops.load_many(&self.input[*tap..tap + span]);
                for (sums, weight) in sums.iter_mut().zip(&weights[channels.clone()]) {
                    let weight = ops.splat(*weight);
                    for (sum, cells) in sums.iter_mut().zip(cells) {
                        *sum = ops.mul_add(cells, weight, *sum);
                    }
                }
            }
            for (row, sums) in rows.iter_mut().zip(sums) {
                let row = &mut row[self.at..][..span];
                for (mut sum, row) in sums.into_iter().zip(row.chunks_mut(ops.len())) {
                    if place > 0 {
                        sum = ops.add(ops.load(row), sum);
                    }
                    if place == last {
                        // In this order what is no number stays none.
                        sum = ops.min(high, ops.max(low, sum));
                    }
                    ops.store(sum, row);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;
    use crate::convolution::tests::numbers;

    /// Machines with narrow vectors have fewer sums at once.
    #[test]
    fn all_vectors_give_the_same_sums() {
        let mut random = Pcg64Mcg::seed_from_u64(32);
        let (count, taps) = (37, [0, 1, 2, 50, 51, 52]);
        let input = numbers(&mut random, 50 + 48 + 52);
        let weights: Vec<[f32; BLOCK]> =
            (0..taps.len()).map(|_| std::array::from_fn(|_| random.random_range(-1.0..1.0))).collect();
        let biases = [0.5; BLOCK];
        let block = Block { input: &input, taps: &taps, weights: &weights, biases: &biases, limits: [0.0, 6.0], count };
        for channels in [BLOCK, 3] {
            let mut results = [(); 3].map(|()| vec![vec![0.0; 48]; channels]);
            let [by_widest, by_plain, by_avx2] = &mut results;
            let rows = |rows: &mut Vec<Vec<f32>>, run: &dyn Fn(&mut [&mut [f32]])| {
                run(&mut rows.iter_mut().map(Vec::as_mut_slice).collect::<Vec<_>>());
            };
            rows(by_widest, &|rows| block.run(rows));
            rows(by_plain, &|rows| BlockInto { block, rows }.eval(rten_simd::isa::GenericIsa::new()));
            by_avx2.clone_from(by_plain);
            #[cfg(target_arch = "x86_64")]
            if let Some(isa) = rten_simd::isa::Avx2Isa::new() {
                rows(by_avx2, &|rows| BlockInto { block, rows }.eval(isa));
            }
            for (row, cell) in (0..channels).flat_map(|row| (0..count).map(move |cell| (row, cell))) {
                let [a, b, c] = results.each_ref().map(|rows| rows[row][cell]);
                assert!((a - b).abs() < 1e-5 && (a - c).abs() < 1e-5, "row {row}, cell {cell}: {a}, {b} and {c}");
            }
        }
    }
}

//! Numbers in 8 bits, as ONNX writes them (QDQ form).

use crate::parts::{Parts, convolution, int, word};
use farsight_graph::graph::Window;
use farsight_graph::quantize::{QuantizedWeights, Range, WeightRange};

/// The value `x` rounded to the 256 numbers of `range`; returns the name of the result.
///
/// Maps are unsigned and weights signed: the pairing that processors have an instruction for.
pub(super) fn rounded(parts: &mut Parts, x: &str, range: Range) -> String {
    let scale = parts.floats(&format!("scale {:e}", range.scale()), &[], &[range.scale()]);
    let zero = parts.byte(range.zero_point());
    let quantized = parts.node("QuantizeLinear", &[x, &scale, &zero], &format!("{x}/quantized"), Vec::new());
    parts.node("DequantizeLinear", &[&quantized, &scale, &zero], &format!("{x}/rounded"), Vec::new())
}

/// A weight whose first axis are the output channels, each with its own scale.
pub(super) fn weight(parts: &mut Parts, name: &str, shape: &[usize], weights: &QuantizedWeights) -> String {
    let values = parts.bytes(&format!("{name}/quantized"), shape, &weights.values);
    let scale = parts.floats(&format!("{name}/scale"), &[weights.scales.len()], &weights.scales);
    let zeros = vec![0; weights.scales.len()];
    let zero = parts.bytes(&format!("{name}/zero"), &[zeros.len()], &zeros);
    parts.node("DequantizeLinear", &[&values, &scale, &zero], &format!("{name}/rounded"), vec![int("axis", 0)])
}

/// The bias that goes with [`weight`].
pub(super) fn bias(parts: &mut Parts, name: &str, weights: &QuantizedWeights) -> String {
    let values = parts.words(&format!("{name}/quantized"), &[weights.bias.len()], &weights.bias);
    let scale = parts.floats(&format!("{name}/scale"), &[weights.bias_scales.len()], &weights.bias_scales);
    let zeros = vec![0; weights.bias.len()];
    let zero = parts.words(&format!("{name}/zero"), &[zeros.len()], &zeros);
    parts.node("DequantizeLinear", &[&values, &scale, &zero], &format!("{name}/rounded"), vec![int("axis", 0)])
}

/// Learnt upsampling, which no engine has in 8 bits: a depthwise convolution makes a map for each position within an
/// enlarged cell, and these are then interleaved.
pub(super) struct UpConv<'a> {
    /// The map, in 8 bits.
    pub(super) x: &'a str,
    /// Name of the weight.
    pub(super) name: &'a str,
    /// See [`phases`].
    pub(super) kernels: &'a [f32],
    pub(super) channels: usize,
    pub(super) factor: usize,
    pub(super) weights: WeightRange,
}

impl UpConv<'_> {
    /// Writes it; the ranges are those of the map and of the result.
    pub(super) fn write(&self, parts: &mut Parts, [input, output]: [Range; 2], out: &str) -> String {
        let Self { x, name, kernels, channels, factor, weights } = *self;
        let (copies, window) = (factor * factor, Window::same(3, 1));
        let groups = copies * channels;
        let copied = parts.node("Concat", &vec![x; copies], &format!("{out}/copies"), vec![int("axis", 1)]);
        let copied = rounded(parts, &copied, input);
        let weights = QuantizedWeights::new(kernels, &[], groups, input.scale(), weights);
        let weight = weight(parts, name, &[groups, 1, 3, 3], &weights);
        let phases = parts.node("Conv", &[&copied, &weight], &format!("{out}/phases"), convolution(window, groups));
        let phases = rounded(parts, &phases, output);
        let how = vec![int("blocksize", factor as i64), word("mode", "DCR")];
        parts.node("DepthToSpace", &[&phases], out, how)
    }
}

/// The kernels `[factor factor channels, 1, 3, 3]` that make the maps for all positions (row by row) within enlarged
/// cells, from that of a transposed convolution, `[channels, 1, 2 factor, 2 factor]`, stride `factor`, padding
/// `factor / 2`.
///
/// An enlarged cell sees the cell it lies in and the neighbours that are nearest to it, so three cells a side are
/// enough.
pub(super) fn phases(weight: &[f32], factor: usize) -> Vec<f32> {
    let side = 2 * factor;
    let mut kernels = Vec::with_capacity(weight.len() / side / side * factor * factor * 9);
    for position in 0..factor * factor {
        for kernel in weight.chunks_exact(side * side) {
            for tap in 0..9 {
                // Output `factor i + p` reads input `i + d` with the kernel's row `p + factor / 2 - factor d`.
                let row = (position / factor + factor / 2 + factor).checked_sub(factor * (tap / 3));
                let column = (position % factor + factor / 2 + factor).checked_sub(factor * (tap % 3));
                let inside = row.zip(column).filter(|&(row, column)| row < side && column < side);
                kernels.push(inside.map_or(0.0, |(row, column)| kernel[row * side + column]));
            }
        }
    }
    kernels
}

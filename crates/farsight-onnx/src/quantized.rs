//! Numbers in 8 bits, as ONNX writes them (QDQ form).

use crate::Target;
use crate::parts::{Parts, convolution, int, ints, word};
use farsight_graph::graph::Window;
use farsight_graph::quantize::{QuantizedWeights, Range, WeightRange};

/// The value `x` rounded to the 256 numbers of `range`; returns the name of the result.
///
/// Maps are unsigned and weights signed: the pairing that processors have an instruction for.
pub(super) fn rounded(parts: &mut Parts, x: &str, range: Range) -> String {
    let scale = parts.floats(&format!("scale {:e}", range.scale()), &[], &[range.scale()]);
    let zero = parts.byte(range.zero_point());
    let bytes = parts.node("QuantizeLinear", &[x, &scale, &zero], &quantized(x), Vec::new());
    parts.node("DequantizeLinear", &[&bytes, &scale, &zero], &format!("{x}/rounded"), Vec::new())
}

/// The name of the bytes that [`rounded`] makes of `x`.
fn quantized(x: &str) -> String {
    format!("{x}/quantized")
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
    pub(super) target: Target,
}

impl UpConv<'_> {
    /// Writes it; the ranges are those of the map and of the result.
    pub(super) fn write(&self, parts: &mut Parts, [input, output]: [Range; 2], out: &str) -> String {
        let Self { x, name, kernels, channels, factor, weights, target } = *self;
        let (copies, window) = (factor * factor, Window::same(3, 1));
        let groups = copies * channels;
        let copied = parts.node("Concat", &vec![x; copies], &format!("{out}/copies"), vec![int("axis", 1)]);
        let copied = rounded(parts, &copied, input);
        let weights = QuantizedWeights::new(kernels, &[], groups, input.scale(), weights);
        let weight = weight(parts, name, &[groups, 1, 3, 3], &weights);
        let phases = parts.node("Conv", &[&copied, &weight], &format!("{out}/phases"), convolution(window, groups));
        let phases = rounded(parts, &phases, output);
        match target {
            Target::Portable => {
                let how = vec![int("blocksize", factor as i64), word("mode", "DCR")];
                parts.node("DepthToSpace", &[&phases], out, how)
            }
            Target::OnnxRuntime => self.interleaved(parts, &phases, out),
        }
    }

    /// What `DepthToSpace` makes, in a third of the time that it takes ONNX Runtime: two moves of one axis each, the
    /// second of which copies whole rows.
    fn interleaved(&self, parts: &mut Parts, phases: &str, out: &str) -> String {
        let step = |part: &str| format!("{out}/{part}");
        let [factor, channels] = [self.factor, self.channels].map(|value| value as i64);
        // Of the bytes: that of what is made of them would make them floats.
        let shape = parts.node("Shape", &[&quantized(&step("phases"))], &step("shape"), Vec::new());
        let [from, to, times] = [3, 4, factor].map(|number| parts.list(&[number]));
        let width = parts.node("Slice", &[&shape, &from, &to], &step("width"), Vec::new());
        let row = parts.node("Mul", &[&width, &times], &step("row"), Vec::new());
        let mut with_rows = |sides: &[i64], part: &str| {
            let sides = parts.list(sides);
            parts.node("Concat", &[&sides, &row], &step(part), vec![int("axis", 0)])
        };
        let (rows, shape) = (with_rows(&[0, factor, -1], "row_shape"), with_rows(&[0, channels, -1], "map_shape"));
        let positions = parts.list(&[0, factor, factor, -1]);
        let split = parts.node("Reshape", &[phases, &positions], &step("positions"), Vec::new());
        let columns = parts.node("Transpose", &[&split], &step("columns"), vec![ints("perm", &[0, 1, 3, 2])]);
        let rows = parts.node("Reshape", &[&columns, &rows], &step("rows"), Vec::new());
        let rows = parts.node("Transpose", &[&rows], &step("interleaved"), vec![ints("perm", &[0, 2, 1, 3])]);
        parts.node("Reshape", &[&rows, &shape], out, Vec::new())
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

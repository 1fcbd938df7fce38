//! The deformable convolution, in two forms.

use crate::parts::{Parts, int, ints, word};
use crate::proto::AttributeProto;
use farsight_graph::graph::Window;

/// Names of what a deformable convolution reads. The offsets come first, `(dy, dx)` for each tap of each group, then
/// the mask logits.
#[derive(Clone, Copy)]
pub(super) struct Operands<'a> {
    pub(super) x: &'a str,
    pub(super) offsets: &'a str,
    pub(super) weight: &'a str,
    pub(super) bias: &'a str,
}

/// Its sizes.
#[derive(Clone, Copy)]
pub(super) struct Sizes {
    /// Channels of the map.
    pub(super) channels: usize,
    /// Groups of channels that share offsets.
    pub(super) groups: usize,
    /// Shape of the window.
    pub(super) window: Window,
}

impl Sizes {
    fn taps(&self) -> i64 {
        (self.window.kernel * self.window.kernel) as i64
    }
}

/// ONNX's own operator, which ONNX Runtime has. Its settings are those of a `convolution` and the number of offset
/// groups.
pub(super) fn operator(
    parts: &mut Parts,
    operands: Operands<'_>,
    sizes: Sizes,
    convolution: Vec<AttributeProto>,
    out: &str,
) -> String {
    let Operands { x, offsets, weight, bias } = operands;
    let step = |name: &str| format!("{out}/{name}");
    let groups = sizes.groups as i64;
    let first_mask = 2 * sizes.taps() * groups;
    let offset = slice(parts, offsets, [0, first_mask, 1], &step("offset"));
    let mask = slice(parts, offsets, [first_mask, first_mask + sizes.taps() * groups, 1], &step("mask_logits"));
    let mask = parts.node("Sigmoid", &[&mask], &step("mask"), Vec::new());
    let settings = convolution.into_iter().chain([int("offset_group", groups)]).collect();
    parts.node("DeformConv", &[x, weight, &offset, bias, &mask], out, settings)
}

/// Samples with `GridSample`, times their mask, then an ordinary 1x1 convolution over channels and taps.
///
/// The weight is `[out, channels taps, 1, 1]`. Sizes of maps are asked for at run time, so the input's size stays free.
pub(super) fn samples(parts: &mut Parts, operands: Operands<'_>, sizes: Sizes, out: &str) -> String {
    let group_channels = (sizes.channels / sizes.groups) as i64;
    let mut samples = Vec::new();
    for group in 0..sizes.groups as i64 {
        let name = if sizes.groups == 1 { out.to_owned() } else { format!("{out}/group{group}") };
        let range = [group_channels * group, group_channels * (group + 1), 1];
        let x = if sizes.groups == 1 {
            operands.x.to_owned()
        } else {
            slice(parts, operands.x, range, &format!("{name}/x"))
        };
        samples.push(group_samples(parts, [&x, operands.offsets], group, sizes, &name));
    }
    let samples = match &samples[..] {
        [only] => only.clone(),
        all => {
            let all: Vec<&str> = all.iter().map(String::as_str).collect();
            parts.node("Concat", &all, &format!("{out}/all_samples"), vec![int("axis", 1)])
        }
    };
    parts.node("Conv", &[&samples, operands.weight, operands.bias], out, vec![ints("kernel_shape", &[1, 1])])
}

/// The weighted samples of one group, `[batch, channels taps, height, width]`; `x` holds the channels of this group.
fn group_samples(parts: &mut Parts, [x, offsets]: [&str; 2], group: i64, sizes: Sizes, name: &str) -> String {
    let step = |part: &str| format!("{name}/{part}");
    let taps = sizes.taps();
    let rows = axis(parts, [x, offsets], 0, group, sizes.window, &step("row"));
    let columns = axis(parts, [x, offsets], 1, group, sizes.window, &step("column"));
    // All taps above each other: `[batch, 1, taps height, width]`.
    let stacked = parts.list(&[0, 1, -1, 0]);
    let [rows, columns] = [(rows, "rows"), (columns, "columns")]
        .map(|(value, part)| parts.node("Reshape", &[&value, &stacked], &step(part), Vec::new()));
    let pairs = parts.node("Concat", &[&columns, &rows], &step("pairs"), vec![int("axis", 1)]);
    let grid = parts.node("Transpose", &[&pairs], &step("grid"), vec![ints("perm", &[0, 2, 3, 1])]);
    let how = vec![int("align_corners", 0), word("mode", "bilinear"), word("padding_mode", "zeros")];
    let sampled = parts.node("GridSample", &[x, &grid], &step("sampled"), how);

    let first_mask = taps * (2 * sizes.groups as i64 + group);
    let mask = slice(parts, offsets, [first_mask, first_mask + taps, 1], &step("mask_logits"));
    let mask = parts.node("Sigmoid", &[&mask], &step("mask"), Vec::new());
    let mask = parts.node("Reshape", &[&mask, &stacked], &step("masks"), Vec::new());
    let weighted = parts.node("Mul", &[&sampled, &mask], &step("weighted"), Vec::new());
    let channels = (sizes.channels / sizes.groups) as i64;
    let side_by_side = parts.list(&[0, channels * taps, -1, 0]);
    parts.node("Reshape", &[&weighted, &side_by_side], &step("samples"), Vec::new())
}

/// Where the taps of a group lie along one axis (0 rows, 1 columns), in `GridSample`'s coordinates,
/// `[batch, taps, height, width]`.
///
/// With corners not aligned, cell `p` of `n` has the coordinate `(2 p + 1) / n - 1`.
fn axis(parts: &mut Parts, [x, offsets]: [&str; 2], axis: i64, group: i64, window: Window, name: &str) -> String {
    let step = |part: &str| format!("{name}/{part}");
    let Window { kernel, stride, padding, dilation, .. } = window;
    let taps = kernel * kernel;
    let group_offsets = 2 * taps as i64;
    let range = [group_offsets * group + axis, group_offsets * (group + 1), 2];
    let offset = slice(parts, offsets, range, &step("offset"));

    let place = |tap: usize| if axis == 0 { tap / kernel } else { tap % kernel };
    let places: Vec<f32> = (0..taps).map(|tap| (place(tap) * dilation) as f32 - padding as f32).collect();
    let places = parts.floats(&format!("taps {axis} {kernel} {padding} {dilation}"), &[1, taps, 1, 1], &places);

    // Undisturbed: cell times stride, plus the tap's place in the window.
    let cells = size(parts, offsets, axis, &step("cells"));
    let [zero, one] = [0, 1].map(|value| parts.whole(value));
    let cells = parts.node("Range", &[&zero, &cells, &one], &step("range"), Vec::new());
    let cells = parts.node("Cast", &[&cells], &step("numbers"), vec![int("to", 1)]);
    let along = parts.list(if axis == 0 { &[1, 1, -1, 1] } else { &[1, 1, 1, -1] });
    let cells = parts.node("Reshape", &[&cells, &along], &step("along"), Vec::new());
    let stride = parts.float(stride as f32);
    let origins = parts.node("Mul", &[&cells, &stride], &step("origins"), Vec::new());
    let undisturbed = parts.node("Add", &[&origins, &places], &step("undisturbed"), Vec::new());
    let positions = parts.node("Add", &[&offset, &undisturbed], &step("positions"), Vec::new());

    let source = size(parts, x, axis, &step("size"));
    let source = parts.node("Cast", &[&source], &step("source"), vec![int("to", 1)]);
    let [one, two] = [1.0, 2.0].map(|value| parts.float(value));
    let scale = parts.node("Div", &[&two, &source], &step("scale"), Vec::new());
    let centre = parts.node("Div", &[&one, &source], &step("centre"), Vec::new());
    let shift = parts.node("Sub", &[&centre, &one], &step("shift"), Vec::new());
    let scaled = parts.node("Mul", &[&positions, &scale], &step("scaled"), Vec::new());
    parts.node("Add", &[&scaled, &shift], name, Vec::new())
}

/// Channels `from..to` in steps.
fn slice(parts: &mut Parts, x: &str, [from, to, by]: [i64; 3], name: &str) -> String {
    let [from, to, axis, by] = [from, to, 1, by].map(|value| parts.list(&[value]));
    parts.node("Slice", &[x, &from, &to, &axis, &by], name, Vec::new())
}

/// Height (0) or width (1) of a map, a whole number.
fn size(parts: &mut Parts, x: &str, axis: i64, name: &str) -> String {
    let shape = parts.node("Shape", &[x], &format!("{name}/shape"), Vec::new());
    let index = parts.whole(2 + axis);
    parts.node("Gather", &[&shape, &index], name, Vec::new())
}

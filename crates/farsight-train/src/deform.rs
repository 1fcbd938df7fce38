//! Modulated deformable convolution (`DCNv2`) from libtorch's own operations: no extension to build, CPU and CUDA, with
//! gradients.

use farsight_graph::graph::Window;
use tch::Tensor;

/// libtorch's numbers for bilinear interpolation and zero padding in `grid_sampler`.
const BILINEAR: i64 = 0;
const ZEROS: i64 = 0;

/// The samples that a deformable convolution multiplies with its kernel,
/// `[batch, channels k k, out height, out width]`.
///
/// # Shapes
/// `x` `[batch, channels, height, width]`; `offset` `[batch, groups 2 k k, out height, out width]`, `(dy, dx)` for each
/// tap in row order; `mask` `[batch, groups k k, out height, out width]`. Samples outside the map count zero, neighbour
/// by neighbour (spec 3.1).
pub fn deformable_samples(x: &Tensor, offset: &Tensor, mask: &Tensor, window: Window) -> Tensor {
    let (batch, channels, height, width) = x.size4().unwrap_or_default();
    let (_, mask_channels, out_height, out_width) = mask.size4().unwrap_or_default();
    let taps = (window.kernel * window.kernel) as i64;
    let groups = mask_channels / taps;
    let offset = offset.view([batch, groups, taps, 2, out_height, out_width]);
    let axis = |component: i64, size: i64, base: &Tensor| {
        let position = offset.select(3, component) + base;
        // grid_sampler's coordinates with corners not aligned: pixel p of n is (2 p + 1) / n - 1.
        position * (2.0 / size as f64) + (1.0 / size as f64 - 1.0)
    };
    let [base_y, base_x] = tap_positions(window, [out_height, out_width], x);
    let grid = Tensor::stack(&[axis(1, width, &base_x), axis(0, height, &base_y)], -1);
    let sampled = x
        .reshape([batch * groups, channels / groups, height, width])
        .grid_sampler(&grid.view([batch * groups, taps * out_height, out_width, 2]), BILINEAR, ZEROS, false)
        .view([batch, groups, channels / groups, taps, out_height, out_width]);
    let weighted = sampled * mask.view([batch, groups, 1, taps, out_height, out_width]);
    weighted.view([batch, channels * taps, out_height, out_width])
}

/// Undisturbed rows `[taps, out height, 1]` and columns `[taps, 1, out width]` of the taps.
fn tap_positions(window: Window, [out_height, out_width]: [i64; 2], like: &Tensor) -> [Tensor; 2] {
    let Window { kernel, stride, padding, dilation, .. } = window;
    let options = (like.kind(), like.device());
    let tap = Tensor::arange((kernel * kernel) as i64, options);
    let origin = |size: i64| Tensor::arange(size, options) * stride as i64 - padding as i64;
    let tap_row = tap.divide_scalar_mode(kernel as i64, "floor") * dilation as i64;
    let tap_column = tap.remainder(kernel as i64) * dilation as i64;
    let rows = tap_row.view([-1, 1, 1]) + origin(out_height).view([1, -1, 1]);
    let columns = tap_column.view([-1, 1, 1]) + origin(out_width).view([1, 1, -1]);
    [rows, columns]
}

//! [`farsight_core::samplers`] on tensors, with gradients to the maps.
//!
//! Conventions are those of the core: coordinates are pixels of the map with the centres of its cells at whole numbers
//! (`align_corners=False`), and a map is zero outside. Points and boxes are not differentiated.

use farsight_core::Box2d;
use farsight_core::samplers::grid_in_box;
use tch::Tensor;

use crate::executor::wide_kind;

/// PyTorch's numbers for `mode="bilinear"` and `padding_mode="zeros"`.
const BILINEAR: i64 = 0;
const ZEROS: i64 = 0;

/// Bilinear samples of `map` at `points` (x and y).
///
/// # Shapes
/// `[channels, height, width]` to `[channels, points]`.
pub fn grid_sample(map: &Tensor, points: &[[f64; 2]]) -> Tensor {
    let grid = Tensor::from_slice(points.as_flattened()).view([1, 1, -1, 2]).to_device(map.device());
    sampled(map, &grid).to_kind(map.kind())
}

/// Samples at a grid `[1, 1, points, 2]` in pixels.
fn sampled(map: &Tensor, grid: &Tensor) -> Tensor {
    let [channels, height, width] = shape(map);
    let size = Tensor::from_slice(&[width as f64, height as f64]).to_device(map.device());
    // What is no number lies outside; PyTorch does not say where it looks for it.
    let normalised = ((grid * 2.0 + 1.0) / size - 1.0).nan_to_num(-3.0, 3.0, -3.0).to_kind(map.kind());
    map.unsqueeze(0).grid_sampler(&normalised, BILINEAR, ZEROS, false).view([channels, -1])
}

/// `RoIAlign`: each box cut into `width` x `height` bins, each the mean of `samples` x `samples` bilinear samples.
///
/// # Shapes
/// `[channels, height, width]` to `[boxes, channels, height, width]`.
pub fn roi_align(map: &Tensor, boxes: &[Box2d], [width, height]: [usize; 2], samples: usize) -> Tensor {
    let [channels, ..] = shape(map);
    let samples = samples.max(1);
    let points: Vec<[f64; 2]> =
        boxes.iter().flat_map(|area| grid_in_box(area, [width * samples, height * samples])).collect();
    let [boxes, width, height, samples] = [boxes.len(), width, height, samples].map(|count| count as i64);
    let fine = grid_sample(map, &points).view([channels, boxes, height, samples, width, samples]);
    fine.mean_dim([3_i64, 5].as_slice(), false, map.kind()).transpose(0, 1).contiguous()
}

/// Mean values over boxes; what of a box lies outside the map does not count, and a box of which nothing is inside has
/// zeros.
///
/// The core takes them from an integral image. Here they are a product with a sparse matrix, which holds how much of
/// each cell lies in each box: its gradient is one too, and no sum over the whole map loses what a small box holds.
///
/// # Shapes
/// `[channels, height, width]` to `[channels, boxes]`.
pub fn box_means(map: &Tensor, boxes: &[Box2d]) -> Tensor {
    let [channels, height, width] = shape(map);
    let (mut rows, mut cells, mut shares) = (Vec::<i64>::new(), Vec::<i64>::new(), Vec::<f64>::new());
    for (row, area) in (0..).zip(boxes) {
        let (columns, lines) = (covered(area.x1, area.x2, width), covered(area.y1, area.y2, height));
        for &(y, y_share) in &lines {
            for &(x, x_share) in &columns {
                rows.push(row);
                cells.push(y * width + x);
                shares.push(x_share * y_share);
            }
        }
    }
    let kind = wide_kind(map.kind());
    let indices = Tensor::stack(&[Tensor::from_slice(&rows), Tensor::from_slice(&cells)], 0).to_device(map.device());
    let shares = Tensor::from_slice(&shares).to_kind(kind).to_device(map.device());
    let size = [boxes.len() as i64, height * width];
    // In the order of rows and then of cells, each at most once.
    let shares = Tensor::sparse_coo_tensor_indices_size(&indices, &shares, size, (kind, map.device()), true);
    let by_cell = map.to_kind(kind).reshape([channels, -1]).transpose(0, 1).contiguous();
    shares.mm(&by_cell).transpose(0, 1).to_kind(map.kind())
}

/// The cells of a side of `size` cells between two edges, and which share of what is inside lies in each; none where
/// nothing is.
fn covered(low: f64, high: f64, size: i64) -> Vec<(i64, f64)> {
    // A cell reaches half a cell to both sides of its whole number.
    let edge = |at: f64| (at + 0.5).clamp(0.0, size as f64);
    let (low, high) = (edge(low), edge(high));
    // What is no number is nowhere.
    if low.is_nan() || high.is_nan() || high <= low {
        return Vec::new();
    }
    let share = |cell: i64| (high.min(cell as f64 + 1.0) - low.max(cell as f64)) / (high - low);
    (low.floor() as i64..high.ceil() as i64).map(|cell| (cell, share(cell))).collect()
}

fn shape(map: &Tensor) -> [i64; 3] {
    let (channels, height, width) = map.size3().unwrap_or_default();
    [channels, height, width]
}

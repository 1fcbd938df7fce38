//! [`farsight_core::samplers`] on tensors, with gradients to the maps.
//!
//! Conventions are those of the core: coordinates are pixels of the map with the centres of its cells at whole numbers
//! (`align_corners=False`), and a map is zero outside. Points and boxes are not differentiated.

use farsight_core::Box2d;
use farsight_core::samplers::grid_in_box;
use tch::{Kind, Tensor};

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

/// Mean values over boxes by an integral image; what of a box lies outside the map does not count, and a box of which
/// nothing is inside has zeros.
///
/// Sums are taken in double precision: those of a large map lose what a small box holds.
///
/// # Shapes
/// `[channels, height, width]` to `[channels, boxes]`.
pub fn box_means(map: &Tensor, boxes: &[Box2d]) -> Tensor {
    let [channels, height, width] = shape(map);
    // The first row and column are zeros; the sum up to a point within a cell lies bilinearly between those around it.
    let sums = map.to_kind(Kind::Double).cumsum(1, Kind::Double).cumsum(2, Kind::Double);
    let sums = sums.constant_pad_nd([1, 0, 1, 0]);
    let edge = |at: f64, side: i64| (at + 0.5).clamp(0.0, side as f64);
    let edges: Vec<[f64; 4]> = boxes
        .iter()
        .map(|area| [edge(area.x1, width), edge(area.y1, height), edge(area.x2, width), edge(area.y2, height)])
        .map(|edges| if edges[2] > edges[0] && edges[3] > edges[1] { edges } else { [0.0; 4] })
        .collect();
    let corners: Vec<[f64; 2]> =
        edges.iter().flat_map(|&[x1, y1, x2, y2]| [[x1, y1], [x2, y1], [x1, y2], [x2, y2]]).collect();
    let sums = grid_sample(&sums, &corners).view([channels, -1, 4]);
    let [upper_left, upper_right, lower_left, lower_right] = [0, 1, 2, 3].map(|corner| sums.select(2, corner));
    let areas: Vec<f64> = edges.iter().map(|[x1, y1, x2, y2]| (x2 - x1) * (y2 - y1)).collect();
    // The sum over nothing is zero, whatever it is divided by.
    let areas: Vec<f64> = areas.into_iter().map(|area| if area > 0.0 { area } else { 1.0 }).collect();
    let areas = Tensor::from_slice(&areas).to_device(map.device());
    ((lower_right - lower_left - upper_right + upper_left) / areas).to_kind(map.kind())
}

fn shape(map: &Tensor) -> [i64; 3] {
    let (channels, height, width) = map.size3().unwrap_or_default();
    [channels, height, width]
}

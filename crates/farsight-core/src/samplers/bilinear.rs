//! Bilinear samples.

use super::feature_map::FeatureMap;
use super::grids::grid_in_box;
use crate::Box2d;

/// Bilinear samples at `points` (x and y): `[channels, points]`.
///
/// As PyTorch's `grid_sample` with `mode="bilinear"`, `padding_mode="zeros"` and `align_corners=False`. A point that is
/// no number has zeros.
pub fn grid_sample(map: FeatureMap, points: &[[f64; 2]]) -> Vec<f32> {
    let [channels, height, width] = map.shape();
    let taps: Vec<Taps> = points.iter().map(|point| Taps::new(*point, [width, height])).collect();
    let mut samples = Vec::with_capacity(channels * points.len());
    for channel in 0..channels {
        let plane = map.plane(channel);
        samples.extend(taps.iter().map(|taps| taps.sample(plane)));
    }
    samples
}

/// The four cells around a point, and how much each counts.
#[derive(Debug, Clone, Copy, Default)]
struct Taps([(usize, f32); 4]);

impl Taps {
    fn new([x, y]: [f64; 2], [width, height]: [usize; 2]) -> Self {
        // What is no number is not within the map, either.
        let is_near = x > -1.0 && y > -1.0 && x < width as f64 && y < height as f64;
        if !is_near {
            return Self::default();
        }
        let (left, top) = (x.floor(), y.floor());
        let (right_share, lower_share) = (x - left, y - top);
        let tap = |dx: f64, dy: f64, share: f64| {
            let (column, row) = (left + dx, top + dy);
            let is_inside = column >= 0.0 && row >= 0.0 && column < width as f64 && row < height as f64;
            if is_inside { (row as usize * width + column as usize, share as f32) } else { (0, 0.0) }
        };
        Self([
            tap(0.0, 0.0, (1.0 - right_share) * (1.0 - lower_share)),
            tap(1.0, 0.0, right_share * (1.0 - lower_share)),
            tap(0.0, 1.0, (1.0 - right_share) * lower_share),
            tap(1.0, 1.0, right_share * lower_share),
        ])
    }

    fn sample(&self, plane: &[f32]) -> f32 {
        let counting = self.0.iter().filter(|(_, share)| *share != 0.0);
        counting.map(|&(cell, share)| share * plane[cell]).sum()
    }
}

/// `RoIAlign`: each box cut into `width` x `height` bins, each bin the mean of `samples` x `samples` bilinear samples:
/// `[boxes, channels, height, width]`.
///
/// As torchvision's `roi_align` with `aligned=True`, but for the map's border: beyond its outermost centres a map fades
/// to zero, as in [`grid_sample`], where torchvision repeats the border for one more cell. With one sample a bin this
/// is crop-and-resize.
pub fn roi_align(map: FeatureMap, boxes: &[Box2d], [width, height]: [usize; 2], samples: usize) -> Vec<f32> {
    let [channels, ..] = map.shape();
    let samples = samples.max(1);
    let bins = width * height;
    let mut aligned = Vec::with_capacity(boxes.len() * channels * bins);
    for area in boxes {
        let fine = grid_sample(map, &grid_in_box(area, [width * samples, height * samples]));
        for plane in fine.chunks_exact((bins * samples * samples).max(1)).take(channels) {
            let bin = |bin: usize| {
                let (column, row) = (bin % width * samples, bin / width * samples);
                let rows = (row..row + samples).map(|row| row * width * samples + column);
                let sum: f32 = rows.flat_map(|start| &plane[start..start + samples]).sum();
                sum / (samples * samples) as f32
            };
            aligned.extend((0..bins).map(bin));
        }
    }
    aligned
}

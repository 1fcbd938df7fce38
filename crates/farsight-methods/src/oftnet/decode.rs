//! From the grid to detections.

use farsight_core::Detection;
use farsight_core::detection::{DecodeOptions, View, is_calibrated};
use farsight_core::peaks::{Peak, peaks};
use farsight_core::score::{MIN_PEAK, SCORE_LIMITS};
use farsight_runtime::TensorView;

use super::OftNetConfig;
use super::codec::Encoded;
use super::network::ANSWERS;

/// Standard deviation, cells, of the Gaussian that smooths scores before peaks are looked for, and where it ends.
const SMOOTHING_CELLS: f64 = 1.0;
const SMOOTHING_REACH: usize = 2;

/// What is found in `answer` (`[classes answers, rows, columns]`), highest score first. Boxes that do not come out
/// finite or are not seen in the image are left out.
///
/// Peaks are those of the smoothed scores; what counts is the score there as it was (authors' code).
pub fn detections(
    config: &OftNetConfig,
    answer: &TensorView<'_>,
    view: &View,
    options: &DecodeOptions,
) -> Vec<Detection> {
    let (grid, classes) = (&config.grid, &config.classes);
    let min_score = options.min_score(classes);
    let size = [grid.columns, grid.rows];
    let at = |class: usize, channel: usize, [column, row]: [usize; 2]| {
        f64::from(answer.values[((class * ANSWERS + channel) * grid.rows + row) * grid.columns + column])
    };
    let planes = answer.values.chunks_exact(grid.cells().max(1));
    let smooth: Vec<f32> = planes.step_by(ANSWERS).flat_map(|scores| smoothed(scores, size)).collect();
    // A low score can stand for a high probability.
    let least = if is_calibrated(classes) { MIN_PEAK } else { min_score };
    let high = peaks(&smooth, size, usize::MAX, |_| f32::NEG_INFINITY);
    let high = high.into_iter().filter(|peak| at(peak.class, 0, peak.cell) > least);
    let detection = |peak: Peak| {
        let score = at(peak.class, 0, peak.cell);
        let three = |first: usize| [0, 1, 2].map(|channel| at(peak.class, first + channel, peak.cell));
        let cos_sin = [7, 8].map(|channel| at(peak.class, channel, peak.cell));
        detection(config, &peak, score, &Encoded { place: three(1), size: three(4), cos_sin }, view)
    };
    let mut found: Vec<Detection> = without_twins(high).into_iter().filter_map(detection).collect();
    found.retain(|detection| detection.score > min_score);
    found.sort_by(|a, b| b.score.total_cmp(&a.score));
    found.truncate(options.max_detections);
    found
}

/// Of peaks beside one another, which are equally high, the first.
fn without_twins(peaks: impl Iterator<Item = Peak>) -> Vec<Peak> {
    let mut kept: Vec<Peak> = Vec::new();
    for peak in peaks {
        let is_beside = |other: &Peak| (0..2).all(|axis| other.cell[axis].abs_diff(peak.cell[axis]) <= 1);
        if !kept.iter().any(|other| other.class == peak.class && is_beside(other)) {
            kept.push(peak);
        }
    }
    kept
}

/// The detection that stands at `peak`.
fn detection(config: &OftNetConfig, peak: &Peak, score: f64, encoded: &Encoded, view: &View) -> Option<Detection> {
    let box3d = config.codec().decode(encoded, peak.class, peak.cell);
    let size = &box3d.dimensions;
    let numbers = box3d.location.iter().chain([&box3d.yaw, &size.height, &size.width, &size.length, &score]);
    if !numbers.into_iter().all(|number| number.is_finite()) || box3d.depth_m() <= 0.0 {
        return None;
    }
    let [width, height] = view.image_size.map(|side| side as f64);
    let box2d = box3d.projected(&view.camera)?.clamped(width, height);
    let class = &config.classes[peak.class];
    let score = score.clamp(SCORE_LIMITS.0, SCORE_LIMITS.1);
    let probability = |height_px: f64| class.score.map(|calibration| calibration.probability(score, height_px));
    let score = probability(view.input_height_px(&box2d)).unwrap_or(score);
    let found = Detection { class: class.class.clone(), score, box2d, box3d, range_sigma_m: None };
    (found.box2d.area() > 0.0).then_some(found)
}

/// `map` (`size` is width and height) under a Gaussian; outside it is zero.
fn smoothed(map: &[f32], [width, height]: [usize; 2]) -> Vec<f32> {
    let weights: Vec<f64> = (0..=2 * SMOOTHING_REACH)
        .map(|tap| (tap as f64 - SMOOTHING_REACH as f64) / SMOOTHING_CELLS)
        .map(|off| (-off * off / 2.0).exp())
        .collect();
    let sum: f64 = weights.iter().sum();
    // One axis after the other; `step` leads from a value to its neighbour.
    let along = |values: &[f64], step: usize, place: &dyn Fn(usize) -> usize, length: usize| -> Vec<f64> {
        let one = |k: usize| {
            let terms = weights.iter().enumerate().filter_map(|(tap, weight)| {
                let neighbour = (place(k) + tap).checked_sub(SMOOTHING_REACH).filter(|at| *at < length)?;
                Some(weight * values[k + neighbour * step - place(k) * step])
            });
            terms.sum::<f64>() / sum
        };
        (0..values.len()).map(one).collect()
    };
    let values: Vec<f64> = map.iter().map(|value| f64::from(*value)).collect();
    let across = along(&values, 1, &|k| k % width, width);
    along(&across, width, &|k| k / width, height).into_iter().map(|value| value as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::smoothed;

    #[test]
    fn a_point_becomes_a_gaussian_and_a_plain_stays_one() {
        let (width, height) = (9, 7);
        let mut point = vec![0.0; width * height];
        point[3 * width + 4] = 1.0;
        let found = smoothed(&point, [width, height]);
        let norm: f64 = (-2..=2).map(|off| (-f64::from(off * off) / 2.0).exp()).sum();
        for row in 0..height {
            for column in 0..width {
                let off = [column.abs_diff(4), row.abs_diff(3)];
                let expected = if off.iter().any(|off| *off > 2) {
                    0.0
                } else {
                    (-((off[0] * off[0] + off[1] * off[1]) as f64) / 2.0).exp() / (norm * norm)
                };
                assert!((f64::from(found[row * width + column]) - expected).abs() < 1e-7, "{column} {row}");
            }
        }
        let plain = smoothed(&vec![0.5; width * height], [width, height]);
        assert!((plain[3 * width + 4] - 0.5).abs() < 1e-6 && plain[0] < 0.3, "outside there is nothing");
    }
}

//! Detections at the peaks of a heatmap.

use farsight_core::detection::{DecodeOptions, View, is_calibrated};
use farsight_core::peaks::{Peak, peaks};
use farsight_core::score::{SCORE_LIMITS, least_peak, logistic, logit};
use farsight_core::{Box2d, ClassReference, Detection};
use farsight_runtime::TensorView;

/// The value of `map` (`[channels, height, width]`) in `channel` at the column and row `cell`.
pub(crate) fn value_at(map: &TensorView<'_>, channel: usize, [column, row]: [usize; 2]) -> f64 {
    let [height, width] = [map.shape[1], map.shape[2]];
    f64::from(map.values[(channel * height + row) * width + column])
}

/// What `detection` makes of the peaks of `heatmap` (logits, `[classes, height, width]`), highest score first. A score
/// is never above that of its peak.
pub(crate) fn at_peaks(
    heatmap: &TensorView<'_>,
    classes: &[ClassReference],
    options: &DecodeOptions,
    detection: impl Fn(&Peak) -> Option<Detection>,
) -> Vec<Detection> {
    let found = at_peaks_with(heatmap, classes, options, |peak| Some((detection(peak)?, ())));
    found.into_iter().map(|(detection, ())| detection).collect()
}

/// As [`at_peaks`], with something beside each detection.
pub(crate) fn at_peaks_with<T>(
    heatmap: &TensorView<'_>,
    classes: &[ClassReference],
    options: &DecodeOptions,
    detection: impl Fn(&Peak) -> Option<(Detection, T)>,
) -> Vec<(Detection, T)> {
    let min_score = options.min_score(classes);
    // A low peak of a near object can stand for a high probability.
    let most_peaks = if is_calibrated(classes) { usize::MAX } else { options.max_detections };
    let least = |class: usize| least_peak(classes[class].score.as_ref(), min_score).max(SCORE_LIMITS.0);
    let floor = |class: usize| logit(least(class)) as f32;
    let map_size = [heatmap.shape[2], heatmap.shape[1]];
    let peaks = peaks(heatmap.values, map_size, most_peaks, floor);
    let mut found: Vec<(Detection, T)> = peaks.iter().filter_map(detection).collect();
    found.retain(|(detection, _)| detection.score > min_score);
    found.sort_by(|(a, _), (b, _)| b.score.total_cmp(&a.score));
    found.truncate(options.max_detections);
    found
}

/// The score of a peak whose object has this box in the original image: its height, or the probability that was fitted
/// to it.
pub(crate) fn peak_score(peak: &Peak, class: &ClassReference, box2d: &Box2d, view: &View) -> f64 {
    let (low, high) = SCORE_LIMITS;
    let score = logistic(f64::from(peak.value)).clamp(low, high);
    match &class.score {
        Some(calibration) => calibration.probability(score, view.input_height_px(box2d)).clamp(low, high),
        None => score,
    }
}

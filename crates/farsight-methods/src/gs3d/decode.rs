//! From maps to 2D boxes with guidances, and from bins to detections.

use farsight_core::Detection;
use farsight_core::detection::{DecodeOptions, View};
use farsight_core::peaks::Peak;
use farsight_core::score::logistic;
use farsight_runtime::TensorView;

use super::Gs3dConfig;
use super::boxes::Encoded;
use super::refinement::{BINS, NUMBERS};
use super::surfaces::points;
use super::targets::guidance_of;
use crate::center_map::{at_peaks_with, feature_camera, image_box, peak_score};

/// Something found in the image: the guidance as a detection with the score of its 2D box, and where the map is read.
pub type Candidate = (Detection, Vec<[f64; 2]>);

/// What is found in the maps of heatmap, offsets, sizes and headings, highest score first. Boxes that say nothing or do
/// not come out finite are left out.
pub fn candidates(
    config: &Gs3dConfig,
    [heatmap, offset, size, heading]: [&TensorView<'_>; 4],
    view: &View,
    options: &DecodeOptions,
) -> Vec<Candidate> {
    let camera = feature_camera(&view.input_camera);
    let [width, height] = view.image_size.map(|side| side as f64);
    at_peaks_with(heatmap, &config.classes, options, |peak: &Peak| {
        let encoded = Encoded::at(peak, [offset, size, heading]);
        let cells = encoded.box2d();
        let box3d = guidance_of(config, peak.class, &cells, encoded.heading.alpha(), &camera)?;
        let box2d = image_box(&cells, view).clamped(width, height);
        let class = &config.classes[peak.class];
        let score = peak_score(peak, class, &box2d, view);
        let numbers = box3d.location.iter().chain([&box3d.yaw, &box2d.x1, &box2d.y1, &box2d.x2, &box2d.y2]);
        let is_there = numbers.into_iter().all(|number| number.is_finite()) && box3d.depth_m() > 0.0;
        let points = points(&cells, &box3d, &camera);
        is_there.then(|| (Detection { class: class.class.clone(), score, box2d, box3d, range_sigma_m: None }, points))
    })
}

/// The detection that a guidance becomes by what the second network says of it: logits of the bins.
///
/// Each number moves to its best bin. The score is that of the 2D box times the mean probability of these bins, which
/// were learnt to say how good the box is.
pub fn refined(config: &Gs3dConfig, guidance: &Detection, logits: &[f32]) -> Option<Detection> {
    let best = |bins: &[f32]| (1..bins.len()).fold(0, |best, bin| if bins[bin] > bins[best] { bin } else { best });
    let mut bins = [None; NUMBERS];
    let mut sum = 0.0;
    for (bin, logits) in bins.iter_mut().zip(logits.chunks_exact(BINS)) {
        let best = best(logits);
        sum += logistic(f64::from(logits[best]));
        *bin = Some(best);
    }
    let box3d = config.refinement().decode(&guidance.box3d, &bins);
    let score = guidance.score * sum / NUMBERS as f64;
    let is_there = score.is_finite() && box3d.depth_m() > 0.0;
    is_there.then(|| Detection { box3d, score, ..guidance.clone() })
}

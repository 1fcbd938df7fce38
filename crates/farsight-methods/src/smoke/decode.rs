//! From head maps to detections (spec section 10).

use farsight_core::detection::{DecodeOptions, View, is_calibrated};
use farsight_core::peaks::{Peak, peaks};
use farsight_core::score::{SCORE_LIMITS, least_peak, logistic, logit};
use farsight_core::{Camera, Detection};
use farsight_runtime::Tensor;

use super::codec::{CHANNELS, Codec, Encoded, Regression};
use super::targets::feature_camera;

/// What a network answers for one image, before any activation.
#[derive(Debug, Clone, PartialEq)]
pub struct HeadMaps {
    /// Heatmap logits, `[classes, height, width]`.
    pub logits: Vec<f32>,
    /// Raw regression channels, `[8, height, width]`; of a network that ends before its regression head, the features
    /// that the head reads, `[channels, height, width]`.
    pub regression: Vec<f32>,
    /// Width and height, cells.
    pub map_size: [usize; 2],
}

impl HeadMaps {
    /// The maps of each image of a batch, from the two outputs of the network.
    pub fn of_batch(logits: Tensor, regression: Tensor) -> Vec<Self> {
        let map_size = [logits.shape[3], logits.shape[2]];
        if logits.shape[0] == 1 {
            return vec![Self { logits: logits.values, regression: regression.values, map_size }];
        }
        let image = |tensor: &Tensor, image: usize| tensor.image(image).values.to_vec();
        let maps = |i| Self { logits: image(&logits, i), regression: image(&regression, i), map_size };
        (0..logits.shape[0]).map(maps).collect()
    }
}

/// The detections in `maps`, highest score first (spec section 10).
///
/// Boxes that do not come out finite or lie behind the camera are left out.
pub fn detections(codec: &Codec, maps: &HeadMaps, view: &View, options: &DecodeOptions) -> Vec<Detection> {
    let regression = |cell| raw_regression(maps, cell);
    detections_at_peaks(codec, &maps.logits, maps.map_size, regression, view, options)
}

/// [`detections`] for a regression that is only computed where it is asked for: `regression` gives the raw channels at
/// a cell.
pub fn detections_at_peaks(
    codec: &Codec,
    logits: &[f32],
    map_size: [usize; 2],
    regression: impl Fn([usize; 2]) -> [f64; CHANNELS],
    view: &View,
    options: &DecodeOptions,
) -> Vec<Detection> {
    let min_score = options.min_score(&codec.classes);
    // A low peak of a near object can stand for a high probability, so peaks are not what the highest ones are chosen
    // by then.
    let most_peaks = if is_calibrated(&codec.classes) { usize::MAX } else { options.max_detections };
    let floor = |class: usize| logit(least_peak(codec.classes[class].score.as_ref(), min_score)) as f32;
    let camera = feature_camera(&view.input_camera);
    let mut found: Vec<Detection> = peaks(logits, map_size, most_peaks, floor)
        .into_iter()
        .filter_map(|peak| {
            let regression = Regression::from_raw(regression(peak.cell));
            let score = logistic(f64::from(peak.value)).clamp(SCORE_LIMITS.0, SCORE_LIMITS.1);
            let mut found = detection(codec, &peak, score, regression, &camera, view)?;
            if let Some(calibration) = &codec.classes[peak.class].score {
                let probability = calibration.probability(score, view.input_height_px(&found.box2d));
                found.score = probability.clamp(SCORE_LIMITS.0, SCORE_LIMITS.1);
            }
            let is_cut = view.cuts(&found.box2d);
            found.range_sigma_m =
                codec.depth.sigma_m(found.box3d.depth_m(), found.score, is_cut, view.input_camera.focal_y());
            Some(found)
        })
        .filter(|detection| detection.score > min_score)
        .collect();
    // Stable: peaks come highest first, and equals stay in the order of the map.
    found.sort_by(|a, b| b.score.total_cmp(&a.score));
    found.truncate(options.max_detections);
    found
}

/// The raw channels at `cell` of maps that hold them.
///
/// # Panics
/// When `cell` lies outside the maps.
pub fn raw_regression(maps: &HeadMaps, cell: [usize; 2]) -> [f64; CHANNELS] {
    let [width, height] = maps.map_size;
    std::array::from_fn(|channel| f64::from(maps.regression[channel * width * height + cell[1] * width + cell[0]]))
}

/// The detection that stands at `peak` with these activated regression values; `camera` is the feature map's.
pub fn detection(
    codec: &Codec,
    peak: &Peak,
    score: f64,
    regression: Regression<f64>,
    camera: &Camera,
    view: &View,
) -> Option<Detection> {
    let box3d = codec.decode(&Encoded { cell: peak.cell, regression }, peak.class, camera);
    if !box3d.location.iter().all(|v| v.is_finite()) {
        return None;
    }
    let [width, height] = view.image_size.map(|s| s as f64);
    let box2d = box3d.projected(&view.camera)?.clamped(width, height);
    let class = codec.classes[peak.class].class.clone();
    Some(Detection { class, score, box2d, box3d, range_sigma_m: None })
}

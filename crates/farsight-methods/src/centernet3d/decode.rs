//! From maps to detections.

use farsight_core::detection::{DecodeOptions, View, is_calibrated};
use farsight_core::peaks::{Peak, peaks};
use farsight_core::score::{MIN_PEAK, SCORE_LIMITS, logistic, logit};
use farsight_core::{Box2d, Detection};
use farsight_runtime::TensorView;

use super::CenterNet3dConfig;
use super::codec::{Codec, Encoded, HeadingBin, STRIDE, depth_from_raw};
use super::targets::feature_camera;

/// The maps of one image before any activation, each `[channels, height, width]`.
#[derive(Debug, Clone, Copy)]
pub struct Maps<'a> {
    /// Logits of the heatmap.
    pub heatmap: TensorView<'a>,
    /// One channel.
    pub depth: TensorView<'a>,
    /// Eight channels.
    pub rotation: TensorView<'a>,
    /// Three channels.
    pub dimensions: TensorView<'a>,
    /// Two channels.
    pub size: TensorView<'a>,
    /// Two channels.
    pub offset: TensorView<'a>,
}

impl Maps<'_> {
    /// Width and height, cells.
    fn map_size(&self) -> [usize; 2] {
        [self.heatmap.shape[2], self.heatmap.shape[1]]
    }

    /// What stands at `cell`, activations applied.
    fn encoded(&self, cell: [usize; 2]) -> Encoded {
        let [width, height] = self.map_size();
        let at = |map: &TensorView<'_>, channel: usize| {
            f64::from(map.values[(channel * height + cell[1]) * width + cell[0]])
        };
        let bin = |first: usize| HeadingBin {
            score: at(&self.rotation, first + 1) - at(&self.rotation, first),
            sin_cos: [at(&self.rotation, first + 2), at(&self.rotation, first + 3)],
        };
        Encoded {
            cell,
            depth_m: depth_from_raw(at(&self.depth, 0)),
            bins: [bin(0), bin(4)],
            dimensions_hwl: [0, 1, 2].map(|channel| at(&self.dimensions, channel)),
            size: [0, 1].map(|channel| at(&self.size, channel)),
            offset: [0, 1].map(|channel| at(&self.offset, channel)),
        }
    }
}

/// The detections in `maps`, highest score first. Boxes that do not come out finite or lie behind the camera are left
/// out.
pub fn detections(config: &CenterNet3dConfig, maps: &Maps<'_>, view: &View, options: &DecodeOptions) -> Vec<Detection> {
    let classes = &config.classes;
    let min_score = options.min_score(classes);
    // A low peak of a near object can stand for a high probability.
    let (least_peak, most_peaks) =
        if is_calibrated(classes) { (MIN_PEAK, usize::MAX) } else { (min_score, options.max_detections) };
    let floor = logit(least_peak.max(SCORE_LIMITS.0)) as f32;
    let peaks = peaks(maps.heatmap.values, maps.map_size(), most_peaks, floor);
    let mut found: Vec<Detection> =
        peaks.iter().filter_map(|peak| detection(config, peak, &maps.encoded(peak.cell), view)).collect();
    found.retain(|detection| detection.score > min_score);
    found.sort_by(|a, b| b.score.total_cmp(&a.score));
    found.truncate(options.max_detections);
    found
}

/// The detection that stands at `peak`.
fn detection(config: &CenterNet3dConfig, peak: &Peak, encoded: &Encoded, view: &View) -> Option<Detection> {
    let box3d = config.codec().decode(encoded, &feature_camera(&view.input_camera));
    let numbers = box3d.location.iter().chain([&box3d.yaw]).chain(&encoded.dimensions_hwl);
    let is_there = numbers.into_iter().all(|number| number.is_finite()) && box3d.depth_m() > 0.0;
    if !(is_there && encoded.dimensions_hwl.iter().all(|side| *side > 0.0)) {
        return None;
    }
    let [width, height] = view.image_size.map(|side| side as f64);
    let box2d = image_box(&Codec::box2d(encoded), view).clamped(width, height);
    let class = &config.classes[peak.class];
    let score = logistic(f64::from(peak.value)).clamp(SCORE_LIMITS.0, SCORE_LIMITS.1);
    let score = match &class.score {
        Some(calibration) => {
            let probability = calibration.probability(score, view.input_height_px(&box2d));
            probability.clamp(SCORE_LIMITS.0, SCORE_LIMITS.1)
        }
        None => score,
    };
    let scale = config.depth_focal_px.map_or(1.0, |focal_px| view.input_camera.focal_y() / focal_px);
    let depth_m = box3d.depth_m();
    let sigma_m = config.error.map(|error| error.sigma_m(depth_m / scale, score, view.cuts(&box2d)) * scale);
    let range_sigma_m = sigma_m.filter(|sigma_m| sigma_m.is_finite());
    Some(Detection { class: class.class.clone(), score, box2d, box3d, range_sigma_m })
}

/// A box in cells of the feature map as pixels of the original image: the input is a scaled and shifted image.
fn image_box(cells: &Box2d, view: &View) -> Box2d {
    let (from, to) = (view.input_camera.principal_point(), view.camera.principal_point());
    let scale =
        [view.camera.focal_x() / view.input_camera.focal_x(), view.camera.focal_y() / view.input_camera.focal_y()];
    let at = |cell: f64, axis: usize| (cell * STRIDE as f64 - from[axis]) * scale[axis] + to[axis];
    Box2d::new(at(cells.x1, 0), at(cells.y1, 1), at(cells.x2, 0), at(cells.y2, 1))
}

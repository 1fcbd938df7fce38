//! From head maps to detections: the one decoder that every engine shares.

use crate::codec::{CHANNELS, DepthReference, Encoded, Regression};
use crate::peaks::{Peak, peaks};
use crate::score::{LEAST_PEAK, logistic, logit};
use crate::targets::feature_camera;
use crate::{Box2d, Box3d, Camera, Codec, MeasuredDepth, ObjectClass};

/// One vehicle or person found in an image.
#[derive(Debug, Clone, PartialEq)]
pub struct Detection {
    /// What it is.
    pub class: ObjectClass,
    /// Height of its peak, 0 to 1; of a model with calibrated scores the probability that it is right.
    pub score: f64,
    /// Around the projected 3D box, clipped to the image, pixels of the original image.
    pub box2d: Box2d,
    /// Where it is, rectified camera coordinates, metres.
    pub box3d: Box3d,
    /// Standard deviation of its depth ([`Box3d::depth_m`]), metres, when the model gives one; [`Detection::sigma_of_m`] has that of other distances.
    pub range_sigma_m: Option<f64>,
}

impl Detection {
    /// Standard deviation of another distance to it, `distance_m`: where the depth is wrong, the box lies elsewhere on its ray and is as much larger, and so all
    /// distances are wrong by the same factor.
    pub fn sigma_of_m(&self, distance_m: f64) -> Option<f64> {
        Some(self.range_sigma_m? * distance_m / self.box3d.depth_m())
    }

    /// Moves the box along its rays to this depth; it grows with the distance, so that the picture stays the same.
    pub fn move_to(&mut self, MeasuredDepth { depth_m, log_sigma }: MeasuredDepth) {
        self.box3d = self.box3d.scaled(depth_m / self.box3d.depth_m());
        self.range_sigma_m = Some(log_sigma * depth_m);
    }

    /// Observation angle, radians.
    pub fn alpha(&self) -> f64 {
        self.box3d.alpha()
    }

    /// The score times the probability, by the error bar, that the distance is right to [`Box3d::depth_tolerance_m`] at [`PLACE_OVERLAP`]; None without an
    /// error bar.
    ///
    /// Errors are taken to spread as Laplace's distribution does: many small ones and long tails.
    pub fn place_score(&self) -> Option<f64> {
        let scale_m = self.range_sigma_m? / std::f64::consts::SQRT_2;
        let tolerance_m = self.box3d.depth_tolerance_m(PLACE_OVERLAP);
        Some(self.score * (1.0 - (-tolerance_m / scale_m).exp()))
    }
}

/// The overlap from which on a car is in its place, as KITTI judges.
pub const PLACE_OVERLAP: f64 = 0.7;

/// What a network answers for one image, before any activation.
#[derive(Debug, Clone, PartialEq)]
pub struct HeadMaps {
    /// Heat map logits, `[classes, height, width]`.
    pub logits: Vec<f32>,
    /// Raw regression channels, `[8, height, width]`; of a network that ends before its regression head, the features that the head reads,
    /// `[channels, height, width]`.
    pub regression: Vec<f32>,
    /// Width and height, cells.
    pub map_size: [usize; 2],
}

/// The image that the detections are for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// Width and height of the original image, pixels.
    pub image_size: [usize; 2],
    /// Camera of the original image.
    pub camera: Camera,
    /// Camera of the network's input.
    pub input_camera: Camera,
}

impl View {
    /// The virtual depth of something at `depth_m`, as [`DepthReference::virtual_depth_m`] has it.
    pub fn virtual_depth_m(&self, reference: &DepthReference, depth_m: f64) -> f64 {
        reference.virtual_depth_m(depth_m, &feature_camera(&self.input_camera))
    }

    /// Whether the image's border cuts a box in it.
    pub fn cuts(&self, box2d: &Box2d) -> bool {
        let [width, height] = self.image_size.map(|side| side as f64);
        box2d.reaches_border(width, height)
    }

    /// Height in pixels of the network's input of a box in the original image.
    pub fn input_height_px(&self, box2d: &Box2d) -> f64 {
        box2d.height() * self.input_camera.focal_y() / self.camera.focal_y()
    }
}

/// What to keep.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DecodeOptions {
    /// Detections have a score above this; without it above [`usual_min_score`].
    pub min_score: Option<f64>,
    /// At most so many detections an image.
    pub max_detections: usize,
}

impl Default for DecodeOptions {
    /// The usual score, at most 50 (as official SMOKE).
    fn default() -> Self {
        Self { min_score: None, max_detections: 50 }
    }
}

impl DecodeOptions {
    /// Detections have a score above this.
    pub fn min_score(&self, codec: &Codec) -> f64 {
        self.min_score.unwrap_or_else(|| usual_min_score(codec))
    }
}

/// A peak of 0.25, as official SMOKE; where scores are probabilities, what is more likely right than wrong.
pub fn usual_min_score(codec: &Codec) -> f64 {
    if is_calibrated(codec) { 0.5 } else { 0.25 }
}

fn is_calibrated(codec: &Codec) -> bool {
    codec.classes.iter().any(|class| class.score.is_some())
}

/// Bounds of a score (spec section 4).
pub(crate) const SCORE_LIMITS: (f64, f64) = (1e-4, 1.0 - 1e-4);

/// The detections in `maps`, highest score first (spec section 10).
///
/// Boxes that do not come out finite or lie behind the camera are left out.
pub fn detections(codec: &Codec, maps: &HeadMaps, view: &View, options: &DecodeOptions) -> Vec<Detection> {
    let regression = |cell| raw_regression(maps, cell);
    detections_at_peaks(codec, &maps.logits, maps.map_size, regression, view, options)
}

/// [`detections`] for a regression that is only computed where it is asked for: `regression` gives the raw channels at a cell.
pub fn detections_at_peaks(
    codec: &Codec,
    logits: &[f32],
    map_size: [usize; 2],
    regression: impl Fn([usize; 2]) -> [f64; CHANNELS],
    view: &View,
    options: &DecodeOptions,
) -> Vec<Detection> {
    let min_score = options.min_score(codec);
    // A low peak of a near object can stand for a high probability, so peaks are not what the highest ones are chosen by then.
    let (least_peak, most_peaks) =
        if is_calibrated(codec) { (LEAST_PEAK, usize::MAX) } else { (min_score, options.max_detections) };
    let camera = feature_camera(&view.input_camera);
    let mut found: Vec<Detection> = peaks(logits, map_size, most_peaks, logit(least_peak) as f32)
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
            found.range_sigma_m = codec.depth.sigma_m(found.box3d.depth_m(), found.score, is_cut, &camera);
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

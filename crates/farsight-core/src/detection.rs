//! What a detector says: the type that every method, stage and front end shares.

use crate::{Box2d, Box3d, Camera, ClassReference, DepthReference, MeasuredDepth, ObjectClass, Pose};

/// One vehicle or person found in an image.
#[derive(Debug, Clone, PartialEq)]
pub struct Detection {
    /// What it is.
    pub class: ObjectClass,
    /// Height of its peak, 0 to 1; of a model with calibrated scores the probability that it is right.
    pub score: f64,
    /// Around what is seen of it: the projected 3D box, or what the detector saw, clipped to the image, its pixels.
    pub box2d: Box2d,
    /// Where it is, rectified camera coordinates, metres.
    pub box3d: Box3d,
    /// Standard deviation of its depth ([`Box3d::depth_m`]), metres, when the model gives one;
    /// [`Detection::sigma_of_m`] has that of other distances.
    pub range_sigma_m: Option<f64>,
}

impl Detection {
    /// Standard deviation of another distance to it, `distance_m`: where the depth is wrong, the box lies elsewhere on
    /// its ray and is as much larger, and so all distances are wrong by the same factor.
    pub fn sigma_of_m(&self, distance_m: f64) -> Option<f64> {
        Some(self.range_sigma_m? * distance_m / self.box3d.depth_m())
    }

    /// Moves the box along its rays to this depth; it grows with the distance, so that the picture stays the same.
    pub fn move_to(&mut self, MeasuredDepth { depth_m, log_sigma }: MeasuredDepth) {
        self.box3d = self.box3d.scaled(depth_m / self.box3d.depth_m());
        self.range_sigma_m = Some(log_sigma * depth_m);
    }

    /// The detection in other coordinates, into which `other_from_this` takes points. Its error bar is the same share
    /// of its depth.
    #[must_use]
    pub fn moved(&self, other_from_this: &Pose) -> Self {
        self.at(self.box3d.moved(other_from_this))
    }

    /// The detection of which this one is what [`Detection::moved`] makes with `this_from_other`.
    #[must_use]
    pub fn moved_back(&self, this_from_other: &Pose) -> Self {
        self.at(self.box3d.moved_back(this_from_other))
    }

    fn at(&self, box3d: Box3d) -> Self {
        Self { class: self.class.clone(), box3d, range_sigma_m: self.sigma_of_m(box3d.depth_m()), ..*self }
    }

    /// Observation angle, radians.
    pub fn alpha(&self) -> f64 {
        self.box3d.alpha()
    }

    /// The score times the probability, by the error bar, that the distance is right to [`Box3d::depth_tolerance_m`] at
    /// [`PLACE_OVERLAP`]; None without an error bar.
    ///
    /// Errors are taken to spread as Laplace's distribution does: many small ones and long tails.
    pub fn place_score(&self) -> Option<f64> {
        let scale_m = self.range_sigma_m? / std::f64::consts::SQRT_2;
        let tolerance_m = self.box3d.depth_tolerance_m(PLACE_OVERLAP);
        Some(self.score * (1.0 - (-tolerance_m / scale_m).exp()))
    }
}

impl MeasuredDepth {
    /// What a detection says of its depth, if it says how sure it is.
    pub fn of(detection: &Detection) -> Option<Self> {
        let depth_m = detection.box3d.depth_m();
        Some(Self { depth_m, log_sigma: detection.range_sigma_m? / depth_m })
    }
}

/// The overlap from which on a car is in its place, as KITTI judges.
pub const PLACE_OVERLAP: f64 = 0.7;

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
        reference.virtual_depth_m(depth_m, self.input_camera.focal_y())
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
    /// Detections have a score above this; without it above [`default_min_score`].
    pub min_score: Option<f64>,
    /// At most so many detections an image.
    pub max_detections: usize,
    /// Whether it is known how the camera stands, so that a detector that looks for the horizon has nothing to guess:
    /// its coordinates are level.
    pub is_level: bool,
}

impl Default for DecodeOptions {
    /// The usual score, at most 50 (as official SMOKE).
    fn default() -> Self {
        Self { min_score: None, max_detections: 50, is_level: false }
    }
}

impl DecodeOptions {
    /// Detections have a score above this.
    pub fn min_score(&self, classes: &[ClassReference]) -> f64 {
        self.min_score.unwrap_or_else(|| default_min_score(classes))
    }
}

/// Where scores are probabilities: what is more likely right than wrong.
pub const CALIBRATED_MIN_SCORE: f64 = 0.5;

/// [`CALIBRATED_MIN_SCORE`], or a peak of 0.25, as official SMOKE.
pub fn default_min_score(classes: &[ClassReference]) -> f64 {
    if is_calibrated(classes) { CALIBRATED_MIN_SCORE } else { 0.25 }
}

/// Whether scores are probabilities.
pub fn is_calibrated(classes: &[ClassReference]) -> bool {
    classes.iter().any(|class| class.score.is_some())
}

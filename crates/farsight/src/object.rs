//! What is told of an object, and which distance is meant.

use farsight_core::{Box2d, Box3d, Detection, ObjectClass};

/// Which distance is told.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RangeKind {
    /// Along the optical axis, KITTI's z.
    #[default]
    Depth,
    /// From the camera to the centre of the box.
    Euclidean,
    /// From the camera to the nearest point of the box.
    Nearest,
}

impl RangeKind {
    /// This distance to a box, metres.
    pub fn measure(self) -> fn(&Box3d) -> f64 {
        match self {
            Self::Depth => Box3d::depth_m,
            Self::Euclidean => Box3d::center_distance_m,
            Self::Nearest => Box3d::nearest_distance_m,
        }
    }
}

/// One vehicle or person found in an image.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct DetectedObject {
    /// What it is.
    pub class: ObjectClass,
    /// 0 to 1; of a model with calibrated scores the probability that it is right.
    pub score: f64,
    /// Around the projected 3D box, clipped to the image, pixels.
    pub box2d: Box2d,
    /// Where it is, rectified camera coordinates, metres.
    pub box3d: Box3d,
    /// Its distance, metres: the [`RangeKind`] that the pipeline was asked for.
    pub range_m: f64,
    /// Standard deviation of `range_m`, metres; not a number where the model has no error bars.
    pub range_sigma_m: f64,
    /// Standard deviation of the depth, metres.
    depth_sigma_m: Option<f64>,
}

impl DetectedObject {
    /// What is told of `detection` when this distance is asked for.
    pub fn new(detection: Detection, range: RangeKind) -> Self {
        let range_m = range.measure()(&detection.box3d);
        let range_sigma_m = detection.sigma_of_m(range_m).unwrap_or(f64::NAN);
        let Detection { class, score, box2d, box3d, range_sigma_m: depth_sigma_m } = detection;
        Self { class, score, box2d, box3d, range_m, range_sigma_m, depth_sigma_m }
    }

    /// The error bar, where there is one.
    pub fn sigma_m(&self) -> Option<f64> {
        Some(self.range_sigma_m).filter(|sigma_m| sigma_m.is_finite())
    }

    /// Observation angle, radians.
    pub fn alpha(&self) -> f64 {
        self.box3d.alpha()
    }
}

/// The detection as evaluation, drawing and result files take it; its error bar is that of the depth.
impl From<DetectedObject> for Detection {
    fn from(object: DetectedObject) -> Self {
        let DetectedObject { class, score, box2d, box3d, depth_sigma_m, .. } = object;
        Self { class, score, box2d, box3d, range_sigma_m: depth_sigma_m }
    }
}

/// [`Detection`]s of many objects.
pub fn detections(objects: &[DetectedObject]) -> Vec<Detection> {
    objects.iter().cloned().map(Detection::from).collect()
}

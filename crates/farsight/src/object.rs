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
    /// Around what is seen of it: about the projected 3D box, clipped to the image, pixels.
    pub box2d: Box2d,
    /// Where it is, rectified camera coordinates, metres.
    pub box3d: Box3d,
    /// Its distance, metres: the [`RangeKind`] that the pipeline was asked for.
    pub range_m: f64,
    /// Standard deviation of `range_m`, metres; not a number where the model has no error bars.
    pub range_sigma_m: f64,
    /// The distance lies between these with a probability of 50, 68 and 90%, metres; not numbers where the model has no
    /// error bars. The second is `range_m` give or take `range_sigma_m`, in proportion.
    pub range_intervals_m: [[f64; 2]; 3],
    /// How far down the camera was taken to look, radians; 0 where nothing was. The box stands upright on the road, not
    /// across the camera's axis.
    pub pitch_rad: f64,
    /// Standard deviation of the depth, metres.
    depth_sigma_m: Option<f64>,
}

impl DetectedObject {
    /// What is told of `detection` when this distance is asked for. `interval_sigmas` are half the widths of the
    /// intervals that hold 50 and 90%, error bars ([`farsight_core::DepthFusion::interval_sigmas`]).
    pub fn new(detection: Detection, range: RangeKind, interval_sigmas: [f64; 2]) -> Self {
        let range_m = range.measure()(&detection.box3d);
        let range_sigma_m = detection.sigma_of_m(range_m).unwrap_or(f64::NAN);
        let Detection { class, score, box2d, box3d, range_sigma_m: depth_sigma_m } = detection;
        // Errors of distances are in proportion to them: as likely a factor too far as too near.
        let log_sigma = range_sigma_m / range_m;
        let [half, most] = interval_sigmas;
        let range_intervals_m =
            [half, 1.0, most].map(|sigmas| [-1.0, 1.0].map(|side: f64| range_m * (side * sigmas * log_sigma).exp()));
        Self { class, score, box2d, box3d, range_m, range_sigma_m, range_intervals_m, pitch_rad: 0.0, depth_sigma_m }
    }

    /// This object, seen by a camera that looks down by `pitch_rad`.
    #[must_use]
    pub fn with_pitch(self, pitch_rad: f64) -> Self {
        Self { pitch_rad, ..self }
    }

    /// The error bar, where there is one.
    pub fn sigma_m(&self) -> Option<f64> {
        Some(self.range_sigma_m).filter(|sigma_m| sigma_m.is_finite())
    }

    /// The intervals that hold the distance with a probability of 50, 68 and 90%, where there is an error bar.
    pub fn intervals_m(&self) -> Option<[[f64; 2]; 3]> {
        self.sigma_m().map(|_| self.range_intervals_m)
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

#[cfg(test)]
mod tests {
    use farsight_core::Dimensions;
    use farsight_core::depth_fusion::NORMAL_INTERVAL_SIGMAS;

    use super::*;

    fn object(range_sigma_m: Option<f64>) -> DetectedObject {
        let dimensions = Dimensions { height: 1.5, width: 1.6, length: 3.9 };
        let box3d = Box3d { dimensions, location: [0.0, 1.6, 20.0], yaw: 0.0 };
        let box2d = Box2d::new(0.0, 0.0, 50.0, 40.0);
        let detection = Detection { class: ObjectClass::Car, score: 0.7, box2d, box3d, range_sigma_m };
        DetectedObject::new(detection, RangeKind::Depth, NORMAL_INTERVAL_SIGMAS)
    }

    #[test]
    fn intervals_lie_one_inside_the_other_around_the_distance() {
        let found = object(Some(1.0)).intervals_m().unwrap();
        for [low, high] in found {
            assert!(((low * high).sqrt() - 20.0).abs() < 1e-9, "{found:?}");
        }
        assert!((found[1][1] / 20.0).ln() > 0.0499 && (found[1][1] / 20.0).ln() < 0.0501, "{found:?}");
        assert!(found[2][0] < found[1][0] && found[1][0] < found[0][0] && found[0][1] < found[2][1], "{found:?}");
        // However unsure, nothing is behind the camera.
        assert!(object(Some(100.0)).intervals_m().unwrap().iter().all(|[low, _]| *low > 0.0));
        assert_eq!(object(None).intervals_m(), None);
    }
}

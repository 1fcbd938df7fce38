//! What `farsight range --json` writes, one object an image, and `farsight track --json`, one object a frame.

use std::path::Path;

use farsight_core::{Camera, Lens};
use farsight_methods::camera_estimator::CameraEstimate;
use farsight_track::{EgoMotion, Track};
use image::RgbImage;
use serde::{Deserialize, Serialize};

use crate::camera_source::CameraOrigin;
use crate::object::DetectedObject;
use crate::pipeline::{ModelInfo, Pipeline};

/// Version of these types. It grows when a field changes its meaning; new fields leave it as it is.
pub const SCHEMA_VERSION: u32 = 1;

/// One image and what was found in it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct ImageRecord {
    /// The path; what of it is no text is replaced, as JSON has no other way.
    pub image: String,
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// What was found, highest score first.
    pub detections: Vec<DetectionRecord>,
    /// [`SCHEMA_VERSION`] of who wrote it; 0 in files from before there was one.
    #[serde(default)]
    pub schema_version: u32,
    /// The camera that distances were computed with.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<CameraRecord>,
    /// The models that looked.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<ModelRecord>,
    /// Version of the program.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub program_version: Option<String>,
}

/// One detection; pixels, metres, radians.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct DetectionRecord {
    /// What it is, by KITTI's name.
    pub class: String,
    /// 0 to 1.
    pub score: f64,
    /// Left, top, right, bottom.
    pub box2d: [f64; 4],
    /// Height, width, length.
    pub dimensions_hwl: [f64; 3],
    /// Bottom centre in rectified camera coordinates.
    pub location: [f64; 3],
    /// About the y axis; 0 faces x.
    pub rotation_y: f64,
    /// Observation angle.
    pub alpha: f64,
    /// Distance, of the kind that was asked for.
    pub range_m: f64,
    /// Standard deviation of `range_m`; null where the model has no error bars.
    pub range_sigma_m: Option<f64>,
    /// `range_m` lies between these with a probability of 90%; null where the model has no error bars.
    #[serde(default)]
    pub range_interval_m: Option<[f64; 2]>,
    /// With a probability of 50%.
    #[serde(default)]
    pub range_interval_50_m: Option<[f64; 2]>,
    /// With a probability of 68%.
    #[serde(default)]
    pub range_interval_68_m: Option<[f64; 2]>,
}

/// A camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct CameraRecord {
    /// From camera coordinates (metres) to homogeneous pixels of the upright image, row by row.
    pub projection: [[f64; 4]; 3],
    /// Where it comes from, where that is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub origin: Option<CameraOrigin>,
    /// What it was estimated to be, where it was.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub estimate: Option<CameraEstimateRecord>,
    /// How far down it was taken to look, degrees, where nothing but what is seen tells or somebody does; none where
    /// that is nothing. Positions are in its coordinates all the same, and boxes upright on the road.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pitch_deg: Option<f64>,
    /// What distorts the image, as `--lens` takes it; the projection is that of the pinhole behind.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lens: Option<String>,
}

/// A camera that was estimated from its image.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct CameraEstimateRecord {
    /// Horizontal field of view, degrees.
    pub hfov_deg: f64,
    /// It lies between these two with a probability of 68%.
    pub hfov_interval_68_deg: [f64; 2],
    /// How far the camera looks down, degrees.
    pub pitch_deg: f64,
    /// Standard deviation of that.
    pub pitch_sigma_deg: f64,
    /// How far the horizon falls to the right, degrees.
    pub roll_deg: f64,
    /// Standard deviation of that.
    pub roll_sigma_deg: f64,
}

/// The models of a pipeline.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct ModelRecord {
    /// Name of the detector, or its file.
    pub name: String,
    /// SHA-256 of the detector's weights.
    pub weights_sha256: Option<String>,
    /// SHA-256 of the refiner's weights; null without one.
    pub refiner_sha256: Option<String>,
    /// SHA-256 of the plate reader's weights; null without one.
    pub plates_sha256: Option<String>,
}

impl ImageRecord {
    /// What `pipeline` found in the image called `path`, taken by `camera`.
    pub fn new(
        path: impl AsRef<Path>,
        image: &RgbImage,
        camera: &Camera,
        objects: &[DetectedObject],
        pipeline: &Pipeline,
    ) -> Self {
        let pitch_deg = objects.first().map(|object| object.pitch_rad.to_degrees()).filter(|degrees| *degrees != 0.0);
        let projection = camera.projection;
        Self {
            image: path.as_ref().to_string_lossy().into_owned(),
            width: image.width(),
            height: image.height(),
            detections: objects.iter().map(DetectionRecord::from).collect(),
            schema_version: SCHEMA_VERSION,
            camera: Some(CameraRecord { projection, origin: None, estimate: None, pitch_deg, lens: None }),
            model: Some(pipeline.info().into()),
            program_version: Some(crate::VERSION.to_owned()),
        }
    }

    /// This record with the lens of its camera, where there is one.
    #[must_use]
    pub fn with_lens(mut self, lens: Option<Lens>) -> Self {
        if let Some(camera) = &mut self.camera {
            camera.lens = lens.map(|lens| lens.to_string());
        }
        self
    }

    /// This record with what its camera was estimated to be, where it was.
    #[must_use]
    pub fn with_camera_estimate(mut self, estimate: Option<CameraEstimate>) -> Self {
        if let Some(camera) = &mut self.camera {
            let width = self.width as usize;
            camera.estimate = estimate.map(|estimate| CameraEstimateRecord {
                hfov_deg: estimate.hfov_deg(width),
                hfov_interval_68_deg: estimate.hfov_interval_deg(width),
                pitch_deg: estimate.pitch_rad[0].to_degrees(),
                pitch_sigma_deg: estimate.pitch_rad[1].to_degrees(),
                roll_deg: estimate.roll_rad[0].to_degrees(),
                roll_sigma_deg: estimate.roll_rad[1].to_degrees(),
            });
        }
        self
    }

    /// This record with word of where its camera comes from.
    #[must_use]
    pub fn with_camera_origin(mut self, origin: CameraOrigin) -> Self {
        if let Some(camera) = &mut self.camera {
            camera.origin = Some(origin);
        }
        self
    }
}

impl From<&DetectedObject> for DetectionRecord {
    fn from(object: &DetectedObject) -> Self {
        let DetectedObject { class, score, box2d, box3d, range_m, .. } = object;
        let size = box3d.dimensions;
        let interval = |place: usize| object.intervals_m().map(|intervals| intervals[place]);
        Self {
            class: class.to_string(),
            score: *score,
            box2d: [box2d.x1, box2d.y1, box2d.x2, box2d.y2],
            dimensions_hwl: [size.height, size.width, size.length],
            location: box3d.location,
            rotation_y: box3d.yaw,
            alpha: object.alpha(),
            range_m: *range_m,
            range_sigma_m: object.sigma_m(),
            range_interval_m: interval(2),
            range_interval_50_m: interval(0),
            range_interval_68_m: interval(1),
        }
    }
}

/// One frame of a video and the tracks in it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct FrameRecord {
    /// Its number, from 0.
    pub frame: u64,
    /// Its time, seconds.
    pub time_s: f64,
    /// How the camera moves, where that is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ego: Option<EgoRecord>,
    /// The tracks by their identities, those that coast included.
    pub tracks: Vec<TrackRecord>,
}

/// How the camera moves over the ground.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct EgoRecord {
    /// Ahead, m/s.
    pub speed_mps: f64,
    /// Its standard deviation.
    pub speed_sigma_mps: f64,
    /// To the left, rad/s.
    pub yaw_rate: f64,
    /// Its standard deviation.
    pub yaw_rate_sigma: f64,
}

impl From<&EgoMotion> for EgoRecord {
    fn from(ego: &EgoMotion) -> Self {
        let EgoMotion { speed_mps, speed_sigma_mps, yaw_rate, yaw_rate_sigma } = *ego;
        Self { speed_mps, speed_sigma_mps, yaw_rate, yaw_rate_sigma }
    }
}

/// One track in one frame; pixels, metres, radians, seconds. Velocities are relative to the camera, in its coordinates;
/// they are null where they are not known yet.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[allow(clippy::option_option, reason = "left out without the camera's motion, null where a velocity is not known yet")]
#[non_exhaustive]
pub struct TrackRecord {
    /// Its identity, from 1.
    pub id: u64,
    /// What it is, by KITTI's name.
    pub class: String,
    /// Of its latest detection, 0 to 1.
    pub score: f64,
    /// Frames since its first detection, this one included.
    pub age: u64,
    /// Left, top, right, bottom: as detected, or as expected while it coasts.
    pub box2d: [f64; 4],
    /// Height, width, length.
    pub dimensions_hwl: [f64; 3],
    /// Bottom centre in rectified camera coordinates.
    pub location: [f64; 3],
    /// About the y axis; 0 faces x.
    pub rotation_y: f64,
    /// Depth: z of the location.
    pub range_m: f64,
    /// Its standard deviation.
    pub range_sigma_m: f64,
    /// `range_m` lies between these with a probability of 90%.
    pub range_interval_m: [f64; 2],
    /// To the right, down and ahead.
    pub velocity_mps: Option<[f64; 3]>,
    /// Their standard deviations.
    pub velocity_sigma_mps: Option<[f64; 3]>,
    /// By so much `range_m` shrinks in a second.
    pub closing_mps: Option<f64>,
    /// Its standard deviation.
    pub closing_sigma_mps: Option<f64>,
    /// Until the nearest face reaches the camera at this speed; null unless it closes with a probability of 80%.
    pub ttc_s: Option<f64>,
    /// That time is between these with a probability of 90%; the second is null where it may never be, and all of it
    /// where the object surely does not close.
    pub ttc_interval_s: Option<(f64, Option<f64>)>,
    /// Probability that it is in our way then, if neither changes its velocity; null where `ttc_s` is.
    #[serde(default)]
    pub in_path_probability: Option<f64>,
    /// By so much the closing speed grows in a second, m/s²; null where that is not known yet.
    #[serde(default)]
    pub closing_acceleration_mps2: Option<f64>,
    /// Its standard deviation.
    #[serde(default)]
    pub closing_acceleration_sigma_mps2: Option<f64>,
    /// Whether nothing was seen of it in this frame.
    pub coasting: bool,
    /// Speed over the ground, where the camera's motion is known; null where the velocity is not known yet.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed_mps: Option<Option<f64>>,
    /// Its standard deviation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed_sigma_mps: Option<Option<f64>>,
}

impl FrameRecord {
    /// These tracks in the frame of this number and time, with speeds over the ground if the camera's motion is known.
    pub fn new(frame: u64, time_s: f64, tracks: &[Track], ego: Option<&EgoMotion>) -> Self {
        let records = tracks.iter().map(|track| TrackRecord::new(track, ego)).collect();
        Self { frame, time_s, ego: ego.map(EgoRecord::from), tracks: records }
    }
}

impl TrackRecord {
    fn new(track: &Track, ego: Option<&EgoMotion>) -> Self {
        let Track { id, class, score, age, box2d, box3d, range_sigma_m, velocity, closing, coasting, .. } = track;
        let size = box3d.dimensions;
        let speed = ego.map(|ego| track.speed_mps(ego));
        let acceleration = closing.and_then(|closing| closing.acceleration);
        Self {
            id: *id,
            class: class.to_string(),
            score: *score,
            age: *age,
            box2d: [box2d.x1, box2d.y1, box2d.x2, box2d.y2],
            dimensions_hwl: [size.height, size.width, size.length],
            location: box3d.location,
            rotation_y: box3d.yaw,
            range_m: track.range_m(),
            range_sigma_m: *range_sigma_m,
            range_interval_m: track.range_interval_m(),
            velocity_mps: velocity.map(|velocity| velocity.mps),
            velocity_sigma_mps: velocity.map(|velocity| velocity.sigma_mps),
            closing_mps: closing.map(|closing| closing.mps),
            closing_sigma_mps: closing.map(|closing| closing.sigma_mps),
            ttc_s: closing.and_then(|closing| closing.ttc_s),
            ttc_interval_s: closing.and_then(|closing| closing.ttc_interval_s),
            in_path_probability: closing.and_then(|closing| closing.in_path),
            closing_acceleration_mps2: acceleration.map(|one| one.closing_mps2),
            closing_acceleration_sigma_mps2: acceleration.map(|one| one.sigma_mps2),
            coasting: *coasting,
            speed_mps: speed.map(|speed| speed.map(|[speed, _]| speed)),
            speed_sigma_mps: speed.map(|speed| speed.map(|[_, sigma]| sigma)),
        }
    }
}

impl From<&ModelInfo> for ModelRecord {
    fn from(info: &ModelInfo) -> Self {
        let ModelInfo { name, weights_sha256, refiner_sha256, plates_sha256 } = info.clone();
        Self { name, weights_sha256, refiner_sha256, plates_sha256 }
    }
}

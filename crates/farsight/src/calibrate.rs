//! How a camera stands over its road, from the traffic that it sees.

use std::collections::VecDeque;

use farsight_core::overlap::iou_2d;
use farsight_core::road::{Road, RoadPlane};
use farsight_core::{Camera, Detection};
use farsight_methods::DetectError;
use image::RgbImage;
use thiserror::Error;

use crate::pipeline::Pipeline;

/// What overlaps by more than this with something in one of the last images stands still, and is no new witness.
const SAME_PLACE: f64 = 0.7;

/// So many images back is looked for what stands still.
const REMEMBERED_IMAGES: usize = 50;

/// On the road of a camera that does not move stands at least this share of what it sees.
const MIN_CARRIED: f64 = 0.8;

/// How a camera stands over its road.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraStand {
    /// The camera in level coordinates: y points straight down to the road, z ahead over it.
    pub camera: Camera,
    /// The road in those.
    pub road: RoadPlane,
    /// How far down the camera looks, radians, and the standard deviation of that.
    pub pitch_rad: [f64; 2],
    /// How far it leans to the right, radians, and the standard deviation of that.
    pub roll_rad: [f64; 2],
    /// How high it is above the road, metres, and the standard deviation of that.
    pub height_m: [f64; 2],
    /// Objects at places of their own, which tell this.
    pub objects: usize,
    /// Share of them that stands on the road, as far as their distances and boxes can tell.
    pub carried: f64,
}

impl CameraStand {
    /// Whether too little stands on this road: the camera moved, or there is another road.
    pub fn is_doubtful(&self) -> bool {
        self.carried < MIN_CARRIED
    }
}

/// Why nothing is known of how a camera stands.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CalibrateError {
    /// Calibration goes by error bars.
    #[error("{model}: a model without error bars, which calibration goes by")]
    NoErrorBars {
        /// Its name or file.
        model: String,
    },
    /// There is no road to find.
    #[error("--above-road none leaves nothing to find; expected metres, or any")]
    NoRoad,
    /// Too few objects, or all at one distance.
    #[error("not enough to tell how the camera stands; expected more traffic, at several distances")]
    NotEnough,
    /// Straight down there is no "ahead".
    #[error("the camera seems to look straight down; expected one that sees along its road")]
    StraightDown,
}

/// Finds out how a camera stands over its road, from many images of its traffic. The field of view must be known: with
/// another one pictures of traffic look the same.
///
/// Networks know level cameras better, so images are looked at in rounds: [`RoadCalibrator::end_round`] says what one
/// tells, and the next one begins there. Two are enough.
///
/// ```no_run
/// use farsight::{Camera, Pipeline, Road, RoadCalibrator};
///
/// let camera = Camera::from_hfov(70.0, 1280, 720)?;
/// let mut calibrator = RoadCalibrator::new(Pipeline::shipped()?, camera, Road::Below)?;
/// for _ in 0..2 {
///     for name in ["pole/1.jpg", "pole/2.jpg", "pole/3.jpg"] {
///         calibrator.add(&farsight::read_image(name)?)?;
///     }
///     let stand = calibrator.end_round()?;
///     println!("{:.1} ±{:.1} m above the road", stand.height_m[0], stand.height_m[1]);
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct RoadCalibrator {
    pipeline: Pipeline,
    road: Road,
    /// In coordinates as level as they are known.
    camera: Camera,
    traffic: Traffic,
}

impl RoadCalibrator {
    /// For `camera`, of whose road this is known.
    ///
    /// # Errors
    /// When `pipeline` has no error bars, or there is no road.
    pub fn new(pipeline: Pipeline, camera: Camera, road: Road) -> Result<Self, CalibrateError> {
        if road == Road::Ignored {
            return Err(CalibrateError::NoRoad);
        }
        if !pipeline.has_error_bars() {
            return Err(CalibrateError::NoErrorBars { model: pipeline.info().name.clone() });
        }
        Ok(Self { pipeline, road, camera, traffic: Traffic::default() })
    }

    /// Looks at an image as the pinhole sees it ([`crate::View::straightened`]).
    ///
    /// # Errors
    /// When the pipeline fails.
    pub fn add(&mut self, image: &RgbImage) -> Result<(), DetectError> {
        let found = self.pipeline.detect_off_road(image, &self.camera)?;
        self.traffic.add(found);
        Ok(())
    }

    /// Objects at places of their own so far, in this round.
    pub fn objects(&self) -> usize {
        self.traffic.images.iter().map(Vec::len).sum()
    }

    /// What the images since the last round tell.
    ///
    /// # Errors
    /// When they do not tell enough, or the camera looks straight down.
    pub fn end_round(&mut self) -> Result<CameraStand, CalibrateError> {
        let scale = self.pipeline.scale();
        let plane = RoadPlane::of(&self.traffic.images, self.road, &scale).ok_or(CalibrateError::NotEnough)?;
        let (camera, road) = plane.levelled(&self.camera).ok_or(CalibrateError::StraightDown)?;
        let [pitch_rad, roll_rad] = camera.attitude();
        let [slope_sigma, tilt_sigma, height_sigma] = road.sigmas;
        let stand = CameraStand {
            camera,
            road,
            pitch_rad: [pitch_rad, slope_sigma],
            roll_rad: [-roll_rad, tilt_sigma],
            height_m: [road.height_m, height_sigma],
            objects: self.objects(),
            carried: plane.carries(&self.traffic.images, &scale),
        };
        (self.camera, self.traffic) = (camera, Traffic::default());
        Ok(stand)
    }
}

/// What one camera saw.
#[derive(Default)]
struct Traffic {
    /// By image; what stands still only once.
    images: Vec<Vec<Detection>>,
    /// All that was found in the last images.
    latest: VecDeque<Vec<Detection>>,
}

impl Traffic {
    fn add(&mut self, found: Vec<Detection>) {
        let stands_still =
            |one: &Detection| self.latest.iter().flatten().any(|other| iou_2d(&one.box2d, &other.box2d) > SAME_PLACE);
        self.images.push(found.iter().filter(|one| !stands_still(one)).cloned().collect());
        self.latest.push_back(found);
        if self.latest.len() > REMEMBERED_IMAGES {
            self.latest.pop_front();
        }
    }
}

//! What a pipeline is made of, for one thread: detector, refiner, plate reader, suppression, road.

use farsight_core::depth_fusion::NORMAL_INTERVAL_SIGMAS;
use farsight_core::detection::{CALIBRATED_MIN_SCORE, DecodeOptions, default_min_score};
use farsight_core::nms::bev_nms;
use farsight_core::pitch::camera_from_level;
use farsight_core::road::{HeightConflict, Road, SURE_SCORE, fit_to_road};
use farsight_core::{Camera, Detection, Pitch, ScalePrior};
use farsight_methods::plate_reader::PlateReader;
use farsight_methods::refiner::Refiner;
use farsight_methods::{DetectError, Detector};
use farsight_runtime::timing::timed;
use farsight_runtime::{EngineError, StageTimes};
use image::RgbImage;

use crate::object::RangeKind;
use crate::view::View;

/// What is asked of a pipeline.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Settings {
    pub(crate) decode: DecodeOptions,
    /// What has a score from this on is told, too, as far as the work for higher scores brings it.
    pub(crate) low_score: Option<f64>,
    /// Of detections that overlap by more than this as seen from above the best stays.
    pub(crate) max_overlap: f64,
    /// What is known of the road under the camera.
    pub(crate) road: Road,
    /// Whether somebody said so, whatever is known of single cameras.
    pub(crate) is_road_chosen: bool,
    /// How far down the camera looks, radians; without it what is seen tells.
    pub(crate) pitch_rad: Option<f64>,
    /// What is known of the scale of all distances in an image.
    pub(crate) scale: ScalePrior,
    pub(crate) range: RangeKind,
    /// Whether noisy images are smoothed first.
    pub(crate) denoise: bool,
    /// How many threads it was made for.
    pub(crate) side_by_side: usize,
}

impl Settings {
    /// Whether it is known how the camera stands.
    fn is_level(&self) -> bool {
        self.pitch_rad.is_some() || matches!(self.road, Road::Known(_))
    }

    /// These for an image of which more is known: the road under it, or how sure its focal length is. By as much as
    /// that is wrong all its distances are.
    pub(crate) fn of_view(&self, view: &View) -> Self {
        let road = view.known_road().filter(|_| !self.is_road_chosen).unwrap_or(self.road);
        Self { road, scale: self.scale.widened(view.focal_log_sigma()), ..*self }
    }
}

/// The networks of a pipeline, ready to run in one thread.
pub(crate) struct Stages {
    pub(crate) detector: Box<dyn Detector>,
    /// Refines what was found.
    pub(crate) refiner: Option<Refiner>,
    /// What measures vehicles by their number plates.
    pub(crate) plate_reader: Option<PlateReader>,
    /// Of images in which what was found contradicts the height of the camera that was given, since they were last
    /// taken.
    pub(crate) height_conflicts: Vec<HeightConflict>,
    /// By how much images were taken to look down, radians, since these were last taken.
    pub(crate) pitches_rad: Vec<f64>,
}

/// What has a first score above this share of the least score that counts is refined: the refiner can raise it so far.
const CANDIDATE_SHARE: f64 = 0.2;

/// What is in an image.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Found {
    /// In the coordinates of its camera.
    pub(crate) detections: Vec<Detection>,
    /// How far down the camera was taken to look, radians.
    pub(crate) pitch_rad: f64,
}

/// How the camera of an image stands.
struct Standing {
    /// In the coordinates in which everything is looked for: level ones, where they are known.
    camera: Camera,
    /// How far down it looks, radians; none where the coordinates are its own.
    pitch_rad: Option<f64>,
}

impl Standing {
    /// Of a camera that somebody says looks down by `pitch_rad`. A turned one is level in its coordinates.
    fn told(camera: &Camera, pitch_rad: Option<f64>) -> Self {
        match pitch_rad.filter(|_| camera.is_upright()) {
            Some(pitch_rad) => Self::pitched(camera, pitch_rad),
            None => Self { camera: *camera, pitch_rad: None },
        }
    }

    fn pitched(camera: &Camera, pitch_rad: f64) -> Self {
        Self { camera: camera.moved(&camera_from_level(pitch_rad).inverse()), pitch_rad: Some(pitch_rad) }
    }
}

/// Smaller pitches are within the error of what is seen, radians; nobody is told of them.
const LEAST_TOLD_RAD: f64 = 0.035;

impl Stages {
    /// The same for another thread; weights are shared where the engine can.
    pub(crate) fn share(&self) -> Result<Self, EngineError> {
        Ok(Self {
            detector: self.detector.share()?,
            refiner: self.refiner.as_ref().map(Refiner::share).transpose()?,
            plate_reader: self.plate_reader.as_ref().map(PlateReader::share).transpose()?,
            height_conflicts: Vec::new(),
            pitches_rad: Vec::new(),
        })
    }

    /// Whether what they find has error bars.
    pub(crate) fn has_error_bars(&self) -> bool {
        self.detector.has_error_bars() || self.refiner.is_some()
    }

    /// Half the widths of the intervals that hold 50 and 90%, error bars: the refiner's, and a normal distribution's
    /// without one.
    pub(crate) fn interval_sigmas(&self) -> [f64; 2] {
        self.refiner.as_ref().map_or(NORMAL_INTERVAL_SIGMAS, Refiner::interval_sigmas)
    }

    /// What is in each image, highest score first, and the time of each stage for all of them.
    pub(crate) fn detect_batch(
        &mut self,
        images: &[(&RgbImage, &Camera)],
        settings: &Settings,
    ) -> Result<(Vec<Found>, StageTimes), DetectError> {
        let options = self.detector_options(settings);
        let mut standing: Vec<Standing> =
            images.iter().map(|(_, camera)| Standing::told(camera, settings.pitch_rad)).collect();
        let seen: Vec<(&RgbImage, &Camera)> =
            images.iter().zip(&standing).map(|((image, _), standing)| (*image, &standing.camera)).collect();
        let (mut answers, times) = self.detector.detect_batch(&seen, &options)?;
        for ((found, standing), (image, _)) in answers.iter_mut().zip(&mut standing).zip(images) {
            self.level(image, standing, found, settings);
        }
        let (answers, refine) = timed(|| self.refined(images, &standing, answers, settings));
        let min_score = self.told_score(settings);
        let answers = answers?;
        let doubt = |found: &Vec<Detection>| HeightConflict::of(found, settings.road, &settings.scale);
        self.height_conflicts.extend(answers.iter().filter_map(doubt));
        let answers = answers.into_iter().zip(&standing).map(|(found, standing)| {
            let mut detections = told(found, min_score, settings);
            if let Some(pitch_rad) = standing.pitch_rad {
                let camera_from_level = camera_from_level(pitch_rad);
                detections = detections.iter().map(|one| one.moved(&camera_from_level)).collect();
            }
            Found { detections, pitch_rad: standing.pitch_rad.unwrap_or(0.0) }
        });
        Ok((answers.collect(), StageTimes { refine, ..times }))
    }

    /// Turns camera and detections to level coordinates where what was found tells how far down an image looks, and
    /// nothing else does: a refiner knows upright things.
    fn level(&mut self, image: &RgbImage, standing: &mut Standing, found: &mut [Detection], settings: &Settings) {
        if self.refiner.is_none() || settings.is_level() || !standing.camera.is_upright() {
            return;
        }
        let size = [image.width(), image.height()].map(|side| side as usize);
        let Some(pitch_rad) = Pitch::of(found, &standing.camera, size).worthwhile_rad() else { return };
        if pitch_rad.abs() > LEAST_TOLD_RAD {
            self.pitches_rad.push(pitch_rad);
        }
        *standing = Standing::pitched(&standing.camera, pitch_rad);
        for detection in found {
            *detection = detection.moved_back(&camera_from_level(pitch_rad));
        }
    }

    /// The answers after the second stages, where there are such.
    fn refined(
        &mut self,
        images: &[(&RgbImage, &Camera)],
        standing: &[Standing],
        answers: Vec<Vec<Detection>>,
        settings: &Settings,
    ) -> Result<Vec<Vec<Detection>>, EngineError> {
        let sought = self.least_score(settings);
        let (least_score, classes) = (sought.min(self.told_score(settings)), self.detector.classes());
        let each = images.iter().zip(standing).zip(answers);
        each.map(|(((image, _), Standing { camera, .. }), mut found)| {
            if let Some(refiner) = &mut self.refiner {
                found = refiner.refined(image, camera, found, classes, least_score, sought)?;
            }
            match &mut self.plate_reader {
                Some(reader) => reader.measured(image, camera, found),
                None => Ok(found),
            }
        })
        .collect()
    }

    /// What the detector must find: all that is asked for, and where a refiner follows what that could raise to it.
    fn detector_options(&self, settings: &Settings) -> DecodeOptions {
        let share = if self.refiner.is_some() { CANDIDATE_SHARE } else { 1.0 };
        let least = (share * self.least_score(settings)).min(self.told_score(settings));
        DecodeOptions { min_score: Some(least), is_level: settings.is_level(), ..settings.decode }
    }

    /// What has a lower score is not told.
    fn told_score(&self, settings: &Settings) -> f64 {
        let asked = self.min_score(settings);
        settings.low_score.map_or(asked, |low| low.min(asked))
    }

    /// What has a lower score plays no part. What stands on the road has, told or not.
    fn least_score(&self, settings: &Settings) -> f64 {
        let asked = self.min_score(settings);
        if settings.road == Road::Ignored { asked } else { asked.min(SURE_SCORE) }
    }

    fn min_score(&self, settings: &Settings) -> f64 {
        settings.decode.min_score.unwrap_or_else(|| self.default_min_score())
    }

    /// The score that counts unless another is asked for: 0.5 where scores are probabilities, the refiner's or the
    /// detector's own.
    pub(crate) fn default_min_score(&self) -> f64 {
        let is_calibrated = self.refiner.as_ref().is_some_and(Refiner::is_calibrated);
        if is_calibrated { CALIBRATED_MIN_SCORE } else { default_min_score(self.detector.classes()) }
    }
}

/// `found` on its road, as far as it was asked for, each place taken once.
fn told(found: Vec<Detection>, min_score: f64, settings: &Settings) -> Vec<Detection> {
    let mut told = fit_to_road(found, settings.road, &settings.scale);
    told.retain(|detection| detection.score > min_score);
    bev_nms(told, settings.max_overlap)
}

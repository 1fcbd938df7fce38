//! From an image and its camera to what is told: a detector, the second stages that look at what it found, and the road under all of it.

use farsight_core::detection::{DecodeOptions, default_min_score};
use farsight_core::road::{Road, SURE_SCORE, on_one_road};
use farsight_core::{Camera, Detection};
use farsight_methods::plate_reader::PlateReader;
use farsight_methods::refiner::Refiner;
use farsight_methods::{DetectError, Detector};
use farsight_runtime::timing::timed;
use farsight_runtime::{EngineError, StageTimes};
use image::RgbImage;

/// A model ready to look at images, with all that follows its first look.
pub(crate) struct Pipeline {
    detector: Box<dyn Detector>,
    options: DecodeOptions,
    /// What looks again at what was found.
    refiner: Option<Refiner>,
    /// What measures vehicles by their number plates.
    plate_reader: Option<PlateReader>,
    /// What is known of the road under the camera.
    road: Road,
}

/// What has a first score above this share of the least score that counts is refined: the refiner can raise it so far.
const CANDIDATE_SHARE: f64 = 0.2;

impl Pipeline {
    /// The detector alone.
    pub(crate) fn new(detector: Box<dyn Detector>, options: DecodeOptions) -> Self {
        Self { detector, options, refiner: None, plate_reader: None, road: Road::Ignored }
    }

    /// This pipeline with a second look at what its detector finds.
    #[must_use]
    pub(crate) fn with_refiner(self, refiner: Refiner) -> Self {
        Self { refiner: Some(refiner), ..self }
    }

    /// This pipeline with a reading of the number plates of the vehicles that it finds.
    #[must_use]
    pub(crate) fn with_plate_reader(self, plate_reader: PlateReader) -> Self {
        Self { plate_reader: Some(plate_reader), ..self }
    }

    /// This pipeline for a camera above a `road`: what it finds is put on one plane ([`on_one_road`]).
    #[must_use]
    pub(crate) fn with_road(self, road: Road) -> Self {
        Self { road, ..self }
    }

    /// What makes the first look.
    pub(crate) fn detector(&self) -> &dyn Detector {
        &*self.detector
    }

    /// Whether what it finds has error bars.
    pub(crate) fn has_error_bars(&self) -> bool {
        self.detector.has_error_bars() || self.refiner.is_some()
    }

    /// What is in `image`, taken by `camera`; highest score first.
    ///
    /// # Errors
    /// As [`Detector::detect_batch`].
    pub(crate) fn detect(&mut self, image: &RgbImage, camera: &Camera) -> Result<Vec<Detection>, DetectError> {
        let (mut answers, _) = self.detect_batch_timed(&[(image, camera)])?;
        Ok(answers.pop().unwrap_or_default())
    }

    /// [`Pipeline::detect`] for several images that the detector's engine sees together, and the time of each stage for all of them.
    ///
    /// # Errors
    /// As [`Detector::detect_batch`].
    pub(crate) fn detect_batch_timed(
        &mut self,
        images: &[(&RgbImage, &Camera)],
    ) -> Result<(Vec<Vec<Detection>>, StageTimes), DetectError> {
        let options = self.first_look_options();
        let (answers, times) = self.detector.detect_batch(images, &options)?;
        let (answers, refine) = timed(|| self.refined(images, answers));
        let answers = answers?.into_iter().map(|found| self.told(found)).collect();
        Ok((answers, StageTimes { refine, ..times }))
    }

    /// The answers after the second stages, where there are such.
    fn refined(
        &mut self,
        images: &[(&RgbImage, &Camera)],
        answers: Vec<Vec<Detection>>,
    ) -> Result<Vec<Vec<Detection>>, EngineError> {
        let least_score = self.least_score();
        let classes = self.detector.classes();
        let each = images.iter().zip(answers);
        each.map(|((image, camera), mut found)| {
            if let Some(refiner) = &mut self.refiner {
                found = refiner.refined(image, camera, found, classes, least_score)?;
            }
            match &mut self.plate_reader {
                Some(reader) => reader.measured(image, camera, found),
                None => Ok(found),
            }
        })
        .collect()
    }

    /// What the first look must find: all that is asked for, and where a refiner follows what that could raise to it.
    fn first_look_options(&self) -> DecodeOptions {
        let share = if self.refiner.is_some() { CANDIDATE_SHARE } else { 1.0 };
        DecodeOptions { min_score: Some(share * self.least_score()), ..self.options }
    }

    /// What has a lower score plays no part. What stands on the road has, told or not.
    fn least_score(&self) -> f64 {
        let asked = self.min_score();
        if self.road == Road::Ignored { asked } else { asked.min(SURE_SCORE) }
    }

    fn min_score(&self) -> f64 {
        self.options.min_score.unwrap_or_else(|| default_min_score(self.detector.classes()))
    }

    /// `found` on its road, as far as it was asked for.
    fn told(&self, found: Vec<Detection>) -> Vec<Detection> {
        let mut told = on_one_road(found, self.road);
        told.retain(|detection| detection.score > self.min_score());
        told
    }
}

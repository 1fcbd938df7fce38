//! From an image and its camera to detections.

use farsight_core::codec::CHANNELS;
use farsight_core::detection::{DecodeOptions, View, detections, detections_at_peaks};
use farsight_core::road::{Road, SURE_SCORE, on_one_road};
use farsight_core::{Camera, Detection, HeadMaps};
use image::RgbImage;
use thiserror::Error;

use crate::timing::timed;
use crate::{DetectorSpec, Engine, EngineError, PeaksHead, StageTimes};

/// A model ready to look at images.
pub struct Detector {
    engine: Box<dyn Engine>,
    spec: DetectorSpec,
    /// What the engine's network leaves to be done at the peaks.
    head: Option<PeaksHead>,
    /// What looks again at what was found.
    #[cfg(feature = "rten")]
    refiner: Option<crate::Refiner>,
    /// What measures vehicles by their number plates.
    #[cfg(feature = "rten")]
    plate_reader: Option<crate::PlateReader>,
    /// What is known of the road under the camera.
    road: Road,
    /// The network's inputs, kept from batch to batch.
    inputs: Vec<Vec<f32>>,
}

/// What has a first score above this share of the least score that counts is looked at again: a second look can raise it so far.
const CANDIDATE_SHARE: f64 = 0.2;

/// An image for which there is no answer.
#[derive(Debug, Error)]
pub enum DetectError {
    /// The image has no pixels.
    #[error("the image is {width} x {height} pixels; expected at least one pixel")]
    Empty {
        /// Its width, pixels.
        width: u32,
        /// Its height, pixels.
        height: u32,
    },
    /// The images of a batch need inputs of different sizes.
    #[error("image {index} of the batch needs an input of {found:?} pixels; the first one needs {expected:?}")]
    InputSize {
        /// Its place in the batch, from 0.
        index: usize,
        /// Width and height of its input.
        found: [usize; 2],
        /// Width and height of the first one's.
        expected: [usize; 2],
    },
    /// The engine failed.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// The engine's answer does not fit the model's description.
    #[error("the engine {engine} gave {found} values of the {map}; expected {expected} for {width} x {height} cells")]
    Maps {
        /// Name of the engine.
        engine: String,
        /// `heat map` or `regression map`.
        map: &'static str,
        /// How many values it gave.
        found: usize,
        /// How many the model has.
        expected: usize,
        /// Width of the maps, cells.
        width: usize,
        /// Height of the maps, cells.
        height: usize,
    },
}

impl Detector {
    /// A detector that runs the model of `spec` on `engine`.
    pub fn new(engine: Box<dyn Engine>, spec: DetectorSpec) -> Self {
        Self {
            engine,
            spec,
            head: None,
            #[cfg(feature = "rten")]
            refiner: None,
            #[cfg(feature = "rten")]
            plate_reader: None,
            road: Road::Ignored,
            inputs: Vec::new(),
        }
    }

    /// As [`Detector::new`], for a network that ends before its regression `head`.
    pub fn with_peaks_head(engine: Box<dyn Engine>, spec: DetectorSpec, head: PeaksHead) -> Self {
        Self { head: Some(head), ..Self::new(engine, spec) }
    }

    /// This detector with a second look at what it finds.
    #[cfg(feature = "rten")]
    #[must_use]
    pub fn with_refiner(self, refiner: crate::Refiner) -> Self {
        Self { refiner: Some(refiner), ..self }
    }

    /// This detector with a reading of the number plates of the vehicles that it finds.
    #[cfg(feature = "rten")]
    #[must_use]
    pub fn with_plate_reader(self, plate_reader: crate::PlateReader) -> Self {
        Self { plate_reader: Some(plate_reader), ..self }
    }

    /// This detector for a camera above a `road`: what it finds is put on one plane ([`on_one_road`]).
    #[must_use]
    pub fn with_road(self, road: Road) -> Self {
        Self { road, ..self }
    }

    /// Whether what it finds has error bars.
    pub fn has_error_bars(&self) -> bool {
        self.spec.codec.depth.error.is_some() || self.has_refiner()
    }

    /// Name of the engine.
    pub fn engine_name(&self) -> &str {
        self.engine.name()
    }

    /// What it knows of the model.
    pub fn spec(&self) -> &DetectorSpec {
        &self.spec
    }

    /// What is in `image`, taken by `camera`; highest score first.
    ///
    /// Locations are in the camera's coordinates, 2D boxes in pixels of `image`. They are projected by the whole camera even for models that see it without its
    /// fourth column, so that they lie where the image shows the object; official SMOKE's own 2D boxes stand off by up to 9 pixels at 5 m (spec 5.6).
    ///
    /// # Errors
    /// When the image has no pixels, the engine fails, or its answer does not fit the model.
    pub fn detect(&mut self, image: &RgbImage, camera: &Camera) -> Result<Vec<Detection>, DetectError> {
        self.detect_timed(image, camera).map(|(detections, _)| detections)
    }

    /// [`Detector::detect`], and the time of each stage.
    ///
    /// # Errors
    /// As [`Detector::detect`].
    pub fn detect_timed(
        &mut self,
        image: &RgbImage,
        camera: &Camera,
    ) -> Result<(Vec<Detection>, StageTimes), DetectError> {
        let (mut answers, times) = self.detect_batch_timed(&[(image, camera)])?;
        Ok((answers.pop().unwrap_or_default(), times))
    }

    /// [`Detector::detect`] for several images that the engine sees together, and the time of each stage for all of them.
    ///
    /// # Errors
    /// As [`Detector::detect`], and when the images need inputs of different sizes ([`DetectorSpec::input_for`]).
    pub fn detect_batch_timed(
        &mut self,
        images: &[(&RgbImage, &Camera)],
    ) -> Result<(Vec<Vec<Detection>>, StageTimes), DetectError> {
        let Some(size) = self.common_input_size(images)? else { return Ok((Vec::new(), StageTimes::default())) };
        let (views, warp) = timed(|| self.warped(images));
        let (maps, network) = timed(|| match &self.inputs[..] {
            [one] => self.engine.batch_head_maps(one, size),
            several => self.engine.batch_head_maps(&several.concat(), size),
        });
        let maps = self.checked(maps?, images.len(), size)?;
        let decoded = || maps.iter().zip(&views).map(|(maps, view)| self.decoded(maps, view)).collect();
        let (answers, decode) = timed(decoded);
        let (answers, refine) = timed(|| self.refined(images, answers));
        let answers = answers?.into_iter().map(|found| self.told(found)).collect();
        Ok((answers, StageTimes { warp, network, decode, refine, ..StageTimes::default() }))
    }

    /// The answers after a second look, and after one at number plates, where there are such.
    #[cfg(feature = "rten")]
    fn refined(
        &mut self,
        images: &[(&RgbImage, &Camera)],
        answers: Vec<Vec<Detection>>,
    ) -> Result<Vec<Vec<Detection>>, EngineError> {
        let least_score = self.least_score();
        let classes = &self.spec.codec.classes;
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

    #[cfg(not(feature = "rten"))]
    fn refined(
        &mut self,
        _: &[(&RgbImage, &Camera)],
        answers: Vec<Vec<Detection>>,
    ) -> Result<Vec<Vec<Detection>>, EngineError> {
        Ok(answers)
    }

    /// Width and height of the input that all images need; none without images.
    fn common_input_size(&self, images: &[(&RgbImage, &Camera)]) -> Result<Option<[usize; 2]>, DetectError> {
        let mut common: Option<[usize; 2]> = None;
        for (index, (image, camera)) in images.iter().enumerate() {
            let (width, height) = image.dimensions();
            if width == 0 || height == 0 {
                return Err(DetectError::Empty { width, height });
            }
            let found = self.spec.input_for([width as usize, height as usize], camera).size;
            let expected = *common.get_or_insert(found);
            if found != expected {
                return Err(DetectError::InputSize { index, found, expected });
            }
        }
        Ok(common)
    }

    /// Fills the inputs; returns how each of them sees the world.
    fn warped(&mut self, images: &[(&RgbImage, &Camera)]) -> Vec<View> {
        self.inputs.resize_with(images.len(), Vec::new);
        let one = |((image, camera), input): (&(&RgbImage, &Camera), &mut Vec<f32>)| {
            self.spec.input_into(input, image, camera).1
        };
        images.iter().zip(&mut self.inputs).map(one).collect()
    }

    /// What the first look sees: all that is asked for, and where a second one follows what that could raise to it.
    fn decoded(&self, maps: &HeadMaps, view: &View) -> Vec<Detection> {
        let codec = &self.spec.codec;
        let options = self.first_look_options();
        let Some(head) = &self.head else { return detections(codec, maps, view, &options) };
        let regression = |cell| head.regression(&maps.regression, maps.map_size, cell);
        detections_at_peaks(codec, &maps.logits, maps.map_size, regression, view, &options)
    }

    fn first_look_options(&self) -> DecodeOptions {
        let share = if self.has_refiner() { CANDIDATE_SHARE } else { 1.0 };
        DecodeOptions { min_score: Some(share * self.least_score()), ..self.spec.options }
    }

    #[cfg(feature = "rten")]
    fn has_refiner(&self) -> bool {
        self.refiner.is_some()
    }

    #[cfg(not(feature = "rten"))]
    fn has_refiner(&self) -> bool {
        false
    }

    /// What has a lower score plays no part. What stands on the road has, told or not.
    fn least_score(&self) -> f64 {
        let asked = self.min_score();
        if self.road == Road::Ignored { asked } else { asked.min(SURE_SCORE) }
    }

    fn min_score(&self) -> f64 {
        self.spec.options.min_score(&self.spec.codec)
    }

    /// `found` on its road, as far as it was asked for.
    fn told(&self, found: Vec<Detection>) -> Vec<Detection> {
        let mut told = on_one_road(found, self.road);
        told.retain(|detection| detection.score > self.min_score());
        told
    }

    /// The decoder relies on the number and the sizes of the maps, and an engine runs files that others made.
    fn checked(
        &self,
        maps: Vec<HeadMaps>,
        images: usize,
        input_size: [usize; 2],
    ) -> Result<Vec<HeadMaps>, DetectError> {
        let map_size @ [width, height] = DetectorSpec::map_size(input_size);
        let misfit = |map, found, expected| {
            let engine = self.engine.name().to_owned();
            Err(DetectError::Maps { engine, map, found, expected, width, height })
        };
        for answer in &maps {
            let found = [("heat map", answer.logits.len()), ("regression map", answer.regression.len())];
            let channels = [self.spec.codec.classes.len(), self.head.as_ref().map_or(CHANNELS, PeaksHead::channels)];
            for ((map, found), channels) in found.into_iter().zip(channels) {
                let expected = channels * width * height;
                if found != expected || answer.map_size != map_size {
                    return misfit(map, found, expected);
                }
            }
        }
        if maps.len() == images { Ok(maps) } else { misfit("batch", maps.len(), images) }
    }
}

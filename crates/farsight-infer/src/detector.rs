//! From an image and its camera to detections.

use farsight_core::codec::CHANNELS;
use farsight_core::detection::{View, detections, detections_at_peaks};
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
    /// The network's input, kept from image to image.
    input: Vec<f32>,
}

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
        Self { engine, spec, head: None, input: Vec::new() }
    }

    /// As [`Detector::new`], for a network that ends before its regression `head`.
    pub fn with_peaks_head(engine: Box<dyn Engine>, spec: DetectorSpec, head: PeaksHead) -> Self {
        Self { engine, spec, head: Some(head), input: Vec::new() }
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
        let (width, height) = image.dimensions();
        if width == 0 || height == 0 {
            return Err(DetectError::Empty { width, height });
        }
        let image_size = [width as usize, height as usize];
        let ((size, input_camera), warp) = timed(|| self.spec.input_into(&mut self.input, image, camera));
        let view = View { image_size, camera: *camera, input_camera };
        let (maps, network) = timed(|| self.engine.head_maps(&self.input, size));
        let maps = self.checked(maps?, size)?;
        let (detections, decode) = timed(|| self.decoded(&maps, &view));
        Ok((detections, StageTimes { warp, network, decode, ..StageTimes::default() }))
    }

    fn decoded(&self, maps: &HeadMaps, view: &View) -> Vec<Detection> {
        let DetectorSpec { codec, options, .. } = &self.spec;
        let Some(head) = &self.head else { return detections(codec, maps, view, options) };
        let regression = |cell| head.regression(&maps.regression, maps.map_size, cell);
        detections_at_peaks(codec, &maps.logits, maps.map_size, regression, view, options)
    }

    /// The decoder relies on the sizes of the maps, and an engine runs files that others made.
    fn checked(&self, maps: HeadMaps, input_size: [usize; 2]) -> Result<HeadMaps, DetectError> {
        let map_size @ [width, height] = DetectorSpec::map_size(input_size);
        let found = [("heat map", maps.logits.len()), ("regression map", maps.regression.len())];
        let channels = [self.spec.codec.classes.len(), self.head.as_ref().map_or(CHANNELS, PeaksHead::channels)];
        for ((map, found), channels) in found.into_iter().zip(channels) {
            let expected = channels * width * height;
            if found != expected || maps.map_size != map_size {
                let engine = self.engine.name().to_owned();
                return Err(DetectError::Maps { engine, map, found, expected, width, height });
            }
        }
        Ok(maps)
    }
}

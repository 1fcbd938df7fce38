//! From an image and its camera to SMOKE's detections.

use farsight_core::detection::{DecodeOptions, View};
use farsight_core::{Camera, ClassReference, Detection};
use farsight_graph::model::NetworkConfig;
use farsight_runtime::timing::timed;
use farsight_runtime::{EngineError, Runner, StageTimes, Tensor};
use image::RgbImage;

use super::codec::{CHANNELS, STRIDE};
use super::decode::{HeadMaps, detections, detections_at_peaks};
use super::network::{LOGITS, REGRESSION};
use super::{Codec, SmokeConfig, SparseHead};
use crate::batch::{InputBatch, output};
use crate::detector::{DetectError, Detector, UnfamiliarCamera};
use crate::input_spec::InputSpec;

/// A SMOKE model ready to look at images.
pub struct SmokeDetector {
    runner: Box<dyn Runner>,
    input: InputSpec,
    codec: Codec,
    /// What the runner's network leaves to be done at the peaks.
    head: Option<SparseHead>,
    /// The output that has the regression, or the features that the head reads.
    regression: String,
    batch: InputBatch,
}

impl SmokeDetector {
    /// The model of `config`, which `runner` runs. A network that ends before its regression head has it in `head`.
    pub fn new(runner: Box<dyn Runner>, config: &SmokeConfig, head: Option<SparseHead>) -> Self {
        Self::with_input(runner, config.input_spec(), config.codec(), head)
    }

    /// As [`SmokeDetector::new`], for inputs of another size than the config's.
    pub fn with_input(runner: Box<dyn Runner>, input: InputSpec, codec: Codec, head: Option<SparseHead>) -> Self {
        let other = runner.outputs().iter().find(|output| output.name != LOGITS);
        let regression = other.map_or_else(|| REGRESSION.to_owned(), |output| output.name.clone());
        Self { runner, input, codec, head, regression, batch: InputBatch::default() }
    }

    /// How images become inputs.
    pub fn input(&self) -> &InputSpec {
        &self.input
    }

    /// What its answers mean.
    pub fn codec(&self) -> &Codec {
        &self.codec
    }

    fn decoded(&self, maps: &HeadMaps, view: &View, options: &DecodeOptions) -> Vec<Detection> {
        let codec = &self.codec;
        let Some(head) = &self.head else { return detections(codec, maps, view, options) };
        let regression = |cell| head.regression(&maps.regression, maps.map_size, cell);
        detections_at_peaks(codec, &maps.logits, maps.map_size, regression, view, options)
    }

    /// The maps of each image. The decoder relies on their number and sizes.
    fn maps(
        &self,
        mut outputs: Vec<Tensor>,
        images: usize,
        input_size: [usize; 2],
    ) -> Result<Vec<HeadMaps>, DetectError> {
        let [width, height] = input_size.map(|side| side / STRIDE);
        let channels = self.head.as_ref().map_or(CHANNELS, SparseHead::channels);
        let expected = [images, self.codec.classes.len(), height, width];
        let logits = output(&*self.runner, &mut outputs, LOGITS, expected)?;
        let expected = [images, channels, height, width];
        let regression = output(&*self.runner, &mut outputs, &self.regression, expected)?;
        Ok(HeadMaps::of_batch(logits, regression))
    }
}

impl Detector for SmokeDetector {
    fn method(&self) -> &'static str {
        SmokeConfig::METHOD
    }

    fn engine(&self) -> &str {
        self.runner.engine()
    }

    fn classes(&self) -> &[ClassReference] {
        &self.codec.classes
    }

    fn has_error_bars(&self) -> bool {
        self.codec.depth.error.is_some()
    }

    fn input_size(&self, image_size: [usize; 2], camera: &Camera) -> [usize; 2] {
        self.input.input_for(image_size, camera).size
    }

    fn set_input_size(&mut self, size: [usize; 2]) -> bool {
        self.input.fix_size(size);
        true
    }

    fn unfamiliar(&self, image_size: [usize; 2], camera: &Camera) -> Option<UnfamiliarCamera> {
        self.input.unfamiliar(image_size, camera)
    }

    /// 2D boxes are projected by the whole camera even for models that see it without its fourth column, so that they
    /// lie where the image shows the object; official SMOKE's own 2D boxes stand off by up to 9 pixels at 5 m (spec
    /// 5.6).
    fn detect_batch(
        &mut self,
        images: &[(&RgbImage, &Camera)],
        options: &DecodeOptions,
    ) -> Result<(Vec<Vec<Detection>>, StageTimes), DetectError> {
        let (filled, warp) = timed(|| self.batch.fill(images, &self.input));
        let Some((size, views)) = filled? else { return Ok((Vec::new(), StageTimes::default())) };
        let (outputs, network) = timed(|| self.batch.run(&mut *self.runner, size));
        let maps = self.maps(outputs?, images.len(), size)?;
        let decoded = || maps.iter().zip(&views).map(|(maps, view)| self.decoded(maps, view, options)).collect();
        let (answers, decode) = timed(decoded);
        for HeadMaps { logits, regression, .. } in maps {
            self.runner.recycle(logits);
            self.runner.recycle(regression);
        }
        Ok((answers, StageTimes { warp, network, decode, ..StageTimes::default() }))
    }

    fn share(&self) -> Result<Box<dyn Detector>, EngineError> {
        let (runner, codec) = (self.runner.share()?, self.codec.clone());
        Ok(Box::new(Self::with_input(runner, self.input.clone(), codec, self.head.clone())))
    }
}

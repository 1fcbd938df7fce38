//! From an image and its camera to SMOKE's detections.

use farsight_core::detection::{DecodeOptions, View};
use farsight_core::{Camera, ClassReference, Detection};
use farsight_onnx::INPUT;
use farsight_runtime::timing::timed;
use farsight_runtime::{EngineError, Runner, StageTimes, Tensor, TensorView};
use image::RgbImage;

use super::codec::CHANNELS;
use super::decode::{HeadMaps, detections, detections_at_peaks};
use super::network::LOGITS;
use super::{DetectorSpec, SparseHead};
use crate::detector::{DetectError, Detector, UnfamiliarCamera};

/// A SMOKE model ready to look at images.
pub struct SmokeDetector {
    runner: Box<dyn Runner>,
    spec: DetectorSpec,
    /// What the runner's network leaves to be done at the peaks.
    head: Option<SparseHead>,
    /// The network's inputs, kept from batch to batch.
    inputs: Vec<Vec<f32>>,
}

impl SmokeDetector {
    /// The model of `spec`, which `runner` runs. A network that ends before its regression head has it in `head`.
    pub fn new(runner: Box<dyn Runner>, spec: DetectorSpec, head: Option<SparseHead>) -> Self {
        Self { runner, spec, head, inputs: Vec::new() }
    }

    /// What it knows of the model.
    pub fn spec(&self) -> &DetectorSpec {
        &self.spec
    }

    /// The outputs of the network for the inputs of several images, which are kept.
    fn outputs(&mut self, [width, height]: [usize; 2]) -> Result<Vec<Tensor>, EngineError> {
        let joined;
        let values = match &self.inputs[..] {
            [one] => one,
            several => {
                joined = several.concat();
                &joined
            }
        };
        let shape = [self.inputs.len(), 3, height, width];
        self.runner.run(&[(INPUT, TensorView { shape: &shape, values })])
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

    fn decoded(&self, maps: &HeadMaps, view: &View, options: &DecodeOptions) -> Vec<Detection> {
        let codec = &self.spec.codec;
        let Some(head) = &self.head else { return detections(codec, maps, view, options) };
        let regression = |cell| head.regression(&maps.regression, maps.map_size, cell);
        detections_at_peaks(codec, &maps.logits, maps.map_size, regression, view, options)
    }

    /// The maps of each image. The decoder relies on their number and sizes, and an engine runs files that others made.
    fn maps(&self, outputs: Vec<Tensor>, images: usize, input_size: [usize; 2]) -> Result<Vec<HeadMaps>, DetectError> {
        let [width, height] = DetectorSpec::map_size(input_size);
        let channels = [self.spec.codec.classes.len(), self.head.as_ref().map_or(CHANNELS, SparseHead::channels)];
        let (mut logits, mut regression) = (None, None);
        for (info, tensor) in self.runner.outputs().iter().zip(outputs) {
            let (map, channels, place) = if info.name == LOGITS {
                ("heatmap", channels[0], &mut logits)
            } else {
                ("regression map", channels[1], &mut regression)
            };
            let expected = [images, channels, height, width];
            if tensor.shape != expected || tensor.values.len() != expected.iter().product::<usize>() {
                let engine = self.runner.engine().to_owned();
                return Err(DetectError::Maps { engine, map, found: tensor.shape, expected });
            }
            *place = Some(tensor);
        }
        match (logits, regression) {
            (Some(logits), Some(regression)) => Ok(HeadMaps::of_batch(logits, regression)),
            _ => Err(EngineError::new(self.runner.engine(), "it did not give the two outputs of the network").into()),
        }
    }
}

impl Detector for SmokeDetector {
    fn method(&self) -> &'static str {
        "smoke"
    }

    fn engine(&self) -> &str {
        self.runner.engine()
    }

    fn classes(&self) -> &[ClassReference] {
        &self.spec.codec.classes
    }

    fn has_error_bars(&self) -> bool {
        self.spec.codec.depth.error.is_some()
    }

    fn input_size(&self, image_size: [usize; 2], camera: &Camera) -> [usize; 2] {
        self.spec.input_for(image_size, camera).size
    }

    fn unfamiliar(&self, image_size: [usize; 2], camera: &Camera) -> Option<UnfamiliarCamera> {
        self.spec.unfamiliar(image_size, camera)
    }

    /// 2D boxes are projected by the whole camera even for models that see it without its fourth column, so that they lie where the image shows the object;
    /// official SMOKE's own 2D boxes stand off by up to 9 pixels at 5 m (spec 5.6).
    fn detect_batch(
        &mut self,
        images: &[(&RgbImage, &Camera)],
        options: &DecodeOptions,
    ) -> Result<(Vec<Vec<Detection>>, StageTimes), DetectError> {
        let Some(size) = self.common_input_size(images)? else { return Ok((Vec::new(), StageTimes::default())) };
        let (views, warp) = timed(|| self.warped(images));
        let (outputs, network) = timed(|| self.outputs(size));
        let maps = self.maps(outputs?, images.len(), size)?;
        let decoded = || maps.iter().zip(&views).map(|(maps, view)| self.decoded(maps, view, options)).collect();
        let (answers, decode) = timed(decoded);
        Ok((answers, StageTimes { warp, network, decode, ..StageTimes::default() }))
    }

    fn share(&self) -> Result<Box<dyn Detector>, EngineError> {
        Ok(Box::new(Self::new(self.runner.share()?, self.spec.clone(), self.head.clone())))
    }
}

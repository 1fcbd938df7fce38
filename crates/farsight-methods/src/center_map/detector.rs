//! From an image and its camera to detections.

use farsight_core::detection::{DecodeOptions, View};
use farsight_core::{Camera, ClassReference, Detection};
use farsight_graph::model::NetworkConfig;
use farsight_onnx::LocalHeadFile;
use farsight_runtime::timing::timed;
use farsight_runtime::{EngineError, Runner, StageTimes, Tensor, TensorView};
use image::RgbImage;

use super::{Features, STRIDE};
use crate::batch::{InputBatch, output};
use crate::detector::{DetectError, Detector, UnfamiliarCamera};
use crate::input_spec::InputSpec;
use crate::method::{DetectorMethod, Method};

/// A method whose network has maps of stride 4, and what it reads off them.
pub trait CenterMethod: NetworkConfig + Send + 'static {
    /// What its keypoints are.
    const KEYPOINTS: &'static str;

    /// What makes the features.
    fn features(&self) -> Features;

    /// The classes that it knows.
    fn classes(&self) -> &[ClassReference];

    /// Whether what it finds has error bars.
    fn has_error_bars(&self) -> bool;

    /// How images become inputs.
    fn input_spec(&self) -> InputSpec;

    /// Channels of each of [`NetworkConfig::OUTPUTS`].
    fn output_channels(&self) -> Vec<usize>;

    /// What is found in the maps of one image, highest score first. Each map is `[channels, height, width]`, before any
    /// activation; they come in the order of [`NetworkConfig::OUTPUTS`].
    fn detections(&self, maps: &[TensorView<'_>], view: &View, options: &DecodeOptions) -> Vec<Detection>;
}

/// Such a method, ready to look at images.
pub struct CenterDetector<C> {
    runner: Box<dyn Runner>,
    config: C,
    input: InputSpec,
    batch: InputBatch,
}

impl<C: CenterMethod> CenterDetector<C> {
    /// The network of `config`, which `runner` runs.
    pub fn new(runner: Box<dyn Runner>, config: C) -> Self {
        let input = config.input_spec();
        Self { runner, config, input, batch: InputBatch::default() }
    }

    /// The outputs in the order of [`NetworkConfig::OUTPUTS`], their shapes checked.
    fn maps(
        &self,
        mut outputs: Vec<Tensor>,
        images: usize,
        input_size: [usize; 2],
    ) -> Result<Vec<Tensor>, DetectError> {
        let [width, height] = input_size.map(|side| side / STRIDE);
        let named = C::OUTPUTS.iter().zip(self.config.output_channels());
        named
            .map(|(name, channels)| output(&*self.runner, &mut outputs, name, [images, channels, height, width]))
            .collect()
    }
}

impl<C: CenterMethod> DetectorMethod for C {
    fn detector(
        self,
        runner: Box<dyn Runner>,
        _: Vec<Box<dyn Runner>>,
        _: Option<&LocalHeadFile>,
    ) -> Option<Box<dyn Detector>> {
        Some(Box::new(CenterDetector::new(runner, self)))
    }
}

impl<C: CenterMethod> Method for C {
    fn counted_input(&self) -> [usize; 2] {
        self.features().input
    }

    fn facts(&self) -> Vec<(&'static str, String)> {
        let features = self.features();
        let [width, height] = features.input;
        let classes: Vec<&str> = self.classes().iter().map(|class| class.class.name()).collect();
        vec![
            ("input", format!("{width} x {height} pixels")),
            ("classes", classes.join(", ")),
            ("channels", format!("{:?}", features.channels())),
            ("normalisation", format!("{:?}", features.norm).to_lowercase()),
            ("neck", format!("{:?}", features.neck).to_lowercase()),
            ("keypoints", C::KEYPOINTS.to_owned()),
        ]
    }
}

impl<C: CenterMethod> Detector for CenterDetector<C> {
    fn method(&self) -> &'static str {
        C::METHOD
    }

    fn engine(&self) -> &str {
        self.runner.engine()
    }

    fn classes(&self) -> &[ClassReference] {
        self.config.classes()
    }

    fn has_error_bars(&self) -> bool {
        self.config.has_error_bars()
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

    fn detect_batch(
        &mut self,
        images: &[(&RgbImage, &Camera)],
        options: &DecodeOptions,
    ) -> Result<(Vec<Vec<Detection>>, StageTimes), DetectError> {
        let (filled, warp) = timed(|| self.batch.fill(images, &self.input));
        let Some((size, views)) = filled? else { return Ok((Vec::new(), StageTimes::default())) };
        let (outputs, network) = timed(|| self.batch.run(&mut *self.runner, size));
        let tensors = self.maps(outputs?, images.len(), size)?;
        let decoded = || {
            let each = views.iter().enumerate().map(|(image, view)| {
                let maps: Vec<TensorView<'_>> = tensors.iter().map(|tensor| tensor.image(image)).collect();
                self.config.detections(&maps, view, options)
            });
            each.collect()
        };
        let (answers, decode) = timed(decoded);
        for tensor in tensors {
            self.runner.recycle(tensor.values);
        }
        Ok((answers, StageTimes { warp, network, decode, ..StageTimes::default() }))
    }

    fn share(&self) -> Result<Box<dyn Detector>, EngineError> {
        let (runner, config, input) = (self.runner.share()?, self.config.clone(), self.input.clone());
        Ok(Box::new(Self { runner, config, input, batch: InputBatch::default() }))
    }
}

//! From maps of stride 4 to detections.

use farsight_core::detection::{DecodeOptions, View};
use farsight_core::{ClassReference, Detection};
use farsight_graph::model::NetworkConfig;
use farsight_onnx::LocalHeadFile;
use farsight_runtime::{EngineError, Runner, Tensor, TensorView};

use super::{Features, STRIDE};
use crate::detector::{DetectError, Detector};
use crate::input_spec::InputSpec;
use crate::method::{DetectorMethod, Method};
use crate::network_detector::{NetworkDetector, NetworkOutputs, PostProcessor};

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

/// Reads such a method's maps.
pub(super) struct CenterPostProcessor<C>(C);

impl<C: CenterMethod> PostProcessor for CenterPostProcessor<C> {
    const METHOD: &'static str = C::METHOD;

    fn classes(&self) -> &[ClassReference] {
        self.0.classes()
    }

    fn has_error_bars(&self) -> bool {
        self.0.has_error_bars()
    }

    fn post_process(
        &mut self,
        outputs: &mut NetworkOutputs<'_>,
        views: &[View],
        options: &DecodeOptions,
    ) -> Result<Vec<Vec<Detection>>, DetectError> {
        let named = C::OUTPUTS.iter().zip(self.0.output_channels());
        let tensors: Vec<Tensor> =
            named.map(|(name, channels)| outputs.take(name, channels, STRIDE)).collect::<Result<_, _>>()?;
        let each = views.iter().enumerate().map(|(image, view)| {
            let maps: Vec<TensorView<'_>> = tensors.iter().map(|tensor| tensor.image(image)).collect();
            self.0.detections(&maps, view, options)
        });
        let answers = each.collect();
        for tensor in tensors {
            outputs.recycle(tensor.values);
        }
        Ok(answers)
    }

    fn share(&self) -> Result<Self, EngineError> {
        Ok(Self(self.0.clone()))
    }
}

impl<C: CenterMethod> DetectorMethod for C {
    fn detector(
        self,
        runner: Box<dyn Runner>,
        _: Vec<Box<dyn Runner>>,
        _: Option<&LocalHeadFile>,
    ) -> Option<Box<dyn Detector>> {
        let input = self.input_spec();
        Some(Box::new(NetworkDetector::with_post_processor(runner, input, CenterPostProcessor(self))))
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

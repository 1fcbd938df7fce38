//! Detectors whose network is cut at samplers: the first part sees the image, each later one what a sampler has read
//! off maps.

use std::time::Duration;

use farsight_core::detection::{DecodeOptions, View};
use farsight_core::samplers::FeatureMap;
use farsight_core::{ClassReference, Detection};
use farsight_onnx::INPUT;
use farsight_runtime::timing::timed;
use farsight_runtime::{EngineError, Runner, Tensor, TensorView};

use crate::detector::{DetectError, Detector};
use crate::input_spec::InputSpec;
use crate::method::Method;
use crate::network_detector::{NetworkDetector, NetworkOutputs, PostProcessor, output};

/// A method of such a detector.
pub(crate) trait CutMethod: Method + Clone + Send + 'static {
    /// Parts of the network after the first one.
    const LATER: usize;

    /// What is kept from image to image.
    type Kept: Default + Send;

    /// The classes that it knows.
    fn classes(&self) -> &[ClassReference];

    /// How images become inputs.
    fn input_spec(&self) -> InputSpec;

    /// Name, channels and stride of each map that the first part makes.
    fn maps(&self) -> Vec<(&'static str, usize, usize)>;

    /// What is found in the maps of one image, `[channels, height, width]` each, in the order of [`CutMethod::maps`];
    /// highest score first.
    ///
    /// # Errors
    /// When the engine of a later part fails, or its answer has another shape.
    fn look(
        &self,
        later: &mut LaterParts,
        kept: &mut Self::Kept,
        maps: &[TensorView<'_>],
        view: &View,
        options: &DecodeOptions,
    ) -> Result<Vec<Detection>, DetectError>;
}

/// What runs the parts of a network after the first one.
pub(crate) struct LaterParts {
    runners: Vec<Box<dyn Runner>>,
    /// Time of these parts so far.
    spent: Duration,
}

impl LaterParts {
    /// What the part at `place`, from 0, makes of `values` of this shape: outputs of these names and shapes.
    ///
    /// # Errors
    /// When the engine fails, or an output is missing or of another shape.
    pub(crate) fn run<const N: usize>(
        &mut self,
        place: usize,
        shape: &[usize],
        values: &[f32],
        expected: [(&str, [usize; 4]); N],
    ) -> Result<[Tensor; N], DetectError> {
        let runner = &mut self.runners[place];
        let (outputs, took) = timed(|| runner.run(&[(INPUT, TensorView { shape, values })]));
        self.spent += took;
        let mut outputs = outputs?;
        let mut made = [const { Tensor { shape: Vec::new(), values: Vec::new() } }; N];
        for (tensor, (name, expected)) in made.iter_mut().zip(expected) {
            *tensor = output(&**runner, &mut outputs, name, expected)?;
        }
        Ok(made)
    }
}

/// A map of one image for a sampler; none where its numbers are not those of its shape.
pub(crate) fn feature_map<'a>(map: &TensorView<'a>) -> Option<FeatureMap<'a>> {
    FeatureMap::new(map.values, [map.shape[0], map.shape[1], map.shape[2]])
}

/// Reads such a method's maps, and runs the later parts.
pub(crate) struct CutPostProcessor<C: CutMethod> {
    config: C,
    later: LaterParts,
    kept: C::Kept,
}

/// The detector whose parts are run by these; none unless there is one for each.
pub(crate) fn detector<C: CutMethod>(
    first: Box<dyn Runner>,
    later: Vec<Box<dyn Runner>>,
    config: C,
) -> Option<Box<dyn Detector>> {
    let (input, fits) = (config.input_spec(), later.len() == C::LATER);
    let later = LaterParts { runners: later, spent: Duration::ZERO };
    let post_processor = CutPostProcessor { config, later, kept: C::Kept::default() };
    fits.then(|| Box::new(NetworkDetector::with_post_processor(first, input, post_processor)) as Box<dyn Detector>)
}

impl<C: CutMethod> PostProcessor for CutPostProcessor<C> {
    const METHOD: &'static str = C::METHOD;

    fn classes(&self) -> &[ClassReference] {
        self.config.classes()
    }

    fn has_error_bars(&self) -> bool {
        false
    }

    fn post_process(
        &mut self,
        outputs: &mut NetworkOutputs<'_>,
        views: &[View],
        options: &DecodeOptions,
    ) -> Result<Vec<Vec<Detection>>, DetectError> {
        let take = |(name, channels, stride)| outputs.take(name, channels, stride);
        let maps: Vec<Tensor> = self.config.maps().into_iter().map(take).collect::<Result<_, _>>()?;
        self.later.spent = Duration::ZERO;
        let look = |(image, view)| {
            let maps: Vec<TensorView<'_>> = maps.iter().map(|map| map.image(image)).collect();
            self.config.look(&mut self.later, &mut self.kept, &maps, view, options)
        };
        let answers = views.iter().enumerate().map(look).collect();
        outputs.add_network_time(self.later.spent);
        answers
    }

    fn share(&self) -> Result<Self, EngineError> {
        let runners = self.later.runners.iter().map(|runner| runner.share()).collect::<Result<_, _>>()?;
        let later = LaterParts { runners, spent: Duration::ZERO };
        Ok(Self { config: self.config.clone(), later, kept: C::Kept::default() })
    }
}

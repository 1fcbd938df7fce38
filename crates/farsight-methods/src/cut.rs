//! Detectors whose network is cut at samplers: the first part sees the image, each later one what a sampler has read
//! off maps.

use std::time::Duration;

use farsight_core::detection::{DecodeOptions, View};
use farsight_core::samplers::FeatureMap;
use farsight_core::{Camera, ClassReference, Detection};
use farsight_onnx::INPUT;
use farsight_runtime::timing::timed;
use farsight_runtime::{EngineError, Runner, StageTimes, Tensor, TensorView};
use image::RgbImage;

use crate::batch::{InputBatch, output};
use crate::detector::{DetectError, Detector, UnfamiliarCamera};
use crate::input_spec::InputSpec;
use crate::method::Method;

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

/// Such a method, ready to look at images.
pub(crate) struct CutDetector<C: CutMethod> {
    first: Box<dyn Runner>,
    later: LaterParts,
    config: C,
    input: InputSpec,
    batch: InputBatch,
    kept: C::Kept,
}

impl<C: CutMethod> CutDetector<C> {
    /// The detector whose parts are run by these; none unless there is one for each.
    pub(crate) fn boxed(first: Box<dyn Runner>, later: Vec<Box<dyn Runner>>, config: C) -> Option<Box<dyn Detector>> {
        (later.len() == C::LATER).then(|| Box::new(Self::new(first, later, config)) as Box<dyn Detector>)
    }

    fn new(first: Box<dyn Runner>, later: Vec<Box<dyn Runner>>, config: C) -> Self {
        let (later, input) = (LaterParts { runners: later, spent: Duration::ZERO }, config.input_spec());
        Self { first, later, config, input, batch: InputBatch::default(), kept: C::Kept::default() }
    }

    /// The maps of a batch, their shapes checked.
    fn maps(
        &self,
        mut outputs: Vec<Tensor>,
        images: usize,
        input_size: [usize; 2],
    ) -> Result<Vec<Tensor>, DetectError> {
        let map = |(name, channels, stride): (&str, usize, usize)| {
            let [width, height] = input_size.map(|side| side / stride);
            output(&*self.first, &mut outputs, name, [images, channels, height, width])
        };
        self.config.maps().into_iter().map(map).collect()
    }
}

impl<C: CutMethod> Detector for CutDetector<C> {
    fn method(&self) -> &'static str {
        C::METHOD
    }

    fn engine(&self) -> &str {
        self.first.engine()
    }

    fn classes(&self) -> &[ClassReference] {
        self.config.classes()
    }

    fn has_error_bars(&self) -> bool {
        false
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
        let (outputs, first) = timed(|| self.batch.run(&mut *self.first, size));
        let maps = self.maps(outputs?, images.len(), size)?;
        self.later.spent = Duration::ZERO;
        let (answers, whole) = timed(|| {
            let look = |(image, view)| {
                let maps: Vec<TensorView<'_>> = maps.iter().map(|map| map.image(image)).collect();
                self.config.look(&mut self.later, &mut self.kept, &maps, view, options)
            };
            views.iter().enumerate().map(look).collect::<Result<Vec<_>, _>>()
        });
        let later = self.later.spent;
        let (network, decode) = (first + later, whole.saturating_sub(later));
        Ok((answers?, StageTimes { warp, network, decode, ..StageTimes::default() }))
    }

    fn share(&self) -> Result<Box<dyn Detector>, EngineError> {
        let later = self.later.runners.iter().map(|runner| runner.share()).collect::<Result<_, _>>()?;
        let mut shared = Self::new(self.first.share()?, later, self.config.clone());
        shared.input = self.input.clone();
        Ok(Box::new(shared))
    }
}

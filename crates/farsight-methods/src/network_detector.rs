//! Detectors whose network sees whole images, several together; a [`PostProcessor`] says what its outputs mean.

use std::time::Duration;

use farsight_core::detection::{DecodeOptions, View};
use farsight_core::{Camera, ClassReference, Detection};
use farsight_onnx::INPUT;
use farsight_runtime::timing::timed;
use farsight_runtime::{EngineError, Runner, StageTimes, Tensor, TensorView};
use image::RgbImage;

use crate::detector::{DetectError, Detector, UnfamiliarCamera};
use crate::input_spec::InputSpec;

/// What the outputs of a method's network mean.
pub trait PostProcessor: Sized + Send + 'static {
    /// Tag of the method.
    const METHOD: &'static str;

    /// The classes that it knows.
    fn classes(&self) -> &[ClassReference];

    /// Whether what it finds has error bars.
    fn has_error_bars(&self) -> bool;

    /// What is found in each image, which the network saw through the view of its place; highest score first.
    ///
    /// # Errors
    /// When an output is missing or of another shape, or the engine of a later network fails.
    fn post_process(
        &mut self,
        outputs: &mut NetworkOutputs<'_>,
        views: &[View],
        options: &DecodeOptions,
    ) -> Result<Vec<Vec<Detection>>, DetectError>;

    /// The same for another thread.
    ///
    /// # Errors
    /// When the engine of a later network fails.
    fn share(&self) -> Result<Self, EngineError>;
}

/// What a network answered to a batch of images.
pub struct NetworkOutputs<'a> {
    runner: &'a mut dyn Runner,
    tensors: Vec<Tensor>,
    images: usize,
    input_size: [usize; 2],
    /// Time of later networks.
    later: Duration,
}

impl NetworkOutputs<'_> {
    /// Takes the output called `name`.
    ///
    /// # Shapes
    /// `[images, channels, height / stride, width / stride]` of the input's height and width.
    ///
    /// # Errors
    /// When there is no such output, or it has another shape.
    pub fn take(&mut self, name: &str, channels: usize, stride: usize) -> Result<Tensor, DetectError> {
        let [width, height] = self.input_size.map(|side| side / stride);
        output(&*self.runner, &mut self.tensors, name, [self.images, channels, height, width])
    }

    /// Gives the memory of an output back to the engine.
    pub fn recycle(&mut self, values: Vec<f32>) {
        self.runner.recycle(values);
    }

    /// Counts `time` as a network's: that of later ones, which the post-processor ran.
    pub fn add_network_time(&mut self, time: Duration) {
        self.later += time;
    }
}

/// A network and its post-processor, ready to look at images.
pub struct NetworkDetector<P> {
    runner: Box<dyn Runner>,
    input: InputSpec,
    post_processor: P,
    batch: InputBatch,
}

impl<P> NetworkDetector<P> {
    /// The detector whose network `runner` runs, with inputs by `input`.
    pub fn with_post_processor(runner: Box<dyn Runner>, input: InputSpec, post_processor: P) -> Self {
        Self { runner, input, post_processor, batch: InputBatch::default() }
    }

    /// How images become inputs.
    pub fn input(&self) -> &InputSpec {
        &self.input
    }

    /// What its outputs mean.
    pub fn post_processor(&self) -> &P {
        &self.post_processor
    }
}

impl<P: PostProcessor> Detector for NetworkDetector<P> {
    fn method(&self) -> &'static str {
        P::METHOD
    }

    fn engine(&self) -> &str {
        self.runner.engine()
    }

    fn classes(&self) -> &[ClassReference] {
        self.post_processor.classes()
    }

    fn has_error_bars(&self) -> bool {
        self.post_processor.has_error_bars()
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
        let Some((input_size, views)) = filled? else { return Ok((Vec::new(), StageTimes::default())) };
        let (tensors, first) = timed(|| self.batch.run(&mut *self.runner, input_size));
        let (tensors, later) = (tensors?, Duration::ZERO);
        let mut outputs =
            NetworkOutputs { runner: &mut *self.runner, tensors, images: images.len(), input_size, later };
        let (answers, whole) = timed(|| self.post_processor.post_process(&mut outputs, &views, options));
        let (network, decode) = (first + outputs.later, whole.saturating_sub(outputs.later));
        Ok((answers?, StageTimes { warp, network, decode, ..StageTimes::default() }))
    }

    fn share(&self) -> Result<Box<dyn Detector>, EngineError> {
        let (runner, post_processor) = (self.runner.share()?, self.post_processor.share()?);
        Ok(Box::new(Self::with_post_processor(runner, self.input.clone(), post_processor)))
    }
}

/// The inputs of a batch, kept from batch to batch.
#[derive(Debug, Default)]
struct InputBatch {
    inputs: Vec<Vec<f32>>,
}

/// Width and height of the inputs, and how each of them sees the world.
type Views = ([usize; 2], Vec<View>);

impl InputBatch {
    /// Fills the inputs; returns their width and height, and how each of them sees the world. None without images.
    ///
    /// # Errors
    /// When an image has no pixels, or the images need inputs of different sizes.
    fn fill(&mut self, images: &[(&RgbImage, &Camera)], spec: &InputSpec) -> Result<Option<Views>, DetectError> {
        let Some(size) = common_size(images, spec)? else { return Ok(None) };
        self.inputs.resize_with(images.len(), Vec::new);
        let one =
            |((image, camera), input): (&(&RgbImage, &Camera), &mut Vec<f32>)| spec.input_into(input, image, camera).1;
        Ok(Some((size, images.iter().zip(&mut self.inputs).map(one).collect())))
    }

    /// What `runner` answers to the inputs, of this width and height.
    ///
    /// # Errors
    /// When the engine fails.
    fn run(&self, runner: &mut dyn Runner, [width, height]: [usize; 2]) -> Result<Vec<Tensor>, EngineError> {
        let joined;
        let values = match &self.inputs[..] {
            [one] => one,
            several => {
                joined = several.concat();
                &joined
            }
        };
        let shape = [self.inputs.len(), 3, height, width];
        runner.run(&[(INPUT, TensorView { shape: &shape, values })])
    }
}

/// Width and height of the input that all images need; none without images.
fn common_size(images: &[(&RgbImage, &Camera)], spec: &InputSpec) -> Result<Option<[usize; 2]>, DetectError> {
    let mut common: Option<[usize; 2]> = None;
    for (index, (image, camera)) in images.iter().enumerate() {
        let (width, height) = image.dimensions();
        if width == 0 || height == 0 {
            return Err(DetectError::Empty { width, height });
        }
        let found = spec.input_for([width as usize, height as usize], camera).size;
        let expected = *common.get_or_insert(found);
        if found != expected {
            return Err(DetectError::InputSize { index, found, expected });
        }
    }
    Ok(common)
}

/// The output called `name`, if it has this shape: an engine runs files that others made.
///
/// # Errors
/// When there is no such output, or it has another shape.
pub(crate) fn output(
    runner: &dyn Runner,
    outputs: &mut [Tensor],
    name: &str,
    expected: [usize; 4],
) -> Result<Tensor, DetectError> {
    let place = runner.outputs().iter().position(|output| output.name == name);
    let tensor = place.and_then(|place| outputs.get_mut(place));
    let Some(tensor) = tensor else {
        return Err(EngineError::new(runner.engine(), format!("it gave no output \"{name}\"")).into());
    };
    let tensor = std::mem::replace(tensor, Tensor { shape: Vec::new(), values: Vec::new() });
    if tensor.shape != expected || tensor.values.len() != expected.iter().product::<usize>() {
        let (engine, map) = (runner.engine().to_owned(), name.to_owned());
        return Err(DetectError::Maps { engine, map, found: tensor.shape, expected });
    }
    Ok(tensor)
}

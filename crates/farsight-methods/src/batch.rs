//! The inputs of several images that an engine sees together.

use farsight_core::Camera;
use farsight_core::detection::View;
use farsight_onnx::INPUT;
use farsight_runtime::{EngineError, Runner, Tensor, TensorView};
use image::RgbImage;

use crate::DetectError;
use crate::input_spec::InputSpec;

/// The inputs of a batch, kept from batch to batch.
#[derive(Debug, Default)]
pub(crate) struct InputBatch {
    inputs: Vec<Vec<f32>>,
}

/// Width and height of the inputs, and how each of them sees the world.
type Views = ([usize; 2], Vec<View>);

impl InputBatch {
    /// Fills the inputs; returns their width and height, and how each of them sees the world. None without images.
    ///
    /// # Errors
    /// When an image has no pixels, or the images need inputs of different sizes.
    pub(crate) fn fill(
        &mut self,
        images: &[(&RgbImage, &Camera)],
        spec: &InputSpec,
    ) -> Result<Option<Views>, DetectError> {
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
    pub(crate) fn run(&self, runner: &mut dyn Runner, [width, height]: [usize; 2]) -> Result<Vec<Tensor>, EngineError> {
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

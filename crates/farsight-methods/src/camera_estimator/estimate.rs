//! Estimating the camera of an image ([`crate::camera_estimator::geometry`]).

use farsight_data::network_input_into;
use farsight_onnx::INPUT;
use farsight_runtime::{EngineError, Runner, TensorView};
use image::RgbImage;

use super::CameraEstimatorConfig;
use super::geometry::{
    ANSWER_CHANNELS, CameraEstimate, INPUT_CHANNELS, INPUT_SIZE, decode, input_rules, mean_answer, window,
};

/// Estimates cameras.
pub struct CameraEstimator {
    runner: Box<dyn Runner>,
    config: CameraEstimatorConfig,
}

impl CameraEstimator {
    /// The network of `config`, which `runner` runs.
    pub fn new(runner: Box<dyn Runner>, config: CameraEstimatorConfig) -> Self {
        Self { runner, config }
    }

    /// What `image` says of its camera, the mean for it and for its mirror image, and what cameras are usually like
    /// ([`CameraEstimate::among_usual`]).
    ///
    /// # Errors
    /// When the engine fails.
    pub fn estimate(&mut self, image: &RgbImage) -> Result<CameraEstimate, EngineError> {
        let image_size = [image.width(), image.height()].map(|side| side as usize);
        Ok(self.look(image)?.among_usual(image_size))
    }

    /// What `image` alone says of its camera.
    ///
    /// # Errors
    /// When the engine fails.
    pub fn look(&mut self, image: &RgbImage) -> Result<CameraEstimate, EngineError> {
        let image_size = [image.width(), image.height()].map(|side| side as usize);
        let [width, height] = INPUT_SIZE;
        let mut pixels = Vec::new();
        network_input_into(&mut pixels, image, &window(image_size), &input_rules(), None);
        let mut input = pixels.clone();
        pixels.chunks_exact_mut(width).for_each(<[f32]>::reverse);
        input.extend(pixels);
        let shape = [2, INPUT_CHANNELS, height, width];
        let outputs = self.runner.run(&[(INPUT, TensorView { shape: &shape, values: &input })])?;
        let answer = outputs.into_iter().next().filter(|answer| answer.values.len() == 2 * ANSWER_CHANNELS);
        let answer = answer.ok_or_else(|| EngineError::new(self.runner.engine(), "its answer has another size"))?;
        let (answers, _) = answer.values.as_chunks::<ANSWER_CHANNELS>();
        let mean = mean_answer(answers[0].map(f64::from), answers[1].map(f64::from));
        Ok(decode(mean, image_size, self.config.error_scale))
    }
}

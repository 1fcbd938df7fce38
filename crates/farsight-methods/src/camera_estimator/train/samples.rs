//! From frames whose cameras are known to what the network should answer.

use std::sync::Arc;

use farsight_data::{AugmentationConfig, Dataset, DatasetError, ItemKey, Transform};
use tch::{Device, Tensor};

use crate::camera_estimator::geometry::{INPUT_CHANNELS, INPUT_SIZE, NUMBERS, encode, input_rules, window};

/// An image, and what the network should answer.
#[derive(Debug)]
pub struct CameraSample {
    /// Name of the frame.
    pub(super) id: String,
    /// `[3, height, width]`.
    input: Vec<f32>,
    /// None of a camera without a horizon: it teaches nothing.
    numbers: Option<[f64; NUMBERS]>,
}

/// Makes the sample of a frame. Shared by the loader's threads.
#[derive(Debug)]
pub(super) struct CameraMaker {
    pub(super) source: Arc<dyn Dataset>,
    pub(super) augmentation: AugmentationConfig,
}

impl CameraMaker {
    /// The sample of the frame that `key` stands for; the same whenever and wherever it is asked for. The image is
    /// always seen whole: what is shifted or cut has its axis elsewhere, as no camera has.
    pub(super) fn sample(&self, key: ItemKey) -> Result<CameraSample, DatasetError> {
        let frame = self.source.item(key)?;
        let image_size = [frame.image.width(), frame.image.height()].map(|side| side as usize);
        let rules = input_rules();
        let drawn = self.augmentation.draw(&mut key.rng(), image_size, &rules);
        let transform = Transform { window: window(image_size), ..drawn };
        let camera = transform.camera(&frame.camera, image_size[0]);
        Ok(CameraSample {
            id: frame.id.clone(),
            input: transform.input(&frame.image, &rules),
            numbers: encode(&camera),
        })
    }
}

/// What a step learns from.
#[derive(Debug)]
pub struct CameraBatch {
    /// `[images, 3, height, width]`.
    pub(super) input: Tensor,
    /// `[images, 3]`.
    pub(super) numbers: Tensor,
}

impl CameraBatch {
    /// What `samples` teach; none without a camera that has a horizon.
    pub(super) fn new(samples: &[CameraSample], device: Device) -> Option<Self> {
        let shape = [INPUT_CHANNELS, INPUT_SIZE[1], INPUT_SIZE[0]].map(|side| side as i64);
        let known = samples.iter().filter_map(|sample| Some((sample, sample.numbers?)));
        let (inputs, numbers): (Vec<Tensor>, Vec<[f32; NUMBERS]>) = known
            .map(|(sample, numbers)| {
                (Tensor::from_slice(&sample.input).view(shape), numbers.map(|number| number as f32))
            })
            .unzip();
        (!inputs.is_empty()).then(|| Self {
            input: Tensor::stack(&inputs, 0).to_device(device),
            numbers: Tensor::from_slice(numbers.as_flattened()).view([-1, NUMBERS as i64]).to_device(device),
        })
    }
}

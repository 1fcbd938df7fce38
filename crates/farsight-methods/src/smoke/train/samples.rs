//! From labelled frames to the tensors of a batch.

use std::sync::Arc;

use farsight_core::input::InputRules;
use farsight_data::{AugmentationConfig, Dataset, DatasetError, ItemKey};
use tch::{Device, Tensor};

use super::loss::BatchTargets;
use crate::smoke::codec::STRIDE;
use crate::smoke::targets::{TargetRules, Targets};
use crate::smoke::{Quirks, SmokeConfig};
use crate::tensors::stacked;

/// One image as the network sees it, and what it should answer.
#[derive(Debug)]
pub struct TrainSample {
    /// Name of the frame.
    pub id: String,
    /// Network input, `[3, height, width]`.
    pub input: Vec<f32>,
    /// What to learn.
    pub targets: Targets,
    /// Whether the regression learns from this image.
    pub regress: bool,
    /// Virtual depth of the surface in each cell of the feature map, metres, infinite where there is none; if the frame
    /// knows it.
    pub surface_m: Option<Vec<f32>>,
}

/// Makes samples: frame, transform, targets. Shared by the loader's threads.
#[derive(Debug)]
pub struct SampleMaker {
    source: Arc<dyn Dataset>,
    quirks: Quirks,
    input_rules: InputRules,
    target_rules: TargetRules,
    augmentation: AugmentationConfig,
}

impl SampleMaker {
    /// Samples of `source` for `model`.
    pub fn new(source: Arc<dyn Dataset>, model: &SmokeConfig, augmentation: AugmentationConfig) -> Self {
        let (input_rules, target_rules) = (model.input_rules(), model.target_rules());
        Self { source, quirks: model.quirks, input_rules, target_rules, augmentation }
    }

    /// Number of frames in an epoch.
    pub fn len(&self) -> usize {
        self.source.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.source.is_empty()
    }

    /// The sample that `key` stands for; the same whenever and wherever it is asked for.
    ///
    /// # Errors
    /// When the frame cannot be read.
    pub fn sample(&self, key: ItemKey) -> Result<TrainSample, DatasetError> {
        let frame = self.source.item(key)?;
        let transform = self.augmentation.draw(&mut key.rng(), frame.image_size(), &self.input_rules);
        let sample = transform.apply(&frame, &self.input_rules);
        // The quirk drops a column, which commutes with every transform of the image.
        let camera = self.quirks.camera(&sample.camera);
        let targets = self.target_rules.targets(&sample.labels, &camera, sample.size);
        let depth = self.target_rules.codec.depth;
        let seen = |&depth_m: &f32| depth.virtual_depth_m(f64::from(depth_m), camera.focal_y()) as f32;
        let surface_m = transform.surface_m(&frame, &self.input_rules, STRIDE);
        let surface_m = surface_m.map(|surface_m| surface_m.iter().map(seen).collect());
        Ok(TrainSample { id: sample.id, input: sample.input, targets, regress: sample.regress, surface_m })
    }
}

/// Tensors of a batch.
#[derive(Debug)]
pub struct TrainBatch {
    /// Network input, `[batch, 3, height, width]`.
    pub input: Tensor,
    /// What to learn.
    pub targets: BatchTargets,
}

impl TrainBatch {
    /// Joins samples of one input size (width, height).
    pub fn new(samples: Vec<TrainSample>, size: [usize; 2], device: Device) -> Self {
        let input = stacked(samples.iter().map(|sample| &sample.input[..]), size, device);
        let regress: Vec<bool> = samples.iter().map(|s| s.regress).collect();
        let surface_m: Option<Vec<Vec<f32>>> = samples.iter().map(|s| s.surface_m.clone()).collect();
        let targets: Vec<Targets> = samples.into_iter().map(|s| s.targets).collect();
        let targets = BatchTargets::new(&targets, &regress, device);
        let targets = match surface_m {
            Some(surface_m) => targets.with_surface(&surface_m),
            None => targets,
        };
        Self { input, targets }
    }
}

//! From an image and its camera to detections.

use farsight_core::detection::DecodeOptions;
use farsight_core::{Camera, ClassReference, Detection};
use farsight_graph::model::NetworkConfig;
use farsight_runtime::timing::timed;
use farsight_runtime::{EngineError, Runner, StageTimes, Tensor};
use image::RgbImage;

use super::CenterNet3dConfig;
use super::codec::STRIDE;
use super::decode::{Maps, detections};
use super::network::{DEPTH, DIMENSIONS, HEATMAP, OFFSET, ROTATION, SIZE};
use crate::batch::{InputBatch, output};
use crate::detector::{DetectError, Detector, UnfamiliarCamera};

/// A CenterNet for 3D boxes, ready to look at images.
pub struct CenterNet3dDetector {
    runner: Box<dyn Runner>,
    config: CenterNet3dConfig,
    batch: InputBatch,
}

impl CenterNet3dDetector {
    /// The network of `config`, which `runner` runs.
    pub fn new(runner: Box<dyn Runner>, config: CenterNet3dConfig) -> Self {
        Self { runner, config, batch: InputBatch::default() }
    }

    /// The outputs, their shapes checked, in the order heatmap, depth, rotation, dimensions, size, offset.
    fn maps(
        &self,
        mut outputs: Vec<Tensor>,
        images: usize,
        input_size: [usize; 2],
    ) -> Result<[Tensor; 6], DetectError> {
        let [width, height] = input_size.map(|side| side / STRIDE);
        let mut map =
            |name: &str, channels: usize| output(&*self.runner, &mut outputs, name, [images, channels, height, width]);
        Ok([
            map(HEATMAP, self.config.classes.len())?,
            map(DEPTH, 1)?,
            map(ROTATION, 8)?,
            map(DIMENSIONS, 3)?,
            map(SIZE, 2)?,
            map(OFFSET, 2)?,
        ])
    }
}

impl Detector for CenterNet3dDetector {
    fn method(&self) -> &'static str {
        CenterNet3dConfig::METHOD
    }

    fn engine(&self) -> &str {
        self.runner.engine()
    }

    fn classes(&self) -> &[ClassReference] {
        &self.config.classes
    }

    fn has_error_bars(&self) -> bool {
        self.config.error.is_some()
    }

    fn input_size(&self, image_size: [usize; 2], camera: &Camera) -> [usize; 2] {
        self.config.input_spec().input_for(image_size, camera).size
    }

    fn unfamiliar(&self, image_size: [usize; 2], camera: &Camera) -> Option<UnfamiliarCamera> {
        self.config.input_spec().unfamiliar(image_size, camera)
    }

    fn detect_batch(
        &mut self,
        images: &[(&RgbImage, &Camera)],
        options: &DecodeOptions,
    ) -> Result<(Vec<Vec<Detection>>, StageTimes), DetectError> {
        let (filled, warp) = timed(|| self.batch.fill(images, &self.config.input_spec()));
        let Some((size, views)) = filled? else { return Ok((Vec::new(), StageTimes::default())) };
        let (outputs, network) = timed(|| self.batch.run(&mut *self.runner, size));
        let tensors = self.maps(outputs?, images.len(), size)?;
        let decoded = || {
            let each = views.iter().enumerate().map(|(image, view)| {
                let [heatmap, depth, rotation, dimensions, size, offset] =
                    tensors.each_ref().map(|tensor| tensor.image(image));
                let maps = Maps { heatmap, depth, rotation, dimensions, size, offset };
                detections(&self.config, &maps, view, options)
            });
            each.collect()
        };
        let (answers, decode) = timed(decoded);
        Ok((answers, StageTimes { warp, network, decode, ..StageTimes::default() }))
    }

    fn share(&self) -> Result<Box<dyn Detector>, EngineError> {
        Ok(Box::new(Self::new(self.runner.share()?, self.config.clone())))
    }
}

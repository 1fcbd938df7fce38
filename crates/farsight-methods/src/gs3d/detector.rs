//! From an image and its camera to detections: 2D boxes, guidances, and a second look at their surfaces.

use farsight_core::detection::{DecodeOptions, View};
use farsight_core::samplers::FeatureMap;
use farsight_core::{Camera, ClassReference, Detection};
use farsight_graph::model::NetworkConfig;
use farsight_onnx::{INPUT, LocalHeadFile};
use farsight_runtime::timing::timed;
use farsight_runtime::{EngineError, Runner, StageTimes, Tensor, TensorView};
use image::RgbImage;

use super::Gs3dConfig;
use super::decode::{candidates, refined};
use super::network::{HEATMAP, REFINEMENT, REGRESSION_HEADS, SURFACE_MAP};
use super::refinement::{BINS, NUMBERS};
use super::surfaces::{SIDE, SURFACES, sample};
use crate::batch::{InputBatch, output};
use crate::center_map::STRIDE;
use crate::detector::{DetectError, Detector, UnfamiliarCamera};
use crate::method::{DetectorMethod, Method};

/// A GS3D, ready to look at images.
struct Gs3dDetector {
    /// From the image to 2D boxes and what is read at surfaces.
    image_network: Box<dyn Runner>,
    /// From what was read to bins.
    surface_network: Box<dyn Runner>,
    config: Gs3dConfig,
    batch: InputBatch,
}

impl Gs3dDetector {
    fn new(image_network: Box<dyn Runner>, surface_network: Box<dyn Runner>, config: Gs3dConfig) -> Self {
        Self { image_network, surface_network, config, batch: InputBatch::default() }
    }

    /// Heatmap, offsets, sizes, headings and the map of surfaces of a batch, their shapes checked.
    fn maps(
        &self,
        mut outputs: Vec<Tensor>,
        images: usize,
        input_size: [usize; 2],
    ) -> Result<[Tensor; 5], DetectError> {
        let [width, height] = input_size.map(|side| side / STRIDE);
        let mut map = |name: &str, channels: usize| {
            output(&*self.image_network, &mut outputs, name, [images, channels, height, width])
        };
        let heatmap = map(HEATMAP, self.config.classes.len())?;
        let [offset, size, heading] = REGRESSION_HEADS.map(|(name, channels)| map(name, channels));
        Ok([heatmap, offset?, size?, heading?, map(SURFACE_MAP, self.config.surface_channels)?])
    }

    /// What is found in the maps of one image.
    fn look(
        &mut self,
        maps: &[Tensor; 5],
        image: usize,
        view: &View,
        options: &DecodeOptions,
    ) -> Result<Vec<Detection>, DetectError> {
        let [heatmap, offset, size, heading, surfaces] = maps.each_ref().map(|map| map.image(image));
        let found = candidates(&self.config, [&heatmap, &offset, &size, &heading], view, options);
        let shape = [surfaces.shape[0], surfaces.shape[1], surfaces.shape[2]];
        let Some(map) = FeatureMap::new(surfaces.values, shape).filter(|_| !found.is_empty()) else {
            return Ok(Vec::new());
        };
        let (guidances, points): (Vec<Detection>, Vec<_>) = found.into_iter().unzip();
        let values = sample(map, &points);
        let shape = [points.len(), SURFACES * self.config.surface_channels, SIDE, SIDE];
        let mut outputs = self.surface_network.run(&[(INPUT, TensorView { shape: &shape, values: &values })])?;
        let expected = [points.len(), NUMBERS * BINS, 1, 1];
        let logits = output(&*self.surface_network, &mut outputs, REFINEMENT, expected)?;
        let each = guidances.iter().zip(logits.values.chunks_exact(NUMBERS * BINS));
        let mut found: Vec<Detection> =
            each.filter_map(|(guidance, logits)| refined(&self.config, guidance, logits)).collect();
        let min_score = options.min_score(&self.config.classes);
        found.retain(|detection| detection.score > min_score);
        found.sort_by(|a, b| b.score.total_cmp(&a.score));
        Ok(found)
    }
}

impl DetectorMethod for Gs3dConfig {
    fn detector(
        self,
        runner: Box<dyn Runner>,
        later: Vec<Box<dyn Runner>>,
        _: Option<&LocalHeadFile>,
    ) -> Option<Box<dyn Detector>> {
        Some(Box::new(Gs3dDetector::new(runner, later.into_iter().next()?, self)))
    }
}

impl Method for Gs3dConfig {
    fn counted_input(&self) -> [usize; 2] {
        self.input
    }

    fn facts(&self) -> Vec<(&'static str, String)> {
        let [width, height] = self.input;
        let classes: Vec<&str> = self.classes.iter().map(|class| class.class.name()).collect();
        vec![
            ("input", format!("{width} x {height} pixels")),
            ("classes", classes.join(", ")),
            ("backbone", self.backbone.name().to_owned()),
            ("normalisation", format!("{:?}", self.norm).to_lowercase()),
            ("boxes", "in the image; cuboids by similar triangles, refined by their surfaces (GS3D)".to_owned()),
        ]
    }
}

impl Detector for Gs3dDetector {
    fn method(&self) -> &'static str {
        Gs3dConfig::METHOD
    }

    fn engine(&self) -> &str {
        self.image_network.engine()
    }

    fn classes(&self) -> &[ClassReference] {
        &self.config.classes
    }

    fn has_error_bars(&self) -> bool {
        false
    }

    fn input_size(&self, image_size: [usize; 2], camera: &Camera) -> [usize; 2] {
        self.config.input_spec().input_for(image_size, camera).size
    }

    fn set_input_size(&mut self, size: [usize; 2]) -> bool {
        self.config.input = size;
        self.config.focal_range_px = None;
        true
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
        let (outputs, network) = timed(|| self.batch.run(&mut *self.image_network, size));
        let maps = self.maps(outputs?, images.len(), size)?;
        let look = || {
            let each = views.iter().enumerate().map(|(image, view)| self.look(&maps, image, view, options));
            each.collect::<Result<Vec<_>, _>>()
        };
        let (answers, decode) = timed(look);
        Ok((answers?, StageTimes { warp, network, decode, ..StageTimes::default() }))
    }

    fn share(&self) -> Result<Box<dyn Detector>, EngineError> {
        let (image_network, surface_network) = (self.image_network.share()?, self.surface_network.share()?);
        Ok(Box::new(Self::new(image_network, surface_network, self.config.clone())))
    }
}

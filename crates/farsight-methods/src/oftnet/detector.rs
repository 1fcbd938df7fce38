//! From an image and its camera to detections: two networks with the sampler between them.

use farsight_core::detection::DecodeOptions;
use farsight_core::samplers::FeatureMap;
use farsight_core::{Box2d, Camera, ClassReference, Detection};
use farsight_graph::model::NetworkConfig;
use farsight_onnx::{INPUT, LocalHeadFile};
use farsight_runtime::timing::timed;
use farsight_runtime::{EngineError, Runner, StageTimes, Tensor, TensorView};
use image::RgbImage;

use super::OftNetConfig;
use super::decode::detections;
use super::network::{ANSWER, ANSWERS, MAPS};
use super::sampler::{STRIDES, boxes, sample};
use crate::batch::{InputBatch, output};
use crate::detector::{DetectError, Detector, UnfamiliarCamera};
use crate::method::{DetectorMethod, Method};

/// An `OFTNet`, ready to look at images.
struct OftNetDetector {
    /// From the image to maps.
    image_network: Box<dyn Runner>,
    /// From the grid to answers.
    grid_network: Box<dyn Runner>,
    config: OftNetConfig,
    batch: InputBatch,
    /// What the sampler makes, kept from image to image.
    features: Vec<f32>,
    /// The camera that was looked through last, and where it sees the voxels.
    voxels: Option<(Camera, [Vec<Box2d>; STRIDES.len()])>,
}

impl OftNetDetector {
    fn new(image_network: Box<dyn Runner>, grid_network: Box<dyn Runner>, config: OftNetConfig) -> Self {
        let (batch, features, voxels) = (InputBatch::default(), Vec::new(), None);
        Self { image_network, grid_network, config, batch, features, voxels }
    }

    /// The maps of a batch, their shapes checked.
    fn maps(
        &self,
        mut outputs: Vec<Tensor>,
        images: usize,
        input_size: [usize; 2],
    ) -> Result<[Tensor; STRIDES.len()], DetectError> {
        let channels = self.config.channels();
        let mut map = |place: usize| {
            let [width, height] = input_size.map(|side| side / STRIDES[place]);
            output(&*self.image_network, &mut outputs, MAPS[place], [images, channels, height, width])
        };
        Ok([map(0)?, map(1)?, map(2)?])
    }

    /// What the second network says of the maps of one image, which `camera` sees as the first network's input.
    fn answer(&mut self, maps: &[Tensor; STRIDES.len()], image: usize, camera: &Camera) -> Result<Tensor, DetectError> {
        let Self { config, features, voxels, .. } = self;
        if voxels.as_ref().is_none_or(|(known, _)| known != camera) {
            *voxels = Some((*camera, boxes(&config.grid, camera)));
        }
        features.clear();
        let views = maps.each_ref().map(|map| map.image(image));
        let maps =
            views.each_ref().map(|view| FeatureMap::new(view.values, [view.shape[0], view.shape[1], view.shape[2]]));
        if let ([Some(first), Some(second), Some(third)], Some((_, boxes))) = (maps, voxels.as_ref()) {
            sample(features, [first, second, third], boxes, config.grid.slabs);
        }
        let (rows, columns) = (config.grid.rows, config.grid.columns);
        let shape = [1, features.len() / (rows * columns), rows, columns];
        let mut outputs = self.grid_network.run(&[(INPUT, TensorView { shape: &shape, values: features })])?;
        let expected = [1, ANSWERS * self.config.classes.len(), rows, columns];
        output(&*self.grid_network, &mut outputs, ANSWER, expected)
    }
}

impl DetectorMethod for OftNetConfig {
    fn detector(
        self,
        runner: Box<dyn Runner>,
        later: Vec<Box<dyn Runner>>,
        _: Option<&LocalHeadFile>,
    ) -> Option<Box<dyn Detector>> {
        Some(Box::new(OftNetDetector::new(runner, later.into_iter().next()?, self)))
    }
}

impl Method for OftNetConfig {
    fn counted_input(&self) -> [usize; 2] {
        self.input
    }

    fn facts(&self) -> Vec<(&'static str, String)> {
        let [width, height] = self.input;
        let classes: Vec<&str> = self.classes.iter().map(|class| class.class.name()).collect();
        let grid = &self.grid;
        let side = |cells: usize| cells as f64 * grid.cell_m;
        vec![
            ("input", format!("{width} x {height} pixels")),
            ("classes", classes.join(", ")),
            ("backbone", self.backbone.name().to_owned()),
            ("channels", format!("{:?} in the image, {} on the grid", self.backbone_channels(), self.channels())),
            (
                "grid",
                format!(
                    "{} x {} cells of {} m: {} m across, {} m ahead, {} m below the camera (OFTNet)",
                    grid.columns,
                    grid.rows,
                    grid.cell_m,
                    side(grid.columns),
                    side(grid.rows),
                    grid.plane_m
                ),
            ),
        ]
    }
}

impl Detector for OftNetDetector {
    fn method(&self) -> &'static str {
        OftNetConfig::METHOD
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
        let (outputs, mut network) = timed(|| self.batch.run(&mut *self.image_network, size));
        let maps = self.maps(outputs?, images.len(), size)?;
        let (mut answers, mut decode) = (Vec::with_capacity(images.len()), std::time::Duration::ZERO);
        for (image, view) in views.iter().enumerate() {
            let (answer, took) = timed(|| self.answer(&maps, image, &view.input_camera));
            network += took;
            let answer = answer?;
            let (found, took) = timed(|| detections(&self.config, &answer.image(0), view, options));
            decode += took;
            answers.push(found);
        }
        Ok((answers, StageTimes { warp, network, decode, ..StageTimes::default() }))
    }

    fn share(&self) -> Result<Box<dyn Detector>, EngineError> {
        let (image_network, grid_network) = (self.image_network.share()?, self.grid_network.share()?);
        Ok(Box::new(Self::new(image_network, grid_network, self.config.clone())))
    }
}

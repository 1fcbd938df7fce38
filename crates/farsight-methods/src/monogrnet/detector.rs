//! From an image and its camera to detections: three networks with the samplers between them.

use farsight_core::detection::{DecodeOptions, View};
use farsight_core::samplers::FeatureMap;
use farsight_core::{Box2d, Camera, ClassReference, Detection};
use farsight_graph::model::NetworkConfig;
use farsight_onnx::{INPUT, LocalHeadFile};
use farsight_runtime::timing::timed;
use farsight_runtime::{EngineError, Runner, StageTimes, Tensor, TensorView};
use image::RgbImage;

use super::MonoGrNetConfig;
use super::decode::{CellBox, Placed, cell_boxes, detection, placed, shown};
use super::layout::{BOX_NUMBERS, CELL_STRIDE, CORNER_NUMBERS, MAP_STRIDE, SIDE};
use super::network::{BOX_MAP, BRANCHES, CELLS, CENTER, CORNER_MAP, CORNER_STEPS, DEPTH, REZOOM};
use super::sampler::sample;
use crate::batch::{InputBatch, output};
use crate::detector::{DetectError, Detector, UnfamiliarCamera};
use crate::method::{DetectorMethod, Method};

/// A `MonoGRNet`, ready to look at images.
struct MonoGrNetDetector {
    /// From the image to cells and maps.
    image_network: Box<dyn Runner>,
    /// From what was read at 2D boxes to corners.
    box_network: Box<dyn Runner>,
    /// From what was read at 3D boxes to better corners.
    corner_network: Box<dyn Runner>,
    config: MonoGrNetConfig,
    batch: InputBatch,
}

/// What the first network says of a batch: cells, depths, centres, and the maps that are read at 2D and at 3D boxes.
type Maps = [Tensor; 5];

impl MonoGrNetDetector {
    /// The maps of a batch, their shapes checked.
    fn maps(&self, mut outputs: Vec<Tensor>, images: usize, input_size: [usize; 2]) -> Result<Maps, DetectError> {
        let mut map = |name: &str, channels: usize, stride: usize| {
            let [width, height] = input_size.map(|side| side / stride);
            output(&*self.image_network, &mut outputs, name, [images, channels, height, width])
        };
        let channels = self.config.head_channels(128);
        Ok([
            map(CELLS, self.config.scores() + BOX_NUMBERS, CELL_STRIDE)?,
            map(DEPTH, 1, CELL_STRIDE)?,
            map(CENTER, 2, CELL_STRIDE)?,
            map(BOX_MAP, BRANCHES.len() * channels, MAP_STRIDE)?,
            map(CORNER_MAP, channels, MAP_STRIDE)?,
        ])
    }

    /// What is found in the maps of one image.
    fn look(
        &mut self,
        maps: &Maps,
        image: usize,
        view: &View,
        options: &DecodeOptions,
    ) -> Result<Vec<Detection>, DetectError> {
        let [cells, depth, center, box_map, corner_map] = maps.each_ref().map(|map| map.image(image));
        let found = cell_boxes(&self.config, [&cells, &depth, &center], options);
        let found = self.placed(&found, &box_map, view)?;
        let boxes: Vec<Box2d> = found.iter().map(|one| one.seen).collect();
        let Some(values) = cropped(&corner_map, &boxes) else { return Ok(Vec::new()) };
        let shape = [boxes.len(), self.config.head_channels(128), SIDE, SIDE];
        let mut outputs = self.corner_network.run(&[(INPUT, TensorView { shape: &shape, values: &values })])?;
        let expected = [boxes.len(), CORNER_NUMBERS, 1, 1];
        let steps = output(&*self.corner_network, &mut outputs, CORNER_STEPS, expected)?;
        let each = found.iter().zip(steps.values.chunks_exact(CORNER_NUMBERS));
        let found = each.filter_map(|(placed, steps)| detection(&self.config, placed, steps, view)).collect();
        Ok(shown(&self.config, found, options))
    }

    /// What the second network says of the boxes that cells have found.
    fn placed(&mut self, found: &[CellBox], map: &TensorView<'_>, view: &View) -> Result<Vec<Placed>, DetectError> {
        let boxes: Vec<Box2d> = found.iter().map(|one| one.box2d).collect();
        let Some(values) = cropped(map, &boxes) else { return Ok(Vec::new()) };
        let shape = [boxes.len(), BRANCHES.len() * self.config.head_channels(128), SIDE, SIDE];
        let mut outputs = self.box_network.run(&[(INPUT, TensorView { shape: &shape, values: &values })])?;
        let mut answers = Vec::with_capacity(BRANCHES.len());
        for (name, numbers) in BRANCHES {
            let numbers = if name == REZOOM { self.config.scores() + numbers } else { numbers };
            let answer = output(&*self.box_network, &mut outputs, name, [boxes.len(), numbers, 1, 1])?;
            answers.push((answer, numbers));
        }
        let place = |(place, found): (usize, &CellBox)| {
            let said = |branch: usize| {
                let (answer, numbers) = &answers[branch];
                &answer.values[place * numbers..(place + 1) * numbers]
            };
            placed(&self.config, found, [0, 1, 2, 3].map(said), &view.input_camera)
        };
        Ok(found.iter().enumerate().filter_map(place).collect())
    }
}

/// What a map of one image shows in boxes on the grid; none without boxes.
fn cropped(map: &TensorView<'_>, boxes: &[Box2d]) -> Option<Vec<f32>> {
    let map = FeatureMap::new(map.values, [map.shape[0], map.shape[1], map.shape[2]])?;
    (!boxes.is_empty()).then(|| sample(map, boxes))
}

impl DetectorMethod for MonoGrNetConfig {
    fn detector(
        self,
        runner: Box<dyn Runner>,
        later: Vec<Box<dyn Runner>>,
        _: Option<&LocalHeadFile>,
    ) -> Option<Box<dyn Detector>> {
        let [box_network, corner_network] = later.try_into().ok()?;
        let (image_network, batch) = (runner, InputBatch::default());
        Some(Box::new(MonoGrNetDetector { image_network, box_network, corner_network, config: self, batch }))
    }
}

impl Method for MonoGrNetConfig {
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
            ("boxes", "of cells, looked at again for depth, centre and corners, and once more (MonoGRNet)".to_owned()),
        ]
    }
}

impl Detector for MonoGrNetDetector {
    fn method(&self) -> &'static str {
        MonoGrNetConfig::METHOD
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
        Ok(Box::new(Self {
            image_network: self.image_network.share()?,
            box_network: self.box_network.share()?,
            corner_network: self.corner_network.share()?,
            config: self.config.clone(),
            batch: InputBatch::default(),
        }))
    }
}

//! From an image and its camera to detections: three networks with the samplers between them.

use farsight_core::detection::{DecodeOptions, View};
use farsight_core::{Box2d, ClassReference, Detection};
use farsight_onnx::LocalHeadFile;
use farsight_runtime::{Runner, TensorView};

use super::MonoGrNetConfig;
use super::decode::{CellBox, Placed, cell_boxes, detection, placed, shown};
use super::layout::{BOX_NUMBERS, CELL_STRIDE, CORNER_NUMBERS, MAP_STRIDE, SIDE};
use super::network::{BOX_MAP, BRANCHES, CELLS, CENTER, CORNER_MAP, CORNER_STEPS, DEPTH, REZOOM};
use super::sampler::sample;
use crate::cut::{CutMethod, LaterParts, detector, feature_map};
use crate::detector::{DetectError, Detector};
use crate::input_spec::InputSpec;
use crate::method::{DetectorMethod, Method};

/// The parts after the first one: from what was read at 2D boxes to corners, and from what was read at 3D boxes to
/// better corners.
const BOXES: usize = 0;
const CORNERS: usize = 1;

impl CutMethod for MonoGrNetConfig {
    const LATER: usize = 2;

    type Kept = ();

    fn classes(&self) -> &[ClassReference] {
        &self.classes
    }

    fn input_spec(&self) -> InputSpec {
        self.input_spec()
    }

    /// Cells, depths, centres, and the maps that are read at 2D and at 3D boxes.
    fn maps(&self) -> Vec<(&'static str, usize, usize)> {
        let channels = self.head_channels(128);
        vec![
            (CELLS, self.scores() + BOX_NUMBERS, CELL_STRIDE),
            (DEPTH, 1, CELL_STRIDE),
            (CENTER, 2, CELL_STRIDE),
            (BOX_MAP, BRANCHES.len() * channels, MAP_STRIDE),
            (CORNER_MAP, channels, MAP_STRIDE),
        ]
    }

    fn look(
        &self,
        later: &mut LaterParts,
        (): &mut (),
        maps: &[TensorView<'_>],
        view: &View,
        options: &DecodeOptions,
    ) -> Result<Vec<Detection>, DetectError> {
        let [cells, depth, center, box_map, corner_map] = maps else { return Ok(Vec::new()) };
        let found = cell_boxes(self, [cells, depth, center], options);
        let found = placed_boxes(self, later, &found, box_map, view)?;
        let boxes: Vec<Box2d> = found.iter().map(|one| one.seen).collect();
        let Some(values) = cropped(corner_map, &boxes) else { return Ok(Vec::new()) };
        let shape = [boxes.len(), self.head_channels(128), SIDE, SIDE];
        let expected = [(CORNER_STEPS, [boxes.len(), CORNER_NUMBERS, 1, 1])];
        let [steps] = later.run(CORNERS, &shape, &values, expected)?;
        let each = found.iter().zip(steps.values.chunks_exact(CORNER_NUMBERS));
        let found = each.filter_map(|(placed, steps)| detection(self, placed, steps, view)).collect();
        Ok(shown(self, found, options))
    }
}

/// What the second network says of the boxes that cells have found.
fn placed_boxes(
    config: &MonoGrNetConfig,
    later: &mut LaterParts,
    found: &[CellBox],
    map: &TensorView<'_>,
    view: &View,
) -> Result<Vec<Placed>, DetectError> {
    let boxes: Vec<Box2d> = found.iter().map(|one| one.box2d).collect();
    let Some(values) = cropped(map, &boxes) else { return Ok(Vec::new()) };
    let shape = [boxes.len(), BRANCHES.len() * config.head_channels(128), SIDE, SIDE];
    let numbers = BRANCHES.map(|(name, numbers)| if name == REZOOM { config.scores() + numbers } else { numbers });
    let expected = std::array::from_fn(|branch| (BRANCHES[branch].0, [boxes.len(), numbers[branch], 1, 1]));
    let answers: [_; BRANCHES.len()] = later.run(BOXES, &shape, &values, expected)?;
    let place = |(place, found): (usize, &CellBox)| {
        let said = |branch: usize| &answers[branch].values[place * numbers[branch]..(place + 1) * numbers[branch]];
        placed(config, found, [0, 1, 2, 3].map(said), &view.input_camera)
    };
    Ok(found.iter().enumerate().filter_map(place).collect())
}

/// What a map of one image shows in boxes on the grid; none without boxes.
fn cropped(map: &TensorView<'_>, boxes: &[Box2d]) -> Option<Vec<f32>> {
    let map = feature_map(map)?;
    (!boxes.is_empty()).then(|| sample(map, boxes))
}

impl DetectorMethod for MonoGrNetConfig {
    fn detector(
        self,
        runner: Box<dyn Runner>,
        later: Vec<Box<dyn Runner>>,
        _: Option<&LocalHeadFile>,
    ) -> Option<Box<dyn Detector>> {
        detector(runner, later, self)
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

//! From an image and its camera to detections: two networks with the sampler between them.

use farsight_core::detection::{DecodeOptions, View};
use farsight_core::{Box2d, Camera, ClassReference, Detection};
use farsight_onnx::LocalHeadFile;
use farsight_runtime::{Runner, TensorView};

use super::OftNetConfig;
use super::decode::detections;
use super::network::{ANSWER, ANSWERS, MAPS};
use super::sampler::{STRIDES, boxes, sample};
use crate::cut::{CutMethod, LaterParts, detector, feature_map};
use crate::detector::{DetectError, Detector};
use crate::input_spec::InputSpec;
use crate::method::{DetectorMethod, Method};

/// What is kept from image to image.
#[derive(Debug, Default)]
pub(crate) struct Kept {
    /// What the sampler makes.
    features: Vec<f32>,
    /// The camera that was looked through last, and where it sees the voxels.
    voxels: Option<(Camera, [Vec<Box2d>; STRIDES.len()])>,
}

impl CutMethod for OftNetConfig {
    /// From the grid to answers.
    const LATER: usize = 1;

    type Kept = Kept;

    fn classes(&self) -> &[ClassReference] {
        &self.classes
    }

    fn input_spec(&self) -> InputSpec {
        self.input_spec()
    }

    fn maps(&self) -> Vec<(&'static str, usize, usize)> {
        MAPS.into_iter().zip(STRIDES).map(|(name, stride)| (name, self.channels(), stride)).collect()
    }

    fn look(
        &self,
        later: &mut LaterParts,
        kept: &mut Kept,
        maps: &[TensorView<'_>],
        view: &View,
        options: &DecodeOptions,
    ) -> Result<Vec<Detection>, DetectError> {
        let (Kept { features, voxels }, camera) = (kept, view.input_camera);
        if voxels.as_ref().is_none_or(|(known, _)| *known != camera) {
            *voxels = Some((camera, boxes(&self.grid, &camera)));
        }
        features.clear();
        if let ([first, second, third], Some((_, boxes))) = (maps, voxels.as_ref())
            && let (Some(first), Some(second), Some(third)) =
                (feature_map(first), feature_map(second), feature_map(third))
        {
            sample(features, [first, second, third], boxes, self.grid.slabs);
        }
        let (rows, columns) = (self.grid.rows, self.grid.columns);
        let shape = [1, features.len() / (rows * columns), rows, columns];
        let expected = [(ANSWER, [1, ANSWERS * self.classes.len(), rows, columns])];
        let [answer] = later.run(0, &shape, features, expected)?;
        Ok(detections(self, &answer.image(0), view, options))
    }
}

impl DetectorMethod for OftNetConfig {
    fn detector(
        self,
        runner: Box<dyn Runner>,
        later: Vec<Box<dyn Runner>>,
        _: Option<&LocalHeadFile>,
    ) -> Option<Box<dyn Detector>> {
        detector(runner, later, self)
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

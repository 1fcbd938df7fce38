//! From an image and its camera to detections: 2D boxes, guidances, and a second look at their surfaces.

use farsight_core::detection::{DecodeOptions, View};
use farsight_core::{ClassReference, Detection};
use farsight_onnx::LocalHeadFile;
use farsight_runtime::{Runner, TensorView};

use super::Gs3dConfig;
use super::decode::{candidates, refined};
use super::network::{HEATMAP, REFINEMENT, REGRESSION_HEADS, SURFACE_MAP};
use super::refinement::{BINS, NUMBERS};
use super::surfaces::{SIDE, SURFACES, sample};
use crate::center_map::STRIDE;
use crate::cut::{CutMethod, LaterParts, detector, feature_map};
use crate::detector::{DetectError, Detector};
use crate::input_spec::InputSpec;
use crate::method::{DetectorMethod, Method};

impl CutMethod for Gs3dConfig {
    /// From what was read at surfaces to bins.
    const LATER: usize = 1;

    type Kept = ();

    fn classes(&self) -> &[ClassReference] {
        &self.classes
    }

    fn input_spec(&self) -> InputSpec {
        self.input_spec()
    }

    fn maps(&self) -> Vec<(&'static str, usize, usize)> {
        let heads = REGRESSION_HEADS.map(|(name, channels)| (name, channels, STRIDE));
        let (heatmap, surfaces) = ((HEATMAP, self.classes.len(), STRIDE), (SURFACE_MAP, self.surface_channels, STRIDE));
        [&[heatmap], &heads[..], &[surfaces]].concat()
    }

    fn look(
        &self,
        later: &mut LaterParts,
        (): &mut (),
        maps: &[TensorView<'_>],
        view: &View,
        options: &DecodeOptions,
    ) -> Result<Vec<Detection>, DetectError> {
        let [heatmap, offset, size, heading, surfaces] = maps else { return Ok(Vec::new()) };
        let found = candidates(self, [heatmap, offset, size, heading], view, options);
        let Some(map) = feature_map(surfaces).filter(|_| !found.is_empty()) else { return Ok(Vec::new()) };
        let (guidances, points): (Vec<Detection>, Vec<_>) = found.into_iter().unzip();
        let values = sample(map, &points);
        let shape = [points.len(), SURFACES * self.surface_channels, SIDE, SIDE];
        let expected = [(REFINEMENT, [points.len(), NUMBERS * BINS, 1, 1])];
        let [logits] = later.run(0, &shape, &values, expected)?;
        let each = guidances.iter().zip(logits.values.chunks_exact(NUMBERS * BINS));
        let mut found: Vec<Detection> = each.filter_map(|(guidance, logits)| refined(self, guidance, logits)).collect();
        let min_score = options.min_score(&self.classes);
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
        detector(runner, later, self)
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

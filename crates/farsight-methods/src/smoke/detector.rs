//! From the maps of SMOKE's network to detections.

use farsight_core::detection::{DecodeOptions, View};
use farsight_core::{ClassReference, Detection};
use farsight_graph::model::NetworkConfig;
use farsight_runtime::{EngineError, Runner};

use super::codec::{CHANNELS, STRIDE};
use super::decode::{HeadMaps, detections, detections_at_peaks};
use super::network::{LOGITS, REGRESSION};
use super::{Codec, SmokeConfig, SparseHead};
use crate::detector::DetectError;
use crate::network_detector::{NetworkDetector, NetworkOutputs, PostProcessor};

/// A SMOKE model ready to look at images.
pub type SmokeDetector = NetworkDetector<SmokePostProcessor>;

impl SmokeDetector {
    /// The model of `config`, which `runner` runs. A network that ends before its regression head has it in `head`.
    pub fn new(runner: Box<dyn Runner>, config: &SmokeConfig, head: Option<SparseHead>) -> Self {
        let other = runner.outputs().iter().find(|output| output.name != LOGITS);
        let regression = other.map_or_else(|| REGRESSION.to_owned(), |output| output.name.clone());
        let post_processor = SmokePostProcessor { codec: config.codec(), head, regression };
        Self::with_post_processor(runner, config.input_spec(), post_processor)
    }
}

/// Reads SMOKE's heatmap and regression.
#[derive(Debug, Clone)]
pub struct SmokePostProcessor {
    codec: Codec,
    /// What the runner's network leaves to be done at the peaks.
    head: Option<SparseHead>,
    /// The output that has the regression, or the features that the head reads.
    regression: String,
}

impl SmokePostProcessor {
    /// What its answers mean.
    pub fn codec(&self) -> &Codec {
        &self.codec
    }

    fn decoded(&self, maps: &HeadMaps, view: &View, options: &DecodeOptions) -> Vec<Detection> {
        let codec = &self.codec;
        let Some(head) = &self.head else { return detections(codec, maps, view, options) };
        let regression = |cell| head.regression(&maps.regression, maps.map_size, cell);
        detections_at_peaks(codec, &maps.logits, maps.map_size, regression, view, options)
    }
}

impl PostProcessor for SmokePostProcessor {
    const METHOD: &'static str = SmokeConfig::METHOD;

    fn classes(&self) -> &[ClassReference] {
        &self.codec.classes
    }

    fn has_error_bars(&self) -> bool {
        self.codec.depth.error.is_some()
    }

    /// 2D boxes are projected by the whole camera even for models that see it without its fourth column, so that they
    /// lie where the image shows the object; official SMOKE's own 2D boxes stand off by up to 9 pixels at 5 m (spec
    /// 5.6).
    fn post_process(
        &mut self,
        outputs: &mut NetworkOutputs<'_>,
        views: &[View],
        options: &DecodeOptions,
    ) -> Result<Vec<Vec<Detection>>, DetectError> {
        let channels = self.head.as_ref().map_or(CHANNELS, SparseHead::channels);
        let logits = outputs.take(LOGITS, self.codec.classes.len(), STRIDE)?;
        let regression = outputs.take(&self.regression, channels, STRIDE)?;
        let maps = HeadMaps::of_batch(logits, regression);
        let answers = maps.iter().zip(views).map(|(maps, view)| self.decoded(maps, view, options)).collect();
        for HeadMaps { logits, regression, .. } in maps {
            outputs.recycle(logits);
            outputs.recycle(regression);
        }
        Ok(answers)
    }

    fn share(&self) -> Result<Self, EngineError> {
        Ok(self.clone())
    }
}

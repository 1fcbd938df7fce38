//! The network that estimates cameras: its config and its graph.

use farsight_graph::graph::{Graph, Window};
use farsight_graph::layers::inverted_residuals::Convention;
use farsight_graph::layers::{Builder, NormKind, mobilenet_v2};
use farsight_graph::model::NetworkConfig;
use serde::{Deserialize, Serialize};

use super::geometry::{ANSWER_CHANNELS, INPUT_CHANNELS, INPUT_SIZE};
use crate::method::Method;
use crate::roi::ANSWER;

/// A camera estimator.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CameraEstimatorConfig {
    /// Channels after the backbone.
    pub channels: usize,
    /// Standard deviations of its errors are those that the network tells times this: fitted on labelled frames.
    pub error_scale: f64,
}

impl Default for CameraEstimatorConfig {
    fn default() -> Self {
        Self { channels: 96, error_scale: 1.0 }
    }
}

/// The last convolution takes in what is left of the map, three cells wide and one high.
const REST: Window = Window { kernel: 3, stride: 3, padding: 0, end_padding: 2, dilation: 1 };

impl NetworkConfig for CameraEstimatorConfig {
    const METHOD: &'static str = "camera_estimator";
    const NAME: &'static str = "a camera estimator";
    const OUTPUTS: &'static [&'static str] = &[ANSWER];

    fn problem(&self) -> Option<String> {
        let Self { channels, error_scale } = self;
        if !(1..=4096).contains(channels) {
            return Some(format!("model.channels is {channels}; expected 1 to 4096"));
        }
        let is_usable = *error_scale > 0.0 && *error_scale <= 100.0;
        (!is_usable).then(|| format!("model.error_scale is {error_scale}; expected a positive number up to 100"))
    }

    /// `MobileNetV2`; after it convolutions that take the map of 10 x 6 cells together, so that each place in the image
    /// has weights of its own.
    ///
    /// # Shapes
    /// From `[batch, 3, 192, 320]` to `[batch, 6, 1, 1]`.
    fn graph(&self) -> Graph {
        let mut b = Builder::new(NormKind::Batch);
        let input = b.input(INPUT_CHANNELS);
        let [.., last] = mobilenet_v2(&mut b, input, 1.0, Convention::Torchvision);
        b.stage("camera");
        let windows = [Window::same(1, 1), Window::same(3, 2), Window { padding: 0, ..Window::same(3, 1) }, REST];
        let mut x = last;
        for (i, window) in windows.into_iter().enumerate() {
            x = b.conv_norm_relu(x, &format!("camera.conv{i}"), &format!("camera.norm{i}"), self.channels, window);
        }
        let answer = b.conv_with_bias(x, "answer", ANSWER_CHANNELS, 1, None);
        b.tap(ANSWER, answer);
        b.finish()
    }
}

impl Method for CameraEstimatorConfig {
    fn counted_input(&self) -> [usize; 2] {
        INPUT_SIZE
    }

    fn facts(&self) -> Vec<(&'static str, String)> {
        let [width, height] = INPUT_SIZE;
        vec![
            (
                "camera estimator",
                format!("field of view, pitch and roll of a whole image at {width} x {height} pixels"),
            ),
            ("backbone", "MobileNetV2".to_owned()),
            ("error scale", format!("{:.2}", self.error_scale)),
        ]
    }
}

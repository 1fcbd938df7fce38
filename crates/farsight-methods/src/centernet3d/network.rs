//! The network: one of SMOKE's backbones with its neck, six heads.

use farsight_graph::graph::{Graph, Init, NodeId};
use farsight_graph::layers::Builder;
use farsight_graph::model::NetworkConfig;

use super::config::CenterNet3dConfig;

/// Logits of the heatmap, one channel a class.
pub const HEATMAP: &str = "hm";
/// Depth before its activation, one channel.
pub const DEPTH: &str = "dep";
/// Heading in two bins, eight channels: for each bin two logits, sine and cosine.
pub const ROTATION: &str = "rot";
/// Height, width and length, metres.
pub const DIMENSIONS: &str = "dim";
/// Width and height of the 2D box, cells.
pub const SIZE: &str = "wh";
/// Position of the 2D box's centre within its cell, cells.
pub const OFFSET: &str = "reg";

/// The heads beside the heatmap, and their channels.
pub const REGRESSION_HEADS: [(&str, usize); 5] = [(DEPTH, 1), (ROTATION, 8), (DIMENSIONS, 3), (SIZE, 2), (OFFSET, 2)];

/// Logit at which the heatmap starts: a probability near 0.1.
const PRIOR_LOGIT: f32 = -2.19;

impl NetworkConfig for CenterNet3dConfig {
    const METHOD: &'static str = "centernet3d";
    const NAME: &'static str = "a CenterNet for 3D boxes";
    const OUTPUTS: &'static [&'static str] = &[HEATMAP, DEPTH, ROTATION, DIMENSIONS, SIZE, OFFSET];

    fn problem(&self) -> Option<String> {
        self.problem_of_fields()
    }

    fn graph(&self) -> Graph {
        network(self)
    }

    fn without_fit(mut self) -> Self {
        self.error = None;
        self.classes.iter_mut().for_each(|class| class.score = None);
        self
    }
}

/// The network that `config` describes.
fn network(config: &CenterNet3dConfig) -> Graph {
    let mut b = Builder::new(config.norm);
    let channels = config.channels();
    let input = b.input(3);
    let levels = config.backbone.levels(&mut b, input, channels, config.stem, config.width);
    let features = config.backbone.neck(&mut b, &levels, channels, config.neck_width(), config.neck);
    let heatmap = head(&mut b, features, HEATMAP, config.head_width(), config.classes.len(), PRIOR_LOGIT);
    b.tap(HEATMAP, heatmap);
    for (name, channels) in REGRESSION_HEADS {
        let output = head(&mut b, features, name, config.head_width(), channels, 0.0);
        b.tap(name, output);
    }
    b.finish()
}

/// A 3x3 convolution, `ReLU`, a 1x1 convolution; biases start at zero, the last one at `bias`.
fn head(b: &mut Builder, x: NodeId, name: &'static str, width: usize, channels: usize, bias: f32) -> NodeId {
    b.stage(name);
    let x = b.conv_with_bias(x, &format!("heads.{name}.0"), width, 3, Some(Init::Constant(0.0)));
    let x = b.relu(x);
    b.conv_with_bias(x, &format!("heads.{name}.2"), channels, 1, Some(Init::Constant(bias)))
}

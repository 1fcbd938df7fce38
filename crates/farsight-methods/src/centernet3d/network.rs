//! The network: one of SMOKE's backbones with its neck, six heads.

use farsight_graph::graph::Graph;
use farsight_graph::layers::Builder;
use farsight_graph::model::NetworkConfig;

use super::config::CenterNet3dConfig;
use crate::center_map::{CenterMethod, PRIOR_LOGIT, head};

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
    let features = config.features().append(&mut b);
    let width = config.features().head_width();
    let heatmap = head(&mut b, features, HEATMAP, [width, config.classes.len()], None, PRIOR_LOGIT);
    b.tap(HEATMAP, heatmap);
    for (name, channels) in REGRESSION_HEADS {
        let output = head(&mut b, features, name, [width, channels], None, 0.0);
        b.tap(name, output);
    }
    b.finish()
}

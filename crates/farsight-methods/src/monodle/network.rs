//! The network: backbone and neck, seven heads.

use farsight_graph::graph::{Graph, Init};
use farsight_graph::layers::Builder;
use farsight_graph::model::NetworkConfig;

use super::config::MonoDleConfig;
use crate::center_map::{CenterMethod, HEADING_BINS, PRIOR_LOGIT, head};

/// Logits of the heatmap, one channel a class.
pub const HEATMAP: &str = "heatmap";
/// From the cell to the centre of the 2D box, cells.
pub const BOX_OFFSET: &str = "offset_2d";
/// Width and height of the 2D box, cells.
pub const BOX_SIZE: &str = "size_2d";
/// Depth before its activation, and the logarithm of its variance.
pub const DEPTH: &str = "depth";
/// From the cell to the projected centre of the 3D box, cells.
pub const CENTER_OFFSET: &str = "offset_3d";
/// Height, width and length, metres.
pub const DIMENSIONS: &str = "size_3d";
/// A logit for each bin of the observation angle, then the residual in each, radians.
pub const HEADING: &str = "heading";

/// The heads beside the heatmap, and their channels.
pub const REGRESSION_HEADS: [(&str, usize); 6] =
    [(BOX_OFFSET, 2), (BOX_SIZE, 2), (DEPTH, 2), (CENTER_OFFSET, 2), (DIMENSIONS, 3), (HEADING, 2 * HEADING_BINS)];

/// Standard deviation of the weights that heads beside the heatmap start with (authors' code).
const HEAD_STD: f32 = 0.001;

impl NetworkConfig for MonoDleConfig {
    const METHOD: &'static str = "monodle";
    const NAME: &'static str = "a MonoDLE";
    const OUTPUTS: &'static [&'static str] =
        &[HEATMAP, BOX_OFFSET, BOX_SIZE, DEPTH, CENTER_OFFSET, DIMENSIONS, HEADING];

    fn problem(&self) -> Option<String> {
        self.problem_of_fields()
    }

    fn graph(&self) -> Graph {
        network(self)
    }

    fn without_fit(mut self) -> Self {
        self.classes.iter_mut().for_each(|class| class.score = None);
        self
    }
}

/// The network that `config` describes.
fn network(config: &MonoDleConfig) -> Graph {
    let mut b = Builder::new(config.norm);
    let features = config.features().append(&mut b);
    let width = config.features().head_width();
    let heatmap = head(&mut b, features, HEATMAP, [width, config.classes.len()], None, PRIOR_LOGIT);
    b.tap(HEATMAP, heatmap);
    for (name, channels) in REGRESSION_HEADS {
        let output = head(&mut b, features, name, [width, channels], Some(Init::Normal(HEAD_STD)), 0.0);
        b.tap(name, output);
    }
    b.finish()
}

//! The network: backbone, pyramid and four heads, a sampler, and what looks at the samples.

use farsight_graph::graph::{Graph, Init, NodeId, Window};
use farsight_graph::layers::Builder;
use farsight_graph::model::NetworkConfig;

use super::config::Gs3dConfig;
use super::refinement::{BINS, NUMBERS};
use super::surfaces::{SIDE, SURFACES};
use crate::center_map::{HEADING_BINS, PRIOR_LOGIT, head};

/// Logits of the heatmap of 2D boxes' centres, one channel a class.
pub const HEATMAP: &str = "heatmap";
/// Position of the centre within its cell, cells.
pub const OFFSET: &str = "offset";
/// Width and height of the 2D box, cells.
pub const SIZE: &str = "size";
/// A logit for each bin of the observation angle, then the residual in each, radians.
pub const HEADING: &str = "heading";
/// What the sampler reads at the surfaces of cuboids.
pub const SURFACE_MAP: &str = "surfaces";
/// Logits of the refinement: for each of its numbers its bins.
pub const REFINEMENT: &str = "refinement";

/// The heads beside the heatmap, and their channels.
pub const REGRESSION_HEADS: [(&str, usize); 3] = [(OFFSET, 2), (SIZE, 2), (HEADING, 2 * HEADING_BINS)];

/// Logit at which the bins start: nearly all of them are wrong.
const REFINEMENT_PRIOR: f32 = -2.0;

impl NetworkConfig for Gs3dConfig {
    const METHOD: &'static str = "gs3d";
    const NAME: &'static str = "a GS3D";
    const OUTPUTS: &'static [&'static str] = &[REFINEMENT];

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
fn network(config: &Gs3dConfig) -> Graph {
    let mut b = Builder::new(config.norm);
    let features = config.features().append(&mut b);
    let width = config.features().head_width();
    let heatmap = head(&mut b, features, HEATMAP, [width, config.classes.len()], None, PRIOR_LOGIT);
    b.tap(HEATMAP, heatmap);
    let mut maps = vec![heatmap];
    for (name, channels) in REGRESSION_HEADS {
        let output = head(&mut b, features, name, [width, channels], None, 0.0);
        b.tap(name, output);
        maps.push(output);
    }
    b.stage(SURFACE_MAP);
    let channels = config.surface_channels;
    let surfaces = b.conv_with_bias(features, "surfaces", channels, 1, None);
    let surfaces = b.relu(surfaces);
    b.tap(SURFACE_MAP, surfaces);
    maps.push(surfaces);
    b.stage(REFINEMENT);
    let sampled = b.sampler(&maps, SURFACES * channels, [SIDE, SIDE]);
    let refinement = refinement(&mut b, sampled, channels, config.hidden);
    b.tap(REFINEMENT, refinement);
    b.finish()
}

/// A convolution of its own for each surface, then all of them together.
fn refinement(b: &mut Builder, sampled: NodeId, channels: usize, hidden: usize) -> NodeId {
    let looked = |b: &mut Builder, surface: usize| {
        let one = b.narrow(sampled, surface * channels, channels);
        let one = b.conv_with_bias(one, &format!("refine.surface{surface}"), channels, 3, None);
        b.relu(one)
    };
    let all: Vec<NodeId> = (0..SURFACES).map(|surface| looked(b, surface)).collect();
    let all = b.concat(&all);
    let whole = Window { padding: 0, ..Window::same(SIDE, 1) };
    let bound = 1.0 / ((SIDE * SIDE * SURFACES * channels) as f32).sqrt();
    let x = b.conv_started(all, "refine.joined", hidden, whole, [Init::Uniform(bound); 2]);
    let x = b.relu(x);
    b.conv_with_bias(x, "refine.bins", NUMBERS * BINS, 1, Some(Init::Constant(REFINEMENT_PRIOR)))
}

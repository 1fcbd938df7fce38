//! The network: a `ResNet` and three lateral convolutions, a sampler, residual blocks on the grid and a head.

use farsight_graph::graph::{Graph, NodeId};
use farsight_graph::layers::Builder;
use farsight_graph::layers::resnet::basic_block;
use farsight_graph::model::NetworkConfig;

use super::config::{GROUPS, OftNetConfig};
use super::sampler::STRIDES;

/// Maps of the image that the sampler reads, by stride.
pub const MAPS: [&str; STRIDES.len()] = ["map8", "map16", "map32"];

/// The only output: for each class its [`ANSWERS`].
pub const ANSWER: &str = "answer";

/// Channels of a class: score, offset of the place (3), size (3), cosine and sine of the yaw.
pub const ANSWERS: usize = 9;

impl NetworkConfig for OftNetConfig {
    const METHOD: &'static str = "oftnet";
    const NAME: &'static str = "an OFTNet";
    const OUTPUTS: &'static [&'static str] = &[ANSWER];

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
fn network(config: &OftNetConfig) -> Graph {
    let mut b = Builder::with_groups(GROUPS);
    let image = b.input(3);
    let [_, levels @ ..] = config.backbone.append(&mut b, image, "frontend.", config.backbone_channels());
    let channels = config.channels();
    b.stage("laterals");
    let mut maps = [image; STRIDES.len()];
    for (place, level) in levels.into_iter().enumerate() {
        let stride = STRIDES[place];
        let conv = b.conv_with_bias(level, &format!("lat{stride}"), channels, 1, None);
        let normal = b.norm(conv, &format!("bn{stride}"));
        maps[place] = b.relu(normal);
        b.tap(MAPS[place], maps[place]);
    }
    let x = transform(&mut b, config, &maps, channels);
    let x = (0..config.blocks).fold(x, |x, block| {
        b.stage("topdown");
        basic_block(&mut b, x, &format!("topdown.{block}"), channels, 1)
    });
    b.stage("head");
    let answer = b.conv_with_bias(x, "head", ANSWERS * config.classes.len(), 3, None);
    b.tap(ANSWER, answer);
    b.finish()
}

/// What the slabs of each map say together, summed over the maps.
fn transform(b: &mut Builder, config: &OftNetConfig, maps: &[NodeId], channels: usize) -> NodeId {
    b.stage("transform");
    let of_map = config.grid.slabs * channels;
    let sampled = b.sampler(maps, of_map * maps.len(), [config.grid.columns, config.grid.rows]);
    let mut sum = None;
    for (place, stride) in STRIDES.into_iter().enumerate() {
        let voxels = b.narrow(sampled, place * of_map, of_map);
        let joined = b.conv_with_bias(voxels, &format!("oft{stride}.conv3d"), channels, 1, None);
        let joined = b.relu(joined);
        sum = Some(sum.map_or(joined, |sum| b.add(sum, joined)));
    }
    sum.unwrap_or(sampled)
}

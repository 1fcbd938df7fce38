//! The network: a backbone and what every cell says, then a sampler and what is said of each 2D box, then a sampler and
//! what is said of each 3D box.

use farsight_graph::graph::{Graph, Init, NodeId, Window};
use farsight_graph::layers::Builder;
use farsight_graph::model::NetworkConfig;

use super::config::MonoGrNetConfig;
use super::layout::{BOX_NUMBERS, CORNER_NUMBERS, SIDE};

/// Of each cell: logits of background and classes, then its 2D box.
pub const CELLS: &str = "cells";
/// Of each cell: virtual depth, metres, less [`super::codec::START_DEPTH_M`].
pub const DEPTH: &str = "depth";
/// Of each cell: where the centre of the 3D box is seen.
pub const CENTER: &str = "center";
/// What is read at 2D boxes: a part for each of [`BRANCHES`].
pub const BOX_MAP: &str = "box_map";
/// What is read at 3D boxes.
pub const CORNER_MAP: &str = "corner_map";
/// Of each 2D box: logits of background and classes, then what moves the box.
pub const REZOOM: &str = "rezoom";
/// Of each 2D box: what is added to its cell's depth, metres.
pub const DEPTH_STEP: &str = "depth_step";
/// Of each 2D box: what is added to its cell's place of the 3D centre, cells.
pub const CENTER_STEP: &str = "center_step";
/// Of each 2D box: its corners, before the hyperbolic tangent.
pub const CORNERS: &str = "corners";
/// Of each 3D box: what is added to its corners, before the hyperbolic tangent.
pub const CORNER_STEPS: &str = "corner_steps";

/// What is read at a 2D box, and how many numbers each part gives beside scores.
pub const BRANCHES: [(&str, usize); 4] =
    [(REZOOM, BOX_NUMBERS), (DEPTH_STEP, 1), (CENTER_STEP, 2), (CORNERS, CORNER_NUMBERS)];

/// Rates of the dilated convolutions of the depth encoders on the coarse and the fine map (authors' code).
const COARSE_RATES: [usize; 3] = [2, 4, 8];
const FINE_RATES: [usize; 3] = [6, 12, 18];

impl NetworkConfig for MonoGrNetConfig {
    const METHOD: &'static str = "monogrnet";
    const NAME: &'static str = "a MonoGRNet";
    const OUTPUTS: &'static [&'static str] = &[REZOOM, DEPTH_STEP, CENTER_STEP, CORNERS, CORNER_STEPS];

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
fn network(config: &MonoGrNetConfig) -> Graph {
    let mut b = Builder::new(config.norm);
    let image = b.input(3);
    let levels = config.backbone.levels(&mut b, image, config.dla_channels(), config.stem, config.width);
    let [_, _, _, fine, _, coarse] = levels;
    let layers = Layers { config };

    b.stage(CELLS);
    let x = layers.conv(&mut b, coarse, "cells.0", 512, Window::same(1, 1));
    let cells = output(&mut b, x, "cells.2", config.scores() + BOX_NUMBERS, 0.0);
    b.tap(CELLS, cells);

    b.stage(DEPTH);
    let x = layers.depth_encoder(&mut b, coarse, "depth.coarse", COARSE_RATES);
    let depth = output(&mut b, x, "depth.coarse.out", 1, 0.0);
    b.tap(DEPTH, depth);
    let depth_map = layers.depth_encoder(&mut b, fine, "depth.fine", FINE_RATES);

    b.stage(CENTER);
    let x = layers.conv(&mut b, coarse, "center.coarse.0", 256, Window::same(3, 1));
    let center = output(&mut b, x, "center.coarse.2", 2, 0.0);
    b.tap(CENTER, center);
    let center_map = layers.conv(&mut b, fine, "center.fine", 128, Window::same(3, 1));

    b.stage(CORNERS);
    let corner_map = layers.conv(&mut b, fine, "corners.fine", 128, Window::same(3, 1));
    let rezoom_map = layers.conv(&mut b, fine, "rezoom.fine", 128, Window::same(1, 1));
    let box_map = b.concat(&[rezoom_map, depth_map, center_map, corner_map]);
    b.tap(BOX_MAP, box_map);
    let sum = b.add(depth_map, center_map);
    let sum = b.add(sum, corner_map);
    b.tap(CORNER_MAP, sum);

    let channels = config.head_channels(128);
    b.stage(REZOOM);
    let sampled = b.sampler(&[cells, depth, center, box_map], BRANCHES.len() * channels, [SIDE, SIDE]);
    for (place, (name, numbers)) in BRANCHES.into_iter().enumerate() {
        let numbers = if name == REZOOM { config.scores() + numbers } else { numbers };
        let part = b.narrow(sampled, place * channels, channels);
        let out = layers.look(&mut b, part, &format!("boxes.{name}"), numbers);
        b.tap(name, out);
    }
    b.stage(CORNER_STEPS);
    let sampled = b.sampler(&[sum], channels, [SIDE, SIDE]);
    let steps = layers.look(&mut b, sampled, "refine", CORNER_NUMBERS);
    b.tap(CORNER_STEPS, steps);
    b.finish()
}

struct Layers<'a> {
    config: &'a MonoGrNetConfig,
}

impl Layers<'_> {
    /// A convolution and `ReLU`.
    fn conv(&self, b: &mut Builder, x: NodeId, name: &str, channels: usize, window: Window) -> NodeId {
        let taps = window.kernel * window.kernel;
        // As the backbone's: the variance stays through ReLU.
        let weights = Init::Normal((2.0 / (taps * b.channels(x)) as f32).sqrt());
        let x = b.conv_started(x, name, self.config.head_channels(channels), window, [weights, Init::Constant(0.0)]);
        b.relu(x)
    }

    /// A plain and three dilated convolutions side by side: how an object stands among others says how far it is.
    fn depth_encoder(&self, b: &mut Builder, x: NodeId, name: &str, rates: [usize; 3]) -> NodeId {
        let x = self.conv(b, x, &format!("{name}.neck"), 256, Window::same(3, 1));
        let plain = self.conv(b, x, &format!("{name}.plain"), 128, Window::same(3, 1));
        let dilated = rates.map(|rate| {
            let window = Window { padding: rate, dilation: rate, ..Window::same(3, 1) };
            self.conv(b, x, &format!("{name}.rate{rate}"), 128, window)
        });
        let all = b.concat(&[plain, dilated[0], dilated[1], dilated[2]]);
        self.conv(b, all, &format!("{name}.joined"), 128, Window::same(1, 1))
    }

    /// What is said of what was read at a box: two convolutions with stride 2, all that is left at once, and the
    /// answer.
    fn look(&self, b: &mut Builder, x: NodeId, name: &str, numbers: usize) -> NodeId {
        let x = self.conv(b, x, &format!("{name}.0"), 128, Window::same(3, 2));
        let x = self.conv(b, x, &format!("{name}.2"), 128, Window::same(3, 2));
        let whole = Window { padding: 0, ..Window::same(SIDE / 4, 1) };
        let x = self.conv(b, x, &format!("{name}.4"), 256, whole);
        output(b, x, &format!("{name}.6"), numbers, 0.0)
    }
}

/// A 1x1 convolution whose answers start small.
fn output(b: &mut Builder, x: NodeId, name: &str, channels: usize, bias: f32) -> NodeId {
    b.conv_started(x, name, channels, Window::same(1, 1), [Init::Normal(0.01), Init::Constant(bias)])
}

//! The network: DLA-34 or a narrower one, MSFE where it is asked for, the neck, two heads.

use farsight_graph::graph::Graph;
use farsight_graph::layers::mobilenet_v2::Convention;
use farsight_graph::layers::{Builder, Msfe, NormKind, dla_up, dla34, fpn, mobilenet_v2, msfe};
use serde::{Deserialize, Serialize};

use super::config::SmokeConfig;
use super::heads;

/// Name of the heat map logits among the taps.
pub const LOGITS: &str = "cls_logits";

/// Name of the raw regression channels among the taps.
pub const REGRESSION: &str = "reg_raw";

/// Name of the features that the heads read among the taps.
pub const FEATURES: &str = "neck";

/// Name of the logarithm of the surface's depth among the taps of a network in training.
pub const SURFACE: &str = "surface";

/// What makes the features of strides 4 to 32, and how they come together at stride 4.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Backbone {
    /// DLA-34 with its iterative neck, as SMOKE.
    #[default]
    Dla34,
    /// `MobileNetV2` with a feature pyramid. Weights that have seen photographs can be imported.
    MobilenetV2,
    /// The same with TensorFlow's padding, and its own scale of the image: for weights that learnt there.
    MobilenetV2Tensorflow,
}

impl Backbone {
    /// Its name in configs.
    pub fn name(self) -> &'static str {
        match self {
            Self::Dla34 => "dla34",
            Self::MobilenetV2 => "mobilenet_v2",
            Self::MobilenetV2Tensorflow => "mobilenet_v2_tensorflow",
        }
    }
}

/// The network that `config` describes.
pub(super) fn network(config: &SmokeConfig) -> Graph {
    let mut b = Builder::new(config.norm);
    let channels = config.channels();
    let input = b.input(3);
    let mut levels = match config.backbone {
        Backbone::Dla34 => dla34(&mut b, input, channels, config.stem),
        Backbone::MobilenetV2 => mobilenet_v2(&mut b, input, config.width, Convention::Torchvision),
        Backbone::MobilenetV2Tensorflow => mobilenet_v2(&mut b, input, config.width, Convention::Tensorflow),
    };
    let msfe_width = config.msfe_width();
    let pyramid = [levels[3], levels[4], levels[5]];
    let fused = match config.msfe {
        Msfe::A => Some(msfe::residual_pyramid(&mut b, msfe::PREFIX, pyramid, msfe_width)),
        Msfe::C => Some(msfe::bifpn(&mut b, msfe::PREFIX, pyramid, msfe_width)),
        Msfe::Control => Some(msfe::separate_levels(&mut b, msfe::PREFIX, pyramid, msfe_width)),
        Msfe::None | Msfe::B => None,
    };
    if let Some(fused) = fused {
        levels[3..].copy_from_slice(&fused);
    }
    let mut features = match config.backbone {
        Backbone::Dla34 => dla_up(&mut b, &levels, channels, config.neck),
        Backbone::MobilenetV2 | Backbone::MobilenetV2Tensorflow => {
            fpn(&mut b, &levels, config.neck_width(), config.neck)
        }
    };
    if config.msfe == Msfe::B {
        features = msfe::concat_fusion(&mut b, msfe::PREFIX, pyramid, features, msfe_width);
    }
    b.tap(FEATURES, features);
    let logits = heads::class_head(&mut b, features, config.head_width(), config.classes.len());
    let regression = heads::regression_head(&mut b, features, config.head_width());
    b.tap(LOGITS, logits);
    b.tap(REGRESSION, regression);
    b.finish()
}

/// `graph` with a head that says how far away the surface in each cell is (logarithm, tap [`SURFACE`]): a second lesson for the features, in training only.
/// None when the graph has lost its [`FEATURES`].
pub fn with_surface_head(graph: Graph, norm: NormKind) -> Option<Graph> {
    let features = graph.tap(FEATURES)?;
    let mut b = Builder::from_graph(graph, norm);
    let surface = heads::surface_head(&mut b, features);
    b.tap(SURFACE, surface);
    Some(b.finish())
}

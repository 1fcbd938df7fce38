//! The network: DLA-34 or a narrower one, MSFE where it is asked for, the neck, two heads.

use farsight_graph::graph::Graph;
pub use farsight_graph::layers::Backbone;
use farsight_graph::layers::{Builder, Msfe, NormKind, msfe};
use farsight_graph::model::NetworkConfig;

use super::config::SmokeConfig;
use super::heads;

/// Name of the heatmap logits among the taps.
pub const LOGITS: &str = "cls_logits";

/// Name of the raw regression channels among the taps.
pub const REGRESSION: &str = "reg_raw";

/// Name of the features that the heads read among the taps.
pub const FEATURES: &str = "neck";

/// Name of the logarithm of the surface's depth among the taps of a network in training.
pub const SURFACE: &str = "surface";

impl NetworkConfig for SmokeConfig {
    const METHOD: &'static str = "smoke";
    const NAME: &'static str = "a SMOKE model";
    const OUTPUTS: &'static [&'static str] = &[LOGITS, REGRESSION];
    const LOCAL_HEAD: Option<&'static str> = Some(REGRESSION);

    fn problem(&self) -> Option<String> {
        self.validate().err().map(|error| error.to_string())
    }

    fn graph(&self) -> Graph {
        network(self)
    }

    fn without_fit(mut self) -> Self {
        self.depth.error = None;
        self.classes.iter_mut().for_each(|class| class.score = None);
        self
    }
}

/// The network that `config` describes.
fn network(config: &SmokeConfig) -> Graph {
    let mut b = Builder::new(config.norm);
    let channels = config.channels();
    let input = b.input(3);
    let mut levels = config.backbone.levels(&mut b, input, channels, config.stem, config.width);
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
    let mut features = config.backbone.neck(&mut b, &levels, channels, config.neck_width(), config.neck);
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

/// `graph` with a head that says how far away the surface in each cell is (logarithm, tap [`SURFACE`]): a second lesson
/// for the features, in training only. None when the graph has lost its [`FEATURES`].
pub fn with_surface_head(graph: Graph, norm: NormKind) -> Option<Graph> {
    let features = graph.tap(FEATURES)?;
    let mut b = Builder::from_graph(graph, norm);
    let surface = heads::surface_head(&mut b, features);
    b.tap(SURFACE, surface);
    Some(b.finish())
}

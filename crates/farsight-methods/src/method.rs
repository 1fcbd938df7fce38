//! What every method says of itself, and ways to do something with all of them or with the one that a file is of.

use farsight_graph::model::{Model, NetworkConfig};
use farsight_onnx::LocalHeadFile;
use farsight_runtime::Runner;

use crate::Detector;

/// A method: detector or second stage.
pub trait Method: NetworkConfig {
    /// Width and height, pixels, of the input for which multiply-accumulates are counted.
    fn counted_input(&self) -> [usize; 2];

    /// What there is to tell of it, by name.
    fn facts(&self) -> Vec<(&'static str, String)>;

    /// What its ONNX files say beside config, hash and training, by key.
    fn onnx_facts(&self) -> Vec<(&'static str, String)> {
        Vec::new()
    }
}

/// A method that detects with one network, or with several and a sampler before each but the first.
pub trait DetectorMethod: Method {
    /// Why a model of it cannot be made narrower (`farsight prune`), if it cannot: what is pruned must be trained on.
    const NOT_PRUNED: Option<&'static str> = Some("its training goes on with whole networks only");

    /// The detector of this config.
    ///
    /// `runner` runs its network; what comes after each sampler is run by one of `later`. None where one is missing. A
    /// network that ends before the head of [`NetworkConfig::LOCAL_HEAD`] has left it in `head`.
    fn detector(
        self,
        runner: Box<dyn Runner>,
        later: Vec<Box<dyn Runner>>,
        head: Option<&LocalHeadFile>,
    ) -> Option<Box<dyn Detector>>;
}

/// Does something with every method.
pub trait MethodVisitor {
    /// Does it with this one.
    fn visit<C: Method>(&mut self);
}

/// Does something with every detector.
pub trait DetectorVisitor {
    /// Does it with this one.
    fn visit<C: DetectorMethod>(&mut self);
}

/// Does something with a detector's model, whatever its method.
pub trait ModelTaker {
    /// What comes of it.
    type Answer;

    /// Does it.
    fn take<C: DetectorMethod>(self, model: Model<C>) -> Self::Answer;
}

//! libtorch as an engine. Only this file knows whether it is compiled in (feature `train`).

#[cfg(not(feature = "train"))]
use absent as engine;
#[cfg(feature = "train")]
use present as engine;

use farsight_runtime::EngineError;

pub(crate) use engine::{IS_BUILT_IN, start, start_network, start_on_cpu};

/// Its name as users write it.
const NAME: &str = "libtorch";

/// It runs model files of our own.
pub(crate) fn no_onnx() -> EngineError {
    EngineError::new(NAME, "it runs no ONNX files; expected a model file (.safetensors)")
}

#[cfg(feature = "train")]
mod present {
    use farsight_graph::model::{Model, NetworkConfig};
    use farsight_graph::transform::Network;
    use farsight_runtime::Runner;
    use farsight_train::runner::TorchRunner;

    use crate::{EngineOptions, Error};

    pub(crate) const IS_BUILT_IN: bool = true;

    pub(crate) fn start<C: NetworkConfig>(options: &EngineOptions, model: &Model<C>) -> Result<Box<dyn Runner>, Error> {
        start_network(options, &Network::new(model).with_outputs(C::OUTPUTS))
    }

    pub(crate) fn start_network(options: &EngineOptions, network: &Network) -> Result<Box<dyn Runner>, Error> {
        options.check()?;
        farsight_train::set_threads(options.usable_threads());
        Ok(Box::new(TorchRunner::on_any_device(network)?))
    }

    pub(crate) fn start_on_cpu<C: NetworkConfig>(model: &Model<C>) -> Result<Box<dyn Runner>, Error> {
        Ok(Box::new(TorchRunner::on_cpu(model)?))
    }
}

#[cfg(not(feature = "train"))]
mod absent {
    use farsight_graph::model::{Model, NetworkConfig};
    use farsight_graph::transform::Network;
    use farsight_runtime::Runner;

    use crate::{EngineOptions, Error};

    pub(crate) const IS_BUILT_IN: bool = false;

    pub(crate) fn start<C: NetworkConfig>(options: &EngineOptions, _: &Model<C>) -> Result<Box<dyn Runner>, Error> {
        options.check()?;
        Err(Error::NoLibtorch)
    }

    pub(crate) fn start_network(options: &EngineOptions, _: &Network) -> Result<Box<dyn Runner>, Error> {
        options.check()?;
        Err(Error::NoLibtorch)
    }

    pub(crate) fn start_on_cpu<C: NetworkConfig>(_: &Model<C>) -> Result<Box<dyn Runner>, Error> {
        Err(Error::NoLibtorch)
    }
}

//! libtorch as an engine of `farsight-infer`.

use farsight_core::HeadMaps;
use farsight_infer::engine::{apart, batch_size};
use farsight_infer::{Engine, EngineError};
use farsight_graph::graph::{LOGITS, REGRESSION};
use farsight_graph::model::{Model, ModelError};
use tch::{Device, Tensor, no_grad};

use crate::executor::{Mode, Network, Precision, values_from_tensor};

/// Runs a model on libtorch, on the GPU when there is one.
#[derive(Debug)]
pub struct TorchEngine {
    network: Network,
    outputs: [usize; 2],
    device: Device,
}

impl TorchEngine {
    /// The engine for a model that is in memory, on the GPU when there is one.
    ///
    /// # Errors
    /// When the weights do not fit the network.
    pub fn on_any_device(model: Model) -> Result<Self, ModelError> {
        Self::new(model, Device::cuda_if_available())
    }

    /// The engine for a model that is in memory, on the CPU.
    ///
    /// # Errors
    /// When the weights do not fit the network.
    pub fn on_cpu(model: Model) -> Result<Self, ModelError> {
        Self::new(model, Device::Cpu)
    }

    /// The engine for a model that is in memory.
    ///
    /// # Errors
    /// When the weights do not fit the network.
    pub fn new(model: Model, device: Device) -> Result<Self, ModelError> {
        let missing = |name: &str| ModelError::Tensor {
            name: name.to_owned(),
            found: "is not an output of the network".to_owned(),
            expected: Vec::new(),
        };
        let output = |name: &str| model.graph.tap(name).ok_or_else(|| missing(name));
        let outputs = [output(LOGITS)?, output(REGRESSION)?];
        let network =
            Network::new(model.graph, &model.weights, device, Precision::F32).map_err(|e| missing(&e.to_string()))?;
        Ok(Self { network, outputs, device })
    }
}

impl Engine for TorchEngine {
    fn name(&self) -> &'static str {
        "libtorch"
    }

    fn batch_head_maps(&mut self, inputs: &[f32], size: [usize; 2]) -> Result<Vec<HeadMaps>, EngineError> {
        let batch = batch_size(inputs, size);
        let shape = [batch, 3, size[1], size[0]].map(|side| side as i64);
        let inputs = Tensor::from_slice(inputs).view(shape).to_device(self.device);
        let maps = no_grad(|| self.network.forward(&inputs, Mode::Evaluate, &self.outputs));
        let map_size = maps[0].size();
        let [logits, regression] = [0, 1].map(|output| values_from_tensor(&maps[output]));
        Ok(apart(batch, [map_size[3] as usize, map_size[2] as usize], logits, regression))
    }
}

//! libtorch as an engine of `farsight-runtime`.

use farsight_graph::model::{Model, ModelError, NetworkConfig};
use farsight_graph::transform;
use farsight_onnx::{INPUT, TensorInfo};
use farsight_runtime::{EngineError, Runner, Tensor, TensorView};
use tch::{Device, no_grad};

use crate::executor::{Mode, Network, Precision, values_from_tensor};

/// Its name as users write it.
const NAME: &str = "libtorch";

/// Runs a model on libtorch.
#[derive(Debug)]
pub struct TorchRunner {
    network: Network,
    input: [TensorInfo; 1],
    outputs: Vec<TensorInfo>,
    nodes: Vec<usize>,
}

impl TorchRunner {
    /// Runs `network`, whose taps are its outputs, on the GPU when there is one.
    ///
    /// # Errors
    /// When the weights do not fit the network.
    pub fn on_any_device(network: &transform::Network) -> Result<Self, ModelError> {
        Self::new(network, Device::cuda_if_available())
    }

    /// Runs `model` on the CPU.
    ///
    /// # Errors
    /// When the weights do not fit the network.
    pub fn on_cpu<C: NetworkConfig>(model: &Model<C>) -> Result<Self, ModelError> {
        Self::new(&transform::Network::new(model).with_outputs(C::OUTPUTS), Device::Cpu)
    }

    /// Runs `network`, whose taps are its outputs, on this device.
    ///
    /// # Errors
    /// When the weights do not fit the network.
    pub fn new(network: &transform::Network, device: Device) -> Result<Self, ModelError> {
        let graph = &network.graph;
        let info = |name: &str, node: usize| TensorInfo {
            name: name.to_owned(),
            channels: graph.nodes.get(node).map(|node| node.channels),
        };
        let input = [info(INPUT, 0)];
        let outputs = graph.taps.iter().map(|(name, node)| info(name, *node)).collect();
        let nodes = graph.taps.iter().map(|(_, node)| *node).collect();
        let network = Network::new(graph.clone(), &network.weights, device, Precision::F32).map_err(|error| {
            ModelError::Tensor { name: error.to_string(), found: "does not fit".to_owned(), expected: Vec::new() }
        })?;
        Ok(Self { network, input, outputs, nodes })
    }
}

impl Runner for TorchRunner {
    fn engine(&self) -> &str {
        NAME
    }

    fn inputs(&self) -> &[TensorInfo] {
        &self.input
    }

    fn outputs(&self) -> &[TensorInfo] {
        &self.outputs
    }

    fn run(&mut self, inputs: &[(&str, TensorView<'_>)]) -> Result<Vec<Tensor>, EngineError> {
        let view = inputs.iter().find(|(name, _)| *name == INPUT).map(|(_, view)| view);
        let view = view.ok_or_else(|| EngineError::new(NAME, format!("no input \"{INPUT}\"")))?;
        let shape: Vec<i64> = view.shape.iter().map(|&side| side as i64).collect();
        if shape.iter().product::<i64>() != view.values.len() as i64 {
            return Err(EngineError::new(NAME, format!("{} values of the shape {shape:?}", view.values.len())));
        }
        let input = tch::Tensor::from_slice(view.values).view(shape.as_slice()).to_device(self.network.device());
        let maps = no_grad(|| self.network.forward(&input, Mode::Evaluate, &self.nodes));
        let tensor = |map: &tch::Tensor| Tensor {
            shape: map.size().iter().map(|&side| side as usize).collect(),
            values: values_from_tensor(map),
        };
        Ok(maps.iter().map(tensor).collect())
    }

    fn share(&self) -> Result<Box<dyn Runner>, EngineError> {
        let (input, outputs) = (self.input.clone(), self.outputs.clone());
        Ok(Box::new(Self { network: self.network.share(), input, outputs, nodes: self.nodes.clone() }))
    }
}

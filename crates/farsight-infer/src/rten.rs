//! The engine that is always there: `rten`, in pure Rust.

use std::sync::Arc;

use farsight_core::HeadMaps;
use farsight_net::onnx::{INPUT, OnnxModel};
use rten::{Model, ModelOptions, NodeId, RunOptions, ThreadPool, Value, ValueView, op_registry};

use crate::engine::{apart, batch_size};
use crate::library::{Failure, unpanicked};
use crate::{Engine, EngineError};

/// Its name as users write it.
pub(crate) const NAME: &str = "rten";

/// A network on `rten`: some of its values for an image.
pub(crate) struct Network {
    model: Model,
    input: NodeId,
    outputs: Vec<NodeId>,
    options: RunOptions,
}

impl Network {
    /// Loads an ONNX file that has these values, to be run by so many threads; `None` takes one for each core.
    pub(crate) fn new(
        bytes: Vec<u8>,
        input: &str,
        outputs: &[String],
        threads: Option<usize>,
    ) -> Result<Self, Failure> {
        // Operators that are not listed here are not compiled in.
        let operators = op_registry!(
            Add,
            BatchNormalization,
            Cast,
            Clip,
            Concat,
            Conv,
            ConvTranspose,
            DepthToSpace,
            DequantizeLinear,
            Div,
            Gather,
            GlobalAveragePool,
            GridSample,
            InstanceNormalization,
            MaxPool,
            Mul,
            QuantizeLinear,
            Range,
            Relu,
            Reshape,
            Resize,
            Shape,
            Sigmoid,
            Slice,
            Split,
            Sub,
            Transpose
        );
        let model = ModelOptions::with_ops(operators).prepack_weights(true).load(bytes)?;
        let outputs = outputs.iter().map(|name| model.node_id(name)).collect::<Result<_, _>>()?;
        let pool = threads.map(|threads| Arc::new(ThreadPool::with_num_threads(threads)));
        let options = RunOptions::default().with_thread_pool(pool);
        Ok(Self { input: model.node_id(input)?, outputs, options, model })
    }

    /// The values for an input of this shape, `[batch, channels, height, width]`.
    pub(crate) fn run(&self, input: &[f32], shape: [usize; 4]) -> Result<Vec<Value>, Failure> {
        let view = ValueView::from_shape(shape, input)?;
        Ok(self.model.run(vec![(self.input, view.into())], &self.outputs, Some(self.options.clone()))?)
    }
}

/// Runs an ONNX model with `rten`.
pub struct RtenEngine {
    network: Network,
}

impl RtenEngine {
    /// Loads `model`, to be run by so many threads; `None` takes one for each core.
    ///
    /// # Errors
    /// When rten cannot load the model; it has no `DeformConv`, for instance.
    pub fn new(model: OnnxModel, threads: Option<usize>) -> Result<Self, EngineError> {
        let outputs = model.outputs().map(str::to_owned);
        unpanicked(NAME, || Ok(Self { network: Network::new(model.into_bytes(), INPUT, &outputs, threads)? }))
    }

    fn run(&self, inputs: &[f32], size: [usize; 2]) -> Result<Vec<HeadMaps>, Failure> {
        let [width, height] = size;
        let values = self.network.run(inputs, [batch_size(inputs, size), 3, height, width])?;
        let [logits, regression]: [Value; 2] = values.try_into().map_err(|_| "not two outputs")?;
        let (map_size, logits) = map(logits)?;
        let (_, regression) = map(regression)?;
        Ok(apart(batch_size(inputs, size), map_size, logits, regression))
    }
}

/// Width, height and values of an output.
fn map(value: Value) -> Result<([usize; 2], Vec<f32>), Failure> {
    let ([_, _, height, width], values) = value.into_shape_vec::<f32, 4>()?;
    Ok(([width, height], values))
}

impl Engine for RtenEngine {
    fn name(&self) -> &'static str {
        NAME
    }

    fn batch_head_maps(&mut self, inputs: &[f32], input_size: [usize; 2]) -> Result<Vec<HeadMaps>, EngineError> {
        unpanicked(NAME, || self.run(inputs, input_size))
    }
}

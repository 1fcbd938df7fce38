//! The engine that is always there: `rten`, in pure Rust.

use std::sync::Arc;

use farsight_core::HeadMaps;
use farsight_net::onnx::{INPUT, OnnxModel};
use rten::{Model, ModelOptions, NodeId, RunOptions, ThreadPool, Value, ValueView, op_registry};

use crate::engine::{Failure, apart, batch_size, unpanicked};
use crate::{Engine, EngineError};

/// Its name as users write it.
const NAME: &str = "rten";

/// Runs an ONNX model with `rten`.
pub struct RtenEngine {
    model: Model,
    input: NodeId,
    outputs: [NodeId; 2],
    options: RunOptions,
}

impl RtenEngine {
    /// Loads `model`, to be run by so many threads; `None` takes one for each core.
    ///
    /// # Errors
    /// When rten cannot load the model; it has no `DeformConv`, for instance.
    pub fn new(model: OnnxModel, threads: Option<usize>) -> Result<Self, EngineError> {
        let outputs = model.outputs().map(str::to_owned);
        let bytes = model.into_bytes();
        unpanicked(NAME, || {
            // Operators that are not listed here are not compiled in.
            let operators = op_registry!(
                Add,
                BatchNormalization,
                Cast,
                Concat,
                Conv,
                ConvTranspose,
                Div,
                Gather,
                GlobalAveragePool,
                GridSample,
                InstanceNormalization,
                MaxPool,
                Mul,
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
            let [logits, regression] = outputs.map(|name| model.node_id(&name));
            let (input, outputs) = (model.node_id(INPUT)?, [logits?, regression?]);
            let pool = threads.map(|threads| Arc::new(ThreadPool::with_num_threads(threads)));
            let options = RunOptions::default().with_thread_pool(pool);
            Ok(Self { model, input, outputs, options })
        })
    }

    fn run(&self, inputs: &[f32], size @ [width, height]: [usize; 2]) -> Result<Vec<HeadMaps>, Failure> {
        let batch = batch_size(inputs, size);
        let view = ValueView::from_shape([batch, 3, height, width], inputs)?;
        let inputs = vec![(self.input, view.into())];
        let [logits, regression] = self.model.run_n(inputs, self.outputs, Some(self.options.clone()))?;
        let (map_size, logits) = map(logits)?;
        let (_, regression) = map(regression)?;
        Ok(apart(batch, map_size, logits, regression))
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

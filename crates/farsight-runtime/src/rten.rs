//! The engine that is always there: `rten`, in pure Rust.

use std::sync::Arc;

use farsight_onnx::{OnnxModel, TensorInfo};
use rten::{Model, ModelOptions, NodeId, RunOptions, ThreadPool, Value, ValueView, op_registry};
use rten_tensor::Layout;

use crate::EngineError;
use crate::library::{Failure, unpanicked};
use crate::runner::{Runner, Tensor, TensorView, input};

/// Its name as users write it.
const NAME: &str = "rten";

/// Runs an ONNX model with `rten`.
pub struct RtenRunner {
    model: Arc<Model>,
    nodes: Vec<NodeId>,
    inputs: Vec<TensorInfo>,
    outputs: Vec<TensorInfo>,
    threads: Option<usize>,
    /// Threads of its own, started when it first runs; sharers must not wait for each other.
    pool: Option<Arc<ThreadPool>>,
}

impl RtenRunner {
    /// Loads `model`, to be run by so many threads; `None` takes one for each core.
    ///
    /// # Errors
    /// When rten cannot load the model; it has no `DeformConv`, for instance.
    pub fn new(model: OnnxModel, threads: Option<usize>) -> Result<Self, EngineError> {
        let (inputs, outputs) = (vec![model.input().clone()], model.outputs().to_vec());
        unpanicked(NAME, || {
            let model = load(model.into_bytes())?;
            let nodes = outputs.iter().map(|output| model.node_id(&output.name)).collect::<Result<_, _>>()?;
            Ok(Self { model: Arc::new(model), nodes, inputs, outputs, threads, pool: None })
        })
    }

    fn values(&mut self, given: &[(&str, TensorView<'_>)]) -> Result<Vec<Tensor>, Failure> {
        let mut views = Vec::with_capacity(self.inputs.len());
        for TensorInfo { name, .. } in &self.inputs {
            let view = input(given, name)?;
            views.push((self.model.node_id(name)?, ValueView::from_shape(view.shape, view.values)?.into()));
        }
        if self.pool.is_none() {
            self.pool = self.threads.map(|threads| Arc::new(ThreadPool::with_num_threads(threads)));
        }
        let options = RunOptions::default().with_thread_pool(self.pool.clone());
        let values = self.model.run(views, &self.nodes, Some(options))?;
        values.into_iter().map(tensor).collect()
    }
}

fn load(bytes: Vec<u8>) -> Result<Model, Failure> {
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
    Ok(ModelOptions::with_ops(operators).prepack_weights(true).load(bytes)?)
}

fn tensor(value: Value) -> Result<Tensor, Failure> {
    let tensor = value.into_tensor::<f32>().ok_or("an output is not of floats")?;
    Ok(Tensor { shape: tensor.shape().to_vec(), values: tensor.into_data() })
}

impl Runner for RtenRunner {
    fn engine(&self) -> &str {
        NAME
    }

    fn inputs(&self) -> &[TensorInfo] {
        &self.inputs
    }

    fn outputs(&self) -> &[TensorInfo] {
        &self.outputs
    }

    fn run(&mut self, inputs: &[(&str, TensorView<'_>)]) -> Result<Vec<Tensor>, EngineError> {
        unpanicked(NAME, || self.values(inputs))
    }

    fn share(&self) -> Result<Box<dyn Runner>, EngineError> {
        let Self { model, nodes, inputs, outputs, threads, pool: _ } = self;
        let (inputs, outputs) = (inputs.clone(), outputs.clone());
        let shared =
            Self { model: model.clone(), nodes: nodes.clone(), inputs, outputs, threads: *threads, pool: None };
        Ok(Box::new(shared))
    }
}

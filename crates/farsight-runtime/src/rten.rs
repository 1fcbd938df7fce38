//! The engine that is always there: `rten`, in pure Rust, with convolutions of our own ([`crate::convolution`]).

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use farsight_onnx::{OnnxModel, Step, Subgraph, TensorInfo};
use rten::{
    Model, ModelOptions, NodeId, RunOptions, ThreadPool, Value, ValueOrView, ValueView, op_registry, thread_pool,
};
use rten_tensor::prelude::*;
use rten_tensor::{Tensor as RtenTensor, TensorView as RtenTensorView};

use crate::EngineError;
use crate::convolution::{ConvolutionLayer, MapView};
use crate::library::{Failure, unpanicked};
use crate::runner::{Runner, Tensor, TensorView, input};

/// Its name as users write it.
const NAME: &str = "rten";

/// Runs an ONNX model with `rten`.
pub struct RtenRunner {
    plan: Arc<Plan>,
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
            let plan = Plan::new(model, &inputs, &outputs)?;
            Ok(Self { plan: Arc::new(plan), inputs, outputs, threads, pool: None })
        })
    }

    fn values(&mut self, given: &[(&str, TensorView<'_>)]) -> Result<Vec<Tensor>, Failure> {
        let mut views = Vec::with_capacity(self.inputs.len());
        for TensorInfo { name, .. } in &self.inputs {
            let view = input(given, name)?;
            views.push(ValueView::from_shape(view.shape, view.values)?);
        }
        if self.pool.is_none() {
            self.pool = self.threads.map(|threads| Arc::new(ThreadPool::with_num_threads(threads)));
        }
        let (plan, pool) = (&self.plan, &self.pool);
        pool.as_deref().unwrap_or(thread_pool()).run(|| plan.run(views, pool.as_ref()))
    }
}

/// Where a value is kept while a network runs.
type Slot = usize;

/// A network in the order in which it is computed.
struct Plan {
    steps: Vec<PlannedStep>,
    slots: usize,
    outputs: Vec<Slot>,
}

struct PlannedStep {
    operation: Operation,
    /// What no later step reads.
    last_reads: Vec<Slot>,
}

enum Operation {
    Convolution { layer: ConvolutionLayer, input: Slot, output: Slot },
    Graph { model: Model, inputs: Vec<(NodeId, Slot)>, outputs: Vec<(NodeId, Slot)> },
}

impl Operation {
    fn reads(&self) -> Vec<Slot> {
        match self {
            Self::Convolution { input, .. } => vec![*input],
            Self::Graph { inputs, .. } => inputs.iter().map(|(_, slot)| *slot).collect(),
        }
    }
}

impl Plan {
    fn new(model: OnnxModel, inputs: &[TensorInfo], outputs: &[TensorInfo]) -> Result<Self, Failure> {
        let steps = model.steps(Path::new("the network"))?;
        drop(model);
        let mut slots = HashMap::new();
        for TensorInfo { name, .. } in inputs {
            let slot = slots.len();
            slots.insert(name.clone(), slot);
        }
        let known = |slots: &HashMap<String, Slot>, name: &str| {
            slots.get(name).copied().ok_or_else(|| format!("nothing makes the value \"{name}\""))
        };
        let mut planned = Vec::with_capacity(steps.len());
        for step in steps {
            let made = |slots: &mut HashMap<String, Slot>, name: String| {
                let slot = slots.len();
                *slots.entry(name).insert_entry(slot).get()
            };
            planned.push(match step {
                Step::Convolution(convolution) => {
                    let input = known(&slots, &convolution.input)?;
                    let layer = ConvolutionLayer::new(&convolution);
                    Operation::Convolution { layer, input, output: made(&mut slots, convolution.output) }
                }
                Step::Graph(Subgraph { bytes, inputs, outputs }) => {
                    let model = load(bytes)?;
                    let node = |name: &str| model.node_id(name);
                    let inputs = inputs.iter().map(|name| Ok((node(name)?, known(&slots, name)?)));
                    let inputs = inputs.collect::<Result<_, Failure>>()?;
                    let outputs = outputs.into_iter().map(|name| Ok((node(&name)?, made(&mut slots, name))));
                    let outputs = outputs.collect::<Result<_, Failure>>()?;
                    Operation::Graph { model, inputs, outputs }
                }
            });
        }
        let outputs = outputs.iter().map(|output| known(&slots, &output.name)).collect::<Result<Vec<_>, _>>()?;
        let mut read_later = outputs.clone();
        let mut steps = Vec::with_capacity(planned.len());
        for operation in planned.into_iter().rev() {
            let mut last_reads = operation.reads();
            last_reads.retain(|slot| !read_later.contains(slot));
            read_later.extend(&last_reads);
            steps.push(PlannedStep { operation, last_reads });
        }
        steps.reverse();
        Ok(Self { steps, slots: slots.len(), outputs })
    }

    fn run(&self, inputs: Vec<ValueView<'_>>, pool: Option<&Arc<ThreadPool>>) -> Result<Vec<Tensor>, Failure> {
        let mut values: Vec<Option<ValueOrView<'_>>> = inputs.into_iter().map(|view| Some(view.into())).collect();
        values.resize_with(self.slots, || None);
        for PlannedStep { operation, last_reads } in &self.steps {
            match operation {
                Operation::Convolution { layer, input, output } => {
                    let read = values[*input].as_ref().ok_or("a value is not there")?;
                    let map: RtenTensorView<'_, f32> = read.as_view().try_into()?;
                    let shape = map.shape().try_into().map_err(|_| format!("a map of shape {:?}", map.shape()))?;
                    let (made, shape) = layer.run(MapView { shape, values: &map.to_contiguous().data() })?;
                    values[*output] = Some(Value::from(RtenTensor::from_data(&shape[..], made)).into());
                }
                Operation::Graph { model, inputs, outputs } => {
                    let mut taken = Vec::new();
                    for &(_, slot) in inputs {
                        taken.push(if last_reads.contains(&slot) { values[slot].take() } else { None });
                    }
                    let mut given = Vec::with_capacity(inputs.len());
                    for (&(node, slot), taken) in inputs.iter().zip(taken) {
                        let kept = || values[slot].as_ref().map(|value| value.as_view().into());
                        given.push((node, taken.or_else(kept).ok_or("a value is not there")?));
                    }
                    let nodes: Vec<NodeId> = outputs.iter().map(|(node, _)| *node).collect();
                    let options = RunOptions::default().with_thread_pool(pool.cloned());
                    let made = model.run(given, &nodes, Some(options))?;
                    for (&(_, slot), made) in outputs.iter().zip(made) {
                        values[slot] = Some(made.into());
                    }
                }
            }
            for &slot in last_reads {
                values[slot] = None;
            }
        }
        let mut outputs = Vec::with_capacity(self.outputs.len());
        for &slot in &self.outputs {
            // A value may be two outputs.
            outputs.push(tensor(values[slot].as_ref().ok_or("a value is not there")?.to_owned())?);
        }
        Ok(outputs)
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
        let Self { plan, inputs, outputs, threads, pool: _ } = self;
        let (inputs, outputs) = (inputs.clone(), outputs.clone());
        Ok(Box::new(Self { plan: plan.clone(), inputs, outputs, threads: *threads, pool: None }))
    }
}

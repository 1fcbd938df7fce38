//! A network in the order in which it is computed: convolutions here, what lies between them by rten.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use farsight_onnx::{Convolution, ConvolutionKind, OnnxModel, Step, Subgraph, TensorInfo};
use rten::{Model, ModelOptions, NodeId, RunOptions, ThreadPool, Value, ValueOrView, ValueView, op_registry};
use rten_tensor::prelude::*;
use rten_tensor::{Tensor as RtenTensor, TensorView as RtenTensorView};

use crate::convolution::{ConvolutionLayer, InvertedResidual, MapView};
use crate::library::Failure;
use crate::runner::Tensor;

/// Where a value is kept while a network runs.
type Slot = usize;

/// A network in the order in which it is computed.
pub(crate) struct Plan {
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
    InvertedResidual { block: Box<InvertedResidual>, input: Slot, output: Slot },
    Graph { model: Box<Model>, inputs: Vec<(NodeId, Slot)>, outputs: Vec<(NodeId, Slot)> },
}

impl Operation {
    fn reads(&self) -> Vec<Slot> {
        match self {
            Self::Convolution { input, .. } | Self::InvertedResidual { input, .. } => vec![*input],
            Self::Graph { inputs, .. } => inputs.iter().map(|(_, slot)| *slot).collect(),
        }
    }
}

impl Plan {
    /// # Errors
    /// When rten cannot load what lies between the convolutions.
    pub(crate) fn new(model: OnnxModel) -> Result<Self, Failure> {
        let steps = model.steps(Path::new("the network"))?;
        let outputs = model.outputs().to_vec();
        let mut slots = Slots::default();
        slots.add(&model.input().name);
        // The steps have what they need of the file.
        drop(model);
        let mut operations = Vec::with_capacity(steps.len());
        for group in joined(steps, &outputs) {
            let mut convolutions = Vec::new();
            for step in group {
                match step {
                    Step::Convolution(convolution) => convolutions.push(convolution),
                    Step::Graph(Subgraph { bytes, inputs, outputs }) => {
                        let model = Box::new(load(bytes)?);
                        let inputs = inputs.iter().map(|name| Ok((model.node_id(name)?, slots.of(name)?)));
                        let inputs = inputs.collect::<Result<_, Failure>>()?;
                        let outputs = outputs.iter().map(|name| Ok((model.node_id(name)?, slots.add(name))));
                        let outputs = outputs.collect::<Result<_, Failure>>()?;
                        operations.push(Operation::Graph { model, inputs, outputs });
                    }
                }
            }
            if let [first, .., last] = &convolutions[..]
                && last.is_pointwise()
            {
                let (input, output) = (slots.of(&first.input)?, slots.add(&last.output));
                let mut layers = convolutions.iter().map(ConvolutionLayer::new).rev();
                if let (Some(projection), Some(depthwise)) = (layers.next(), layers.next()) {
                    let block = Box::new(InvertedResidual::new(layers.next(), depthwise, projection));
                    operations.push(Operation::InvertedResidual { block, input, output });
                }
                continue;
            }
            for convolution in convolutions {
                let input = slots.of(&convolution.input)?;
                let layer = ConvolutionLayer::new(&convolution);
                operations.push(Operation::Convolution { layer, input, output: slots.add(&convolution.output) });
            }
        }
        let outputs = outputs.iter().map(|output| slots.of(&output.name)).collect::<Result<Vec<_>, _>>()?;
        let mut read_later = outputs.clone();
        let mut steps = Vec::with_capacity(operations.len());
        for operation in operations.into_iter().rev() {
            let mut last_reads = operation.reads();
            last_reads.retain(|slot| !read_later.contains(slot));
            read_later.extend(&last_reads);
            steps.push(PlannedStep { operation, last_reads });
        }
        steps.reverse();
        Ok(Self { steps, slots: slots.count, outputs })
    }

    /// All outputs, in the order of the file, for one value an input. Runs in the thread pool of the caller, which is
    /// `pool` where that is given.
    pub(crate) fn run(
        &self,
        inputs: Vec<ValueView<'_>>,
        pool: Option<&Arc<ThreadPool>>,
    ) -> Result<Vec<Tensor>, Failure> {
        let mut values: Vec<Option<ValueOrView<'_>>> = inputs.into_iter().map(|view| Some(view.into())).collect();
        values.resize_with(self.slots, || None);
        for PlannedStep { operation, last_reads } in &self.steps {
            match operation {
                Operation::Convolution { layer, input, output } => {
                    values[*output] = Some(mapped(values[*input].as_ref(), |map| layer.run(map))?.into());
                }
                Operation::InvertedResidual { block, input, output } => {
                    values[*output] = Some(mapped(values[*input].as_ref(), |map| block.run(map))?.into());
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
        // A value may be two outputs.
        let is_last = |place: usize| !self.outputs[place + 1..].contains(&self.outputs[place]);
        let outputs = self.outputs.iter().enumerate().map(|(place, &slot)| {
            let value =
                if is_last(place) { values[slot].take() } else { values[slot].as_ref().map(|v| v.to_owned().into()) };
            tensor(value.ok_or("a value is not there")?.into_owned())
        });
        outputs.collect()
    }
}

/// What `make` makes of a map.
fn mapped(
    read: Option<&ValueOrView<'_>>,
    make: impl FnOnce(MapView<'_>) -> Result<(Vec<f32>, [usize; 4]), Failure>,
) -> Result<Value, Failure> {
    let read = read.ok_or("a value is not there")?;
    let map: RtenTensorView<'_, f32> = read.as_view().try_into()?;
    let shape = map.shape().try_into().map_err(|_| format!("a map of shape {:?}", map.shape()))?;
    let (made, shape) = make(MapView { shape, values: map.to_contiguous().data() })?;
    Ok(Value::from(RtenTensor::from_data(&shape[..], made)))
}

/// The steps in an order in which they can be computed, with those together that are an inverted residual: a depthwise
/// convolution, the one before it and the one after it if their windows are one cell and nothing else reads what is
/// between them.
fn joined(steps: Vec<Step>, outputs: &[TensorInfo]) -> Vec<Vec<Step>> {
    let mut readers: HashMap<String, usize> = HashMap::new();
    let reads = steps.iter().flat_map(|step| match step {
        Step::Convolution(convolution) => std::slice::from_ref(&convolution.input),
        Step::Graph(graph) => &graph.inputs[..],
    });
    for name in reads.chain(outputs.iter().map(|output| &output.name)) {
        *readers.entry(name.clone()).or_default() += 1;
    }
    let continues = |group: &[Step], next: &Convolution| {
        let Some(Step::Convolution(last)) = group.last() else { return false };
        let is_depthwise = |one: &Convolution| one.kind == ConvolutionKind::Depthwise;
        let (are_joined, channels) = if is_depthwise(next) {
            (group.len() == 1 && last.is_pointwise(), next.weight.shape[0])
        } else {
            (is_depthwise(last) && next.is_pointwise(), next.weight.shape[1])
        };
        // A file may say that they follow each other although they cannot.
        let do_fit = last.weight.shape[0] == channels;
        are_joined && do_fit && last.output == next.input && readers.get(&last.output) == Some(&1)
    };
    let mut groups: Vec<Vec<Step>> = Vec::new();
    for step in steps {
        let before = match &step {
            Step::Convolution(next) => groups.iter().rposition(|group| continues(group, next)),
            Step::Graph(_) => None,
        };
        let mut group = before.map(|place| groups.remove(place)).unwrap_or_default();
        group.push(step);
        groups.push(group);
    }
    groups
}

/// Where values are kept, by their names.
#[derive(Default)]
struct Slots {
    names: HashMap<String, Slot>,
    count: usize,
}

impl Slots {
    fn add(&mut self, name: &str) -> Slot {
        let slot = self.count;
        self.count += 1;
        self.names.insert(name.to_owned(), slot);
        slot
    }

    fn of(&self, name: &str) -> Result<Slot, String> {
        self.names.get(name).copied().ok_or_else(|| format!("nothing makes the value \"{name}\""))
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

#[cfg(test)]
mod tests {
    use farsight_graph::graph::Window;
    use farsight_graph::weights::WeightTensor;

    use super::*;

    /// A convolution from the value `input` to `output`; `weight` are its sides: out, in of a group, kernel.
    fn convolution(kind: ConvolutionKind, [input, output]: [&str; 2], [out, of_group, kernel]: [usize; 3]) -> Step {
        let shape = vec![out, of_group, kernel, kernel];
        let weight = WeightTensor::new(shape.clone(), vec![0.0; shape.iter().product()]).unwrap();
        let limits = [f32::NEG_INFINITY, f32::INFINITY];
        let [input, output] = [input, output].map(str::to_owned);
        let window = Window::same(kernel, 1);
        Step::Convolution(Convolution { input, output, kind, window, weight, bias: vec![0.0; out], limits })
    }

    fn groups(steps: Vec<Step>, output: &str) -> Vec<usize> {
        let output = TensorInfo { name: output.to_owned(), channels: None };
        joined(steps, &[output]).iter().map(Vec::len).collect()
    }

    #[test]
    fn inverted_residuals_are_joined_where_nothing_else_reads_what_is_between() {
        let [dense, depthwise] = [ConvolutionKind::Dense, ConvolutionKind::Depthwise];
        let block = |channels: usize| {
            vec![
                convolution(dense, ["x", "wide"], [24, 4, 1]),
                convolution(depthwise, ["wide", "seen"], [channels, 1, 3]),
                convolution(dense, ["seen", "y"], [6, 24, 1]),
            ]
        };
        assert_eq!(groups(block(24), "y"), [3]);
        assert_eq!(groups(block(24).split_off(1), "y"), [2]);
        // What is read, or asked for, besides; windows of more than one cell; channels that do not fit.
        let with_reader = [block(24), vec![convolution(dense, ["wide", "z"], [5, 24, 1])]].concat();
        assert_eq!(groups(with_reader, "y"), [1, 2, 1]);
        assert_eq!(groups(block(24), "seen"), [2, 1]);
        let mut with_large_windows = block(24);
        with_large_windows[0] = convolution(dense, ["x", "wide"], [24, 4, 3]);
        assert_eq!(groups(with_large_windows, "y"), [1, 2]);
        assert_eq!(groups(block(23), "y"), [1, 1, 1]);
    }
}

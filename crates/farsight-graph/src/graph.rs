//! A network: a list of typed nodes and the parameters they name.

/// Index of a node in [`Graph::nodes`].
pub type NodeId = usize;

/// Index of a parameter in [`Graph::parameters`].
pub type ParameterId = usize;

/// Added to the variance in every norm (spec section 1).
pub const NORM_EPSILON: f64 = 1e-5;

/// Added to the sum of fusion weights (`EfficientDet`).
pub const FUSION_EPSILON: f64 = 1e-4;

/// What a node computes. Tensors are `[batch, channel, height, width]`.
#[derive(Debug, Clone, PartialEq)]
pub enum Op {
    /// The network's input.
    Input,
    /// Convolution with a square kernel and padding on all sides.
    Conv {
        /// Weight, `[out, in / groups, kernel, kernel]`.
        weight: ParameterId,
        /// Bias, `[out]`.
        bias: Option<ParameterId>,
        /// Shape of the window.
        window: Window,
        /// Channel groups.
        groups: usize,
    },
    /// Modulated deformable convolution (`DCNv2`). Inputs: the map, and `3 k k` channels of offsets and mask logits per
    /// offset group: first the offsets, `(dy, dx)` for each tap in row order, then the mask.
    DeformConv {
        /// Weight, `[out, in, kernel, kernel]`.
        weight: ParameterId,
        /// Bias, `[out]`.
        bias: ParameterId,
        /// Shape of the window.
        window: Window,
    },
    /// Depthwise transposed convolution, kernel `2 factor`, stride `factor`, padding `factor / 2`: a learnt upsampling.
    UpConv {
        /// Weight, `[channels, 1, 2 factor, 2 factor]`.
        weight: ParameterId,
        /// Enlargement.
        factor: usize,
    },
    /// Group normalisation with affine terms.
    GroupNorm {
        /// Number of groups.
        groups: usize,
        /// Scale.
        weight: ParameterId,
        /// Shift.
        bias: ParameterId,
    },
    /// Batch normalisation with affine terms and running statistics.
    BatchNorm {
        /// Scale.
        weight: ParameterId,
        /// Shift.
        bias: ParameterId,
        /// Running mean.
        mean: ParameterId,
        /// Running variance.
        variance: ParameterId,
    },
    /// `max(x, 0)`.
    Relu,
    /// `min(max(x, 0), 6)`.
    Relu6,
    /// Logistic function.
    Sigmoid,
    /// Maximum over `kernel` x `kernel` cells; what lies outside the map never counts.
    MaxPool {
        /// Cells a side.
        kernel: usize,
        /// Step.
        stride: usize,
        /// Cells outside the map on every side.
        padding: usize,
    },
    /// Mean over the whole map, `[batch, channel, 1, 1]`.
    GlobalAveragePool,
    /// Bilinear enlargement with half-pixel centres (corners not aligned).
    Upsample {
        /// Enlargement.
        factor: usize,
    },
    /// Sum of two maps.
    Add,
    /// Product of a map and a gate of one value a channel.
    Multiply,
    /// Inputs one after the other along the channels.
    Concat,
    /// Sum of the inputs with learnt weights: `sum(max(w_i, 0) x_i) / (sum(max(w_i, 0)) + 1e-4)` (fast normalised
    /// fusion of `EfficientDet`).
    WeightedSum {
        /// One weight an input.
        weight: ParameterId,
    },
    /// So many channels of the input as the node has, from this one on.
    Narrow {
        /// The first of them.
        start: usize,
    },
    /// What a sampler makes of the maps before it (`farsight_core::samplers`), outside of any engine. What comes after
    /// it, up to the next sampler, reads nothing else. Engines get the network in parts
    /// ([`crate::transform::Network::parts`]).
    Sampler {
        /// Width and height of what it makes, whatever the size of the image.
        size: [usize; 2],
    },
}

impl Op {
    /// Maximum over tiles of `size` x `size` cells.
    pub const fn max_of_tiles(size: usize) -> Self {
        Self::MaxPool { kernel: size, stride: size, padding: 0 }
    }

    /// The parameters that it reads.
    pub fn parameters(&self) -> Vec<ParameterId> {
        self.clone().parameters_mut().into_iter().map(|id| *id).collect()
    }

    /// The parameters that it reads, to be renumbered.
    pub fn parameters_mut(&mut self) -> Vec<&mut ParameterId> {
        match self {
            Self::Conv { weight, bias, .. } => [Some(weight), bias.as_mut()].into_iter().flatten().collect(),
            Self::DeformConv { weight, bias, .. } | Self::GroupNorm { weight, bias, .. } => vec![weight, bias],
            Self::BatchNorm { weight, bias, mean, variance } => vec![weight, bias, mean, variance],
            Self::UpConv { weight, .. } | Self::WeightedSum { weight } => vec![weight],
            Self::Input
            | Self::Relu
            | Self::Relu6
            | Self::Narrow { .. }
            | Self::Sampler { .. }
            | Self::Sigmoid
            | Self::MaxPool { .. }
            | Self::GlobalAveragePool
            | Self::Upsample { .. }
            | Self::Add
            | Self::Multiply
            | Self::Concat => Vec::new(),
        }
    }
}

/// Kernel, stride, padding and dilation of a convolution, the same for both axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// Taps a side.
    pub kernel: usize,
    /// Step.
    pub stride: usize,
    /// Zeros on every side.
    pub padding: usize,
    /// So many more zeros at the right and at the bottom.
    pub end_padding: usize,
    /// Distance between taps.
    pub dilation: usize,
}

impl Window {
    /// A window whose output has the input's size divided by `stride`.
    pub const fn same(kernel: usize, stride: usize) -> Self {
        Self { kernel, stride, padding: kernel / 2, end_padding: 0, dilation: 1 }
    }

    /// As [`Window::same`], with the zeros where TensorFlow's `SAME` has them for sizes that `stride` divides: the odd
    /// one at the end.
    pub const fn tensorflow_same(kernel: usize, stride: usize) -> Self {
        let zeros = kernel.saturating_sub(stride);
        Self { kernel, stride, padding: zeros / 2, end_padding: zeros % 2, dilation: 1 }
    }

    /// Size of the output along an axis of `size` cells; `None` when the window does not fit.
    pub fn output_size(&self, size: usize) -> Option<usize> {
        (size + 2 * self.padding + self.end_padding)
            .checked_sub(self.dilation * (self.kernel - 1) + 1)
            .map(|room| room / self.stride + 1)
    }
}

/// One step of the network.
#[derive(Debug, Clone, PartialEq)]
pub struct Node {
    /// What it computes.
    pub op: Op,
    /// From which nodes, all earlier in the list.
    pub inputs: Vec<NodeId>,
    /// Channels of its output.
    pub channels: usize,
    /// The part of the network it belongs to, for counts.
    pub stage: &'static str,
}

/// How a parameter starts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Init {
    /// All the same value.
    Constant(f32),
    /// Uniform between minus and plus this bound.
    Uniform(f32),
    /// Normal with this standard deviation.
    Normal(f32),
    /// Bilinear enlargement, the same for all channels (spec 3.2).
    BilinearUp,
}

/// A tensor that the network owns.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// Its name; official SMOKE's where SMOKE has it.
    pub name: String,
    /// Its shape.
    pub shape: Vec<usize>,
    /// How it starts.
    pub init: Init,
    /// What it is to the optimiser and to the forward pass.
    pub role: Role,
    /// The part of the network it belongs to, for counts.
    pub stage: &'static str,
}

/// What a parameter is to the optimiser and to the forward pass.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Learnt.
    Learnt,
    /// Running statistics: updated by the forward pass, not by the optimiser.
    Statistic,
    /// As it is: neither the optimiser nor the forward pass moves it.
    Frozen,
    /// In every public checkpoint but never used: the outer projections of levels 3 and 4 (spec 2.3).
    Unused,
}

impl Parameter {
    /// Number of values.
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }

    /// Whether it holds nothing.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// A network.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Graph {
    /// Nodes in an order in which they can be computed.
    pub nodes: Vec<Node>,
    /// Parameters in the order in which the builders made them.
    pub parameters: Vec<Parameter>,
    /// Nodes with a name: the outputs, and the maps in between that the golden tensors hold.
    pub taps: Vec<(String, NodeId)>,
}

impl Graph {
    /// The node called `name`.
    pub fn tap(&self, name: &str) -> Option<NodeId> {
        self.taps.iter().find(|(tap, _)| tap == name).map(|&(_, id)| id)
    }

    /// Shape `[channels, height, width]` of every node for an input of `width` x `height` pixels; `None` where a map
    /// would be empty or two maps that are added differ.
    pub fn shapes(&self, width: usize, height: usize) -> Option<Vec<[usize; 3]>> {
        let mut shapes: Vec<[usize; 3]> = Vec::with_capacity(self.nodes.len());
        for node in &self.nodes {
            let [h, w] = match node.inputs.first() {
                None => [height, width],
                Some(&first) => {
                    let [_, h, w] = shapes[first];
                    let same_size = |&id: &NodeId| shapes[id][1..] == [h, w];
                    match node.op {
                        Op::Conv { window, .. } | Op::DeformConv { window, .. } => {
                            [window.output_size(h)?, window.output_size(w)?]
                        }
                        Op::UpConv { factor, .. } | Op::Upsample { factor } => [h * factor, w * factor],
                        Op::MaxPool { kernel, stride, padding } => {
                            let pooled = |side: usize| Some((side + 2 * padding).checked_sub(kernel)? / stride + 1);
                            [pooled(h)?, pooled(w)?]
                        }
                        Op::Sampler { size: [width, height] } => [height, width],
                        Op::GlobalAveragePool => [1, 1],
                        Op::Add | Op::Concat | Op::WeightedSum { .. } if !node.inputs.iter().all(same_size) => {
                            return None;
                        }
                        _ => [h, w],
                    }
                }
            };
            if h == 0 || w == 0 {
                return None;
            }
            shapes.push([node.channels, h, w]);
        }
        Some(shapes)
    }

    /// How many nodes read each node.
    pub fn consumers(&self) -> Vec<usize> {
        let mut consumers = vec![0; self.nodes.len()];
        for &input in self.nodes.iter().flat_map(|node| &node.inputs) {
            consumers[input] += 1;
        }
        consumers
    }

    /// This network with parameters of other shapes: the same nodes, wider or narrower. `shape_of` knows each parameter
    /// by its name.
    ///
    /// # Errors
    /// The parameter that is missing or does not fit what comes before it, and the shape that would.
    pub fn with_shapes(&self, shape_of: impl Fn(&str) -> Option<Vec<usize>>) -> Result<Self, ShapeMismatch> {
        let mut graph = self.clone();
        for parameter in graph.parameters.iter_mut().filter(|p| p.role != Role::Unused) {
            parameter.shape = shape_of(&parameter.name)
                .filter(|shape| shape.len() == parameter.shape.len() && !shape.contains(&0))
                .ok_or_else(|| ShapeMismatch {
                    parameter: parameter.name.clone(),
                    expected: parameter.shape.clone(),
                })?;
        }
        for id in 0..graph.nodes.len() {
            let channels = graph.channels_from_shapes(self, id)?;
            graph.nodes[id].channels = channels;
            if let Op::Conv { groups, .. } = &mut graph.nodes[id].op
                && *groups > 1
            {
                *groups = channels;
            }
        }
        Ok(graph)
    }

    /// The channels of node `id`, after those of all before it; `original` has the kernels that must not change.
    fn channels_from_shapes(&self, original: &Self, id: NodeId) -> Result<usize, ShapeMismatch> {
        let node = &self.nodes[id];
        let inputs: Vec<usize> = node.inputs.iter().map(|&input| self.nodes[input].channels).collect();
        let expect = |parameter: ParameterId, expected: Vec<usize>| {
            let Parameter { name, shape, .. } = &self.parameters[parameter];
            if *shape == expected { Ok(()) } else { Err(ShapeMismatch { parameter: name.clone(), expected }) }
        };
        let first = inputs.first().copied().unwrap_or(node.channels);
        match node.op {
            Op::Conv { weight, bias, groups, .. } => {
                let kernel = original.parameters[weight].shape[2..].iter().copied();
                let channels = if groups == 1 { self.parameters[weight].shape[0] } else { first };
                let fan_in = if groups == 1 { first } else { 1 };
                expect(weight, [channels, fan_in].into_iter().chain(kernel).collect())?;
                bias.map_or(Ok(()), |bias| expect(bias, vec![channels]))?;
                Ok(channels)
            }
            Op::DeformConv { weight, bias, window } => {
                let channels = self.parameters[weight].shape[0];
                expect(weight, vec![channels, first, window.kernel, window.kernel])?;
                expect(bias, vec![channels])?;
                Ok(channels)
            }
            Op::UpConv { weight, factor } => expect(weight, vec![first, 1, 2 * factor, 2 * factor]).map(|()| first),
            Op::GroupNorm { groups, weight, bias } => {
                let whole = first.next_multiple_of(groups);
                [weight, bias].into_iter().try_for_each(|parameter| expect(parameter, vec![whole])).map(|()| first)
            }
            Op::BatchNorm { weight, bias, mean, variance } => {
                let parameters = [weight, bias, mean, variance];
                parameters.into_iter().try_for_each(|parameter| expect(parameter, vec![first])).map(|()| first)
            }
            Op::WeightedSum { weight } => {
                expect(weight, vec![inputs.len()])?;
                self.equal_inputs(node).map(|()| first)
            }
            Op::Add | Op::Multiply => self.equal_inputs(node).map(|()| first),
            Op::Concat => Ok(inputs.iter().sum()),
            Op::Sampler { .. } | Op::Narrow { .. } => Ok(node.channels),
            _ => Ok(first),
        }
    }

    /// Maps that are added must have the same channels; the misfit is named by the last parameter before the first of
    /// them that differs.
    fn equal_inputs(&self, node: &Node) -> Result<(), ShapeMismatch> {
        let channels = self.nodes[node.inputs[0]].channels;
        match node.inputs.iter().find(|&&input| self.nodes[input].channels != channels) {
            None => Ok(()),
            Some(&input) => Err(ShapeMismatch { parameter: self.maker(input), expected: vec![channels] }),
        }
    }

    /// Name of a parameter that decides about the channels of `node`.
    fn maker(&self, mut node: NodeId) -> String {
        loop {
            match self.nodes[node].op {
                Op::Conv { weight, .. } | Op::DeformConv { weight, .. } => {
                    return self.parameters[weight].name.clone();
                }
                _ => match self.nodes[node].inputs.first() {
                    Some(&input) => node = input,
                    None => return "the input".to_owned(),
                },
            }
        }
    }
}

/// A parameter whose shape fits no network.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ShapeMismatch {
    /// Its name.
    pub parameter: String,
    /// The shape that would fit.
    pub expected: Vec<usize>,
}

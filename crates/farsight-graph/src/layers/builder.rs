//! The verbs that the builders share.

use serde::{Deserialize, Serialize};

use crate::graph::{Graph, Init, Node, NodeId, Op, Parameter, ParameterId, Role, Window};

/// The normalisation of a network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NormKind {
    /// `GroupNorm`, 32 groups where they divide the channels, otherwise 16 (spec section 1).
    #[default]
    Group,
    /// `BatchNorm` with running statistics; folds into the convolutions for deployment.
    Batch,
}

/// A graph in the making.
#[derive(Debug)]
pub struct Builder {
    graph: Graph,
    norm: NormKind,
    /// Groups of every group norm, instead of the usual ones.
    groups: Option<usize>,
    stage: &'static str,
}

impl Builder {
    /// An empty graph whose norms are of this kind.
    pub fn new(norm: NormKind) -> Self {
        Self::from_graph(Graph::default(), norm)
    }

    /// Goes on with `graph`.
    pub fn from_graph(graph: Graph, norm: NormKind) -> Self {
        Self { graph, norm, groups: None, stage: "input" }
    }

    /// An empty graph whose norms are group norms of so many groups.
    pub fn with_groups(groups: usize) -> Self {
        Self { groups: Some(groups), ..Self::new(NormKind::Group) }
    }

    /// The finished graph.
    pub fn finish(self) -> Graph {
        self.graph
    }

    /// Names the part of the network that follows.
    pub fn stage(&mut self, stage: &'static str) {
        self.stage = stage;
    }

    /// Gives `node` a name under which it can be asked for.
    pub fn tap(&mut self, name: &str, node: NodeId) {
        self.graph.taps.push((name.to_owned(), node));
    }

    /// Channels of `node`.
    pub fn channels(&self, node: NodeId) -> usize {
        self.graph.nodes[node].channels
    }

    /// A place for an input of so many channels.
    pub fn input(&mut self, channels: usize) -> NodeId {
        self.push(Op::Input, &[], channels)
    }

    /// A parameter that the optimiser learns.
    pub fn parameter(&mut self, name: String, shape: &[usize], init: Init) -> ParameterId {
        self.add_parameter(name, shape, init, Role::Learnt)
    }

    /// A convolution without bias, `Kaiming` normal over the fan out.
    pub fn conv(&mut self, x: NodeId, name: &str, channels: usize, window: Window) -> NodeId {
        let std = (2.0 / (window.kernel * window.kernel * channels) as f32).sqrt();
        let shape = [channels, self.channels(x), window.kernel, window.kernel];
        let weight = self.parameter(format!("{name}.weight"), &shape, Init::Normal(std));
        self.push(Op::Conv { weight, bias: None, window, groups: 1 }, &[x], channels)
    }

    /// A depthwise convolution without bias.
    pub fn depthwise_conv(&mut self, x: NodeId, name: &str, window: Window) -> NodeId {
        let channels = self.channels(x);
        let taps = window.kernel * window.kernel;
        let weight = self.parameter(
            format!("{name}.weight"),
            &[channels, 1, window.kernel, window.kernel],
            Init::Normal((2.0 / taps as f32).sqrt()),
        );
        self.push(Op::Conv { weight, bias: None, window, groups: channels }, &[x], channels)
    }

    /// A convolution with bias; the weight starts as `PyTorch` starts it, the bias as `bias` says or likewise.
    pub fn conv_with_bias(
        &mut self,
        x: NodeId,
        name: &str,
        channels: usize,
        kernel: usize,
        bias: Option<Init>,
    ) -> NodeId {
        let uniform = Init::Uniform(1.0 / ((kernel * kernel * self.channels(x)) as f32).sqrt());
        self.conv_started(x, name, channels, Window::same(kernel, 1), [uniform, bias.unwrap_or(uniform)])
    }

    /// A convolution with bias; weight and bias start as `[weight, bias]` says.
    pub fn conv_started(
        &mut self,
        x: NodeId,
        name: &str,
        channels: usize,
        window: Window,
        [weight, bias]: [Init; 2],
    ) -> NodeId {
        let shape = [channels, self.channels(x), window.kernel, window.kernel];
        let weight = self.parameter(format!("{name}.weight"), &shape, weight);
        let bias = self.parameter(format!("{name}.bias"), &[channels], bias);
        self.push(Op::Conv { weight, bias: Some(bias), window, groups: 1 }, &[x], channels)
    }

    /// A 3x3 deformable convolution with its offset convolution, which starts at zero (spec 3.1).
    pub fn deform_conv(&mut self, x: NodeId, name: &str, channels: usize) -> NodeId {
        let inputs = self.channels(x);
        let window = Window::same(3, 1);
        let taps = window.kernel * window.kernel;
        let zero = Init::Constant(0.0);
        let offset_weight = self.parameter(format!("{name}.conv_offset_mask.weight"), &[3 * taps, inputs, 3, 3], zero);
        let offset_bias = self.parameter(format!("{name}.conv_offset_mask.bias"), &[3 * taps], zero);
        let offset_conv = Op::Conv { weight: offset_weight, bias: Some(offset_bias), window, groups: 1 };
        let offsets = self.push(offset_conv, &[x], 3 * taps);
        let bound = 1.0 / ((taps * inputs) as f32).sqrt();
        let weight = self.parameter(format!("{name}.weight"), &[channels, inputs, 3, 3], Init::Uniform(bound));
        let bias = self.parameter(format!("{name}.bias"), &[channels], zero);
        self.push(Op::DeformConv { weight, bias, window }, &[x, offsets], channels)
    }

    /// A learnt depthwise enlargement that starts bilinear.
    pub fn up_conv(&mut self, x: NodeId, name: &str, factor: usize) -> NodeId {
        let channels = self.channels(x);
        let shape = [channels, 1, 2 * factor, 2 * factor];
        let weight = self.parameter(format!("{name}.weight"), &shape, Init::BilinearUp);
        self.push(Op::UpConv { weight, factor }, &[x], channels)
    }

    /// The network's norm, scale 1.
    pub fn norm(&mut self, x: NodeId, name: &str) -> NodeId {
        self.norm_scaled(x, name, 1.0)
    }

    /// The network's norm with its scale at `scale`: 0 makes a residual branch start silent.
    pub fn norm_scaled(&mut self, x: NodeId, name: &str, scale: f32) -> NodeId {
        let channels = self.channels(x);
        let op = self.norm_op(name, channels, scale, Role::Learnt);
        self.push(op, &[x], channels)
    }

    /// A scale and a shift of each channel that nothing moves, as a batch norm: what another program does to the image
    /// before its network.
    pub fn fixed_scale(&mut self, x: NodeId, name: &str) -> NodeId {
        let shape = [self.channels(x)];
        let values = [("weight", 1.0), ("bias", 0.0), ("running_mean", 0.0), ("running_var", 1.0)];
        let [weight, bias, mean, variance] = values.map(|(part, value)| {
            self.add_parameter(format!("{name}.{part}"), &shape, Init::Constant(value), Role::Frozen)
        });
        self.push(Op::BatchNorm { weight, bias, mean, variance }, &[x], shape[0])
    }

    /// Convolution, norm, `ReLU`.
    pub fn conv_norm_relu(&mut self, x: NodeId, conv: &str, norm: &str, channels: usize, window: Window) -> NodeId {
        let x = self.conv(x, conv, channels, window);
        let x = self.norm(x, norm);
        self.relu(x)
    }

    /// A 1x1 projection with its norm that is in every checkpoint but in no forward pass (spec 2.3, item 4).
    pub fn unused_projection(&mut self, name: &str, inputs: usize, channels: usize) {
        let std = (2.0 / channels as f32).sqrt();
        self.add_parameter(format!("{name}.0.weight"), &[channels, inputs, 1, 1], Init::Normal(std), Role::Unused);
        self.norm_op(&format!("{name}.1"), channels, 1.0, Role::Unused);
    }

    /// `max(x, 0)`.
    pub fn relu(&mut self, x: NodeId) -> NodeId {
        self.map(Op::Relu, x)
    }

    /// An operation that keeps the channels of its one input.
    pub fn map(&mut self, op: Op, x: NodeId) -> NodeId {
        let channels = self.channels(x);
        self.push(op, &[x], channels)
    }

    /// Sum of two maps.
    pub fn add(&mut self, a: NodeId, b: NodeId) -> NodeId {
        let channels = self.channels(a);
        self.push(Op::Add, &[a, b], channels)
    }

    /// `channels` of the channels of `x`, from `start` on.
    pub fn narrow(&mut self, x: NodeId, start: usize, channels: usize) -> NodeId {
        self.push(Op::Narrow { start }, &[x], channels)
    }

    /// What a sampler outside makes of `maps`: so many channels of this width and height.
    pub fn sampler(&mut self, maps: &[NodeId], channels: usize, size: [usize; 2]) -> NodeId {
        self.push(Op::Sampler { size }, maps, channels)
    }

    /// Maps one after the other along the channels.
    pub fn concat(&mut self, inputs: &[NodeId]) -> NodeId {
        let channels = inputs.iter().map(|&x| self.channels(x)).sum();
        self.push(Op::Concat, inputs, channels)
    }

    /// Squeeze and excitation: a gate a channel from the mean of the map, `reduction` times narrower in between; the
    /// gates start near 0.88.
    pub fn channel_attention(&mut self, x: NodeId, name: &str, reduction: usize) -> NodeId {
        let channels = self.channels(x);
        let mean = self.map(Op::GlobalAveragePool, x);
        let narrow = self.conv_with_bias(mean, &format!("{name}.down"), (channels / reduction).max(1), 1, None);
        let narrow = self.relu(narrow);
        let wide = self.conv_with_bias(narrow, &format!("{name}.up"), channels, 1, Some(Init::Constant(2.0)));
        let gate = self.map(Op::Sigmoid, wide);
        self.push(Op::Multiply, &[x, gate], channels)
    }

    /// Fast normalised fusion of maps of one shape; all weights start at 1.
    pub fn weighted_sum(&mut self, inputs: &[NodeId], name: &str) -> NodeId {
        let weight = self.parameter(name.to_owned(), &[inputs.len()], Init::Constant(1.0));
        let channels = self.channels(inputs[0]);
        self.push(Op::WeightedSum { weight }, inputs, channels)
    }

    fn norm_op(&mut self, name: &str, channels: usize, scale: f32, role: Role) -> Op {
        let shape = [channels];
        let weight = self.add_parameter(format!("{name}.weight"), &shape, Init::Constant(scale), role);
        let bias = self.add_parameter(format!("{name}.bias"), &shape, Init::Constant(0.0), role);
        match self.norm {
            NormKind::Group => {
                let usual = if channels.is_multiple_of(32) { 32 } else { 16 };
                Op::GroupNorm { groups: self.groups.unwrap_or(usual), weight, bias }
            }
            NormKind::Batch => {
                let role = if role == Role::Unused { role } else { Role::Statistic };
                let mean = self.add_parameter(format!("{name}.running_mean"), &shape, Init::Constant(0.0), role);
                let variance = self.add_parameter(format!("{name}.running_var"), &shape, Init::Constant(1.0), role);
                Op::BatchNorm { weight, bias, mean, variance }
            }
        }
    }

    fn add_parameter(&mut self, name: String, shape: &[usize], init: Init, role: Role) -> ParameterId {
        self.graph.parameters.push(Parameter { name, shape: shape.to_vec(), init, role, stage: self.stage });
        self.graph.parameters.len() - 1
    }

    fn push(&mut self, op: Op, inputs: &[NodeId], channels: usize) -> NodeId {
        self.graph.nodes.push(Node { op, inputs: inputs.to_vec(), channels, stage: self.stage });
        self.graph.nodes.len() - 1
    }
}

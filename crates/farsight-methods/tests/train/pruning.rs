//! Pruning removes the channels that say nothing, and then the network answers as before.

use farsight_graph::graph::{Graph, Op, ParameterId};
use farsight_graph::init::initial_weights;
use farsight_graph::layers::{Msfe, NeckKind, NormKind};
use farsight_graph::model::NetworkConfig;
use farsight_graph::prune::prune;
use farsight_graph::weights::Weights;
use farsight_methods::smoke::{SmokeConfig, SmokeModel};
use farsight_onnx::INPUT as IMAGE;
use farsight_runtime::{Runner, TensorView};
use farsight_train::runner::TorchRunner;

/// Sums are in another order once there are fewer channels.
const TOLERANCE: f32 = 1e-5;

const INPUT: [usize; 2] = [64, 64];

#[test]
fn channels_that_say_nothing_are_the_ones_that_go() {
    for msfe in [Msfe::A, Msfe::B, Msfe::C] {
        let config = SmokeConfig {
            level_channels: Some([16; 6]),
            head_channels: Some(16),
            width: 0.25,
            norm: NormKind::Batch,
            neck: NeckKind::Plain,
            msfe,
            ..SmokeConfig::default()
        };
        let graph = config.graph();
        let mut weights = initial_weights(&graph, 3);
        wake_residuals(&mut weights);
        silence_odd_channels(&graph, &mut weights);
        let whole = SmokeModel::new(config, weights).unwrap();
        let pruned = prune(&whole, 0.5).unwrap();
        let (before, after) = (answers(&whole), answers(&pruned));
        let largest = before.iter().zip(&after).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(before.iter().any(|v| v.abs() > 0.1), "{msfe:?}: the network says nothing at all");
        assert!(largest <= TOLERANCE, "{msfe:?}: {largest}");
    }
}

/// MSFE starts silent; its closing norms get a voice, or it would not be tested.
fn wake_residuals(weights: &mut Weights) {
    let closing = weights.tensors.iter_mut().filter(|(name, _)| name.ends_with("back_norm.weight"));
    closing.for_each(|(_, tensor)| tensor.values.fill(0.5));
}

/// Every norm says zero on its odd channels; so does every convolution without a norm that is not an output.
fn silence_odd_channels(graph: &Graph, weights: &mut Weights) {
    let mut silence = |parameter: ParameterId| {
        let tensor = weights.tensors.get_mut(&graph.parameters[parameter].name).unwrap();
        let row = tensor.values.len() / tensor.shape[0];
        tensor.values.chunks_mut(row).skip(1).step_by(2).for_each(|odd| odd.fill(0.0));
    };
    for node in &graph.nodes {
        match node.op {
            Op::BatchNorm { weight, bias, .. } => [weight, bias].into_iter().for_each(&mut silence),
            Op::Conv { weight, bias: Some(bias), .. } if graph.parameters[weight].name.ends_with("se.down.weight") => {
                [weight, bias].into_iter().for_each(&mut silence);
            }
            _ => {}
        }
    }
}

fn answers(model: &SmokeModel) -> Vec<f32> {
    let input: Vec<f32> = (0..3 * INPUT[0] * INPUT[1]).map(|i| ((i * 37 % 101) as f32 / 50.0) - 1.0).collect();
    let view = TensorView { shape: &[1, 3, INPUT[1], INPUT[0]], values: &input };
    let maps = TorchRunner::on_cpu(model).unwrap().run(&[(IMAGE, view)]).unwrap();
    maps.into_iter().flat_map(|map| map.values).collect()
}

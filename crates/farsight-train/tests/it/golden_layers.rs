//! Single layers and losses against reference tensors computed in double precision.

use crate::golden_support::{Golden, assert_close, assert_close_relative, golden};
use farsight_net::build::{Builder, NormKind, msfe};
use farsight_net::graph::{Graph, Op, Window};
use farsight_net::init::initial_weights;
use farsight_net::weights::{WeightTensor, Weights};
use farsight_train::deform::deformable_samples;
use farsight_train::executor::{Mode, Network, Precision, weight_from_tensor};
use farsight_train::loss::focal_loss;
use tch::{Device, Kind, Tensor};

const DEFORM_TOLERANCE: f64 = 1e-4;
const LAYER_TOLERANCE: f64 = 1e-5;
const MSFE_TOLERANCE: f64 = 1e-5;
const FOCAL_TOLERANCE: f64 = 1e-4;

fn leaf(tensor: &Tensor) -> Tensor {
    tensor.copy().set_requires_grad(true)
}

#[test]
fn deformable_convolution_forward_and_gradients() {
    let cases = [
        ("deform_k1s1p0", Window { kernel: 1, stride: 1, padding: 0, end_padding: 0, dilation: 1 }),
        ("deform_k3s1p1", Window { kernel: 3, stride: 1, padding: 1, end_padding: 0, dilation: 1 }),
        ("deform_k3s1p1dg2", Window { kernel: 3, stride: 1, padding: 1, end_padding: 0, dilation: 1 }),
        ("deform_k3s1p2d2", Window { kernel: 3, stride: 1, padding: 2, end_padding: 0, dilation: 2 }),
        ("deform_k3s2p1", Window { kernel: 3, stride: 2, padding: 1, end_padding: 0, dilation: 1 }),
    ];
    for (name, window) in cases {
        let Some(g) = golden(name) else { return };
        let leaves = ["x", "offset", "mask", "weight", "bias"].map(|n| leaf(&g[n]));
        let [x, offset, mask, weight, bias] = &leaves;
        let samples = deformable_samples(x, offset, mask, window);
        let kernel = weight.view([weight.size()[0], -1, 1, 1]);
        let out = samples.conv2d(&kernel, Some(bias), [1; 2], [0; 2], [1; 2], 1);
        assert_close(&format!("{name} out"), &out, &g["out"], DEFORM_TOLERANCE);
        let gradients = Tensor::run_backward(&[(out * &g["grad_out"]).sum(Kind::Float)], &leaves, false, false);
        for (gradient, expected) in gradients.iter().zip(["d_x", "d_offset", "d_mask", "d_weight", "d_bias"]) {
            assert_close(&format!("{name} {expected}"), gradient, &g[expected], DEFORM_TOLERANCE);
        }
    }
}

/// A network of one node on an input with the channels of `x`, its parameters taken from `values`.
fn one_node(
    g: &Golden,
    x: &Tensor,
    values: &[(&str, &str)],
    build: impl Fn(&mut Builder, usize) -> usize,
    norm: NormKind,
) -> Network {
    let mut b = Builder::new(norm);
    let input = b.input(x.size()[1] as usize);
    let node = build(&mut b, input);
    b.tap("y", node);
    let graph = b.finish();
    let mut weights = initial_weights(&graph, 0);
    for (parameter, value) in values {
        weights.tensors.insert((*parameter).to_owned(), weight_from_tensor(&g[*value]));
    }
    Network::new(graph, &weights, Device::Cpu, Precision::F32).unwrap()
}

fn check_node(what: &str, network: &Network, x: &Tensor, y: &Tensor) -> (Tensor, Tensor) {
    let x = leaf(x);
    let tap = network.graph().tap("y").unwrap();
    // A second reader of the input would forbid work in place; here the input itself is a leaf and must survive.
    let out = network.forward(&x, Mode::Evaluate, &[tap]).remove(0);
    assert_close(what, &out, y, LAYER_TOLERANCE);
    (x, out)
}

#[test]
fn norms_enlargements_and_pooling() {
    let Some(g) = golden("layers") else { return };
    for name in ["gn16_16", "gn64_32", "gn96_32"] {
        let key = |part: &str| format!("{name}.{part}");
        let (gamma, beta) = (key("gamma"), key("beta"));
        let values = [("n.weight", gamma.as_str()), ("n.bias", beta.as_str())];
        let network = one_node(&g, &g[&key("x")], &values, |b, x| b.norm(x, "n"), NormKind::Group);
        let (x, out) = check_node(name, &network, &g[&key("x")], &g[&key("y")]);
        let leaves: Vec<Tensor> = network.learnt().map(|(_, t)| t.shallow_clone()).chain([x]).collect();
        let gradients = Tensor::run_backward(&[(out * &g[&key("grad_out")]).sum(Kind::Float)], &leaves, false, false);
        for (gradient, part) in gradients.iter().zip(["d_gamma", "d_beta", "d_x"]) {
            assert_close(&key(part), gradient, &g[&key(part)], LAYER_TOLERANCE);
        }
    }
    let values =
        [("n.weight", "bn.gamma"), ("n.bias", "bn.beta"), ("n.running_mean", "bn.mean"), ("n.running_var", "bn.var")];
    let network = one_node(&g, &g["bn.x"], &values, |b, x| b.norm(x, "n"), NormKind::Batch);
    let _ = check_node("bn", &network, &g["bn.x"], &g["bn.y"]);

    for (name, factor) in [("up2", 2), ("up4", 4)] {
        let key = |part: &str| format!("{name}.{part}");
        let up = |b: &mut Builder, x| b.up_conv(x, "up", factor);
        let initial = one_node(&g, &g[&key("x")], &[], up, NormKind::Group);
        let weight = &initial.weights().tensors["up.weight"];
        assert_eq!(*weight, weight_from_tensor(&g[&key("init_weight")]), "{name}: initial weight");
        let _ = check_node(name, &initial, &g[&key("x")], &g[&key("y_init")]);
        let network = one_node(&g, &g[&key("x")], &[("up.weight", &key("weight"))], up, NormKind::Group);
        let (x, out) = check_node(name, &network, &g[&key("x")], &g[&key("y")]);
        let leaves: Vec<Tensor> = network.learnt().map(|(_, t)| t.shallow_clone()).chain([x]).collect();
        let gradients = Tensor::run_backward(&[(out * &g[&key("grad_out")]).sum(Kind::Float)], &leaves, false, false);
        assert_close(&key("d_weight"), &gradients[0], &g[&key("d_weight")], LAYER_TOLERANCE);
        assert_close(&key("d_x"), &gradients[1], &g[&key("d_x")], LAYER_TOLERANCE);
    }

    let network = one_node(&g, &g["maxpool.x"], &[], |b, x| b.map(Op::MaxPool { size: 2 }, x), NormKind::Group);
    let (x, out) = check_node("maxpool", &network, &g["maxpool.x"], &g["maxpool.y"]);
    let gradients = Tensor::run_backward(&[(out * &g["maxpool.grad_out"]).sum(Kind::Float)], &[x], false, false);
    assert_close("maxpool d_x", &gradients[0], &g["maxpool.d_x"], LAYER_TOLERANCE);
}

#[test]
fn focal_loss_with_no_one_and_several_positives() {
    let Some(g) = golden("focal") else { return };
    for case in ["f0", "f1", "f2"] {
        let key = |part: &str| format!("{case}.{part}");
        let logits = leaf(&g[&key("logits")]);
        let loss = focal_loss(&logits, &g[&key("target")]);
        assert_close_relative(&key("loss"), &loss, &g[&key("loss")], FOCAL_TOLERANCE);
        let gradients = Tensor::run_backward(&[loss], &[logits], false, false);
        assert_close_relative(&key("d_logits"), &gradients[0], &g[&key("d_logits")], FOCAL_TOLERANCE);
    }
}

/// Design A on its own: three inputs, three outputs.
fn msfe_a() -> Graph {
    let mut b = Builder::new(NormKind::Group);
    let inputs = [16, 32, 48].map(|channels| b.input(channels));
    let outputs = msfe::residual_pyramid(&mut b, "", inputs, 32);
    for (i, &output) in outputs.iter().enumerate() {
        b.tap(&format!("out{}", i + 3), output);
    }
    b.finish()
}

#[test]
fn msfe_a_forward_and_gradients() {
    let Some(g) = golden("msfe_a") else { return };
    let graph = msfe_a();
    let tensor = |name: &String| (name.clone(), weight_from_tensor(&g[name]));
    let weights = Weights { tensors: graph.parameters.iter().map(|p| tensor(&p.name)).collect(), ..Weights::default() };
    let network = Network::new(graph, &weights, Device::Cpu, Precision::F32).unwrap();
    let taps = ["out3", "out4", "out5", "tap.p3.topdown"].map(|name| network.graph().tap(name).unwrap());
    let inputs = ["c3", "c4", "c5"].map(|name| leaf(&g[name]));
    let outputs = network.forward_from(&inputs, Mode::Evaluate, &taps);
    for (output, name) in outputs.iter().zip(["out3", "out4", "out5", "tap.p3.topdown"]) {
        assert_close(name, output, &g[name], MSFE_TOLERANCE);
    }
    let objective = (0..3)
        .fold(Tensor::from(0.0_f32), |sum, i| sum + (&outputs[i] * &g[&format!("grad_out{}", i + 3)]).sum(Kind::Float));
    let (names, leaves): (Vec<String>, Vec<Tensor>) = network
        .learnt()
        .map(|(name, tensor)| (format!("grad.{name}"), tensor.shallow_clone()))
        .chain(
            ["d_c3", "d_c4", "d_c5"]
                .iter()
                .zip(&inputs)
                .map(|(name, input)| ((*name).to_owned(), input.shallow_clone())),
        )
        .filter(|(name, _)| g.contains_key(name))
        .unzip();
    assert_eq!(names.len(), 8, "{names:?}");
    let gradients = Tensor::run_backward(&[objective], &leaves, false, false);
    for (gradient, name) in gradients.iter().zip(&names) {
        assert_close(name, gradient, &g[name], MSFE_TOLERANCE * g[name].abs().max().double_value(&[]).max(1.0));
    }
}

#[test]
fn weights_of_the_wrong_shape_are_refused() {
    let graph = msfe_a();
    let mut weights = initial_weights(&graph, 0);
    weights.tensors.insert("p3.lat.weight".into(), WeightTensor { shape: vec![1], values: vec![0.0] });
    let error = Network::new(graph, &weights, Device::Cpu, Precision::F32).unwrap_err();
    assert_eq!(error.to_string(), "tensor \"p3.lat.weight\" has shape [1]; the network expects [32, 16, 1, 1]");
}

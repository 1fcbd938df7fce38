//! Single layers and the focal loss against reference tensors, all in double precision.

use crate::golden_support::{Golden, assert_exact, golden, gradients_along, leaf};
use farsight_graph::graph::{Op, Window};
use farsight_graph::init::initial_weights;
use farsight_graph::layers::{Builder, NormKind};
use farsight_train::deform::deformable_samples;
use farsight_train::executor::{Mode, Network, Precision, weight_from_tensor};
use farsight_train::losses::focal_loss;
use tch::{Device, Tensor};

/// Added to offsets. Samples of the last cell lie exactly on the grid, where the derivative jumps. Rounding would
/// choose the side; the reference takes that of the further pixel.
const NUDGE: f64 = 1e-9;

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
        let g = golden(name);
        let leaves = ["x", "offset", "mask", "weight", "bias"].map(|n| leaf(&g[n]));
        let [x, offset, mask, weight, bias] = &leaves;
        let offset = &(offset + NUDGE);
        let samples = deformable_samples(x, offset, mask, window);
        let kernel = weight.view([weight.size()[0], -1, 1, 1]);
        let out = samples.conv2d(&kernel, Some(bias), [1; 2], [0; 2], [1; 2], 1);
        assert_exact(&format!("{name} out"), &out, &g["out"]);
        let gradients = gradients_along(&[(&out, &g["grad_out"])], &leaves);
        for (gradient, expected) in gradients.iter().zip(["d_x", "d_offset", "d_mask", "d_weight", "d_bias"]) {
            assert_exact(&format!("{name} {expected}"), gradient, &g[expected]);
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
    Network::new(graph, &weights, Device::Cpu, Precision::F64).unwrap()
}

fn check_node(what: &str, network: &Network, x: &Tensor, y: &Tensor) -> (Tensor, Tensor) {
    let x = leaf(x);
    let tap = network.graph().tap("y").unwrap();
    // A second reader of the input would forbid work in place; here the input itself is a leaf and must survive.
    let out = network.forward(&x, Mode::Evaluate, &[tap]).remove(0);
    assert_exact(what, &out, y);
    (x, out)
}

/// The learnt parameters, then the input.
fn leaves(network: &Network, x: Tensor) -> Vec<Tensor> {
    network.trainable_parameters().map(|(_, tensor)| tensor.shallow_clone()).chain([x]).collect()
}

#[test]
fn norms() {
    let g = golden("layers");
    for name in ["gn16_16", "gn64_32", "gn96_32"] {
        let key = |part: &str| format!("{name}.{part}");
        let (gamma, beta) = (key("gamma"), key("beta"));
        let values = [("n.weight", gamma.as_str()), ("n.bias", beta.as_str())];
        let network = one_node(&g, &g[&key("x")], &values, |b, x| b.norm(x, "n"), NormKind::Group);
        let (x, out) = check_node(name, &network, &g[&key("x")], &g[&key("y")]);
        let gradients = gradients_along(&[(&out, &g[&key("grad_out")])], &leaves(&network, x));
        for (gradient, part) in gradients.iter().zip(["d_gamma", "d_beta", "d_x"]) {
            assert_exact(&key(part), gradient, &g[&key(part)]);
        }
    }
    let values =
        [("n.weight", "bn.gamma"), ("n.bias", "bn.beta"), ("n.running_mean", "bn.mean"), ("n.running_var", "bn.var")];
    let network = one_node(&g, &g["bn.x"], &values, |b, x| b.norm(x, "n"), NormKind::Batch);
    let _ = check_node("bn", &network, &g["bn.x"], &g["bn.y"]);
}

#[test]
fn upsampling_and_pooling() {
    let g = golden("layers");
    for (name, factor) in [("up2", 2), ("up4", 4)] {
        let key = |part: &str| format!("{name}.{part}");
        let up = |b: &mut Builder, x| b.up_conv(x, "up", factor);
        let initial = one_node(&g, &g[&key("x")], &[], up, NormKind::Group);
        let weight = &initial.weights().tensors["up.weight"];
        assert_eq!(*weight, weight_from_tensor(&g[&key("init_weight")]), "{name}: initial weight");
        let _ = check_node(name, &initial, &g[&key("x")], &g[&key("y_init")]);
        let network = one_node(&g, &g[&key("x")], &[("up.weight", &key("weight"))], up, NormKind::Group);
        let (x, out) = check_node(name, &network, &g[&key("x")], &g[&key("y")]);
        let gradients = gradients_along(&[(&out, &g[&key("grad_out")])], &leaves(&network, x));
        assert_exact(&key("d_weight"), &gradients[0], &g[&key("d_weight")]);
        assert_exact(&key("d_x"), &gradients[1], &g[&key("d_x")]);
    }

    let network = one_node(&g, &g["maxpool.x"], &[], |b, x| b.map(Op::max_of_tiles(2), x), NormKind::Group);
    let (x, out) = check_node("maxpool", &network, &g["maxpool.x"], &g["maxpool.y"]);
    let gradients = gradients_along(&[(&out, &g["maxpool.grad_out"])], &[x]);
    assert_exact("maxpool d_x", &gradients[0], &g["maxpool.d_x"]);
}

#[test]
fn focal_loss_with_no_one_and_several_positives() {
    let g = golden("focal");
    for case in ["f0", "f1", "f2"] {
        let key = |part: &str| format!("{case}.{part}");
        let logits = leaf(&g[&key("logits")]);
        let loss = focal_loss(&logits, &g[&key("target")]);
        assert_exact(&key("loss"), &loss, &g[&key("loss")]);
        let gradients = Tensor::run_backward(&[loss], &[logits], false, false);
        assert_exact(&key("d_logits"), &gradients[0], &g[&key("d_logits")]);
    }
}

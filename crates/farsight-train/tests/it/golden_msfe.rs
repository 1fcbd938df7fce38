//! The three designs of MSFE, each on its own, against reference tensors, in double precision: outputs and gradients.

use crate::golden_support::{assert_exact, golden, gradients_along, leaf};
use farsight_graph::graph::Graph;
use farsight_graph::init::initial_weights;
use farsight_graph::layers::{Builder, NormKind, msfe};
use farsight_graph::weights::{WeightTensor, Weights};
use farsight_train::executor::{Mode, Network, Precision, weight_from_tensor};
use tch::{Device, Tensor};

/// Channels of C3, C4, C5, and of the neck's map in design B.
const PYRAMID: [usize; 3] = [16, 32, 48];
const NECK: usize = 16;

fn pyramid_design(build: impl Fn(&mut Builder, [usize; 3]) -> [usize; 3]) -> Graph {
    let mut b = Builder::new(NormKind::Group);
    let inputs = PYRAMID.map(|channels| b.input(channels));
    for (node, name) in build(&mut b, inputs).into_iter().zip(["out3", "out4", "out5"]) {
        b.tap(name, node);
    }
    b.finish()
}

fn design_a() -> Graph {
    pyramid_design(|b, inputs| msfe::residual_pyramid(b, "", inputs, 32))
}

fn design_b() -> Graph {
    let mut b = Builder::new(NormKind::Group);
    let inputs = PYRAMID.map(|channels| b.input(channels));
    let neck = b.input(NECK);
    let out = msfe::concat_fusion(&mut b, "", inputs, neck, 32);
    b.tap("out", out);
    b.finish()
}

fn design_c() -> Graph {
    pyramid_design(|b, inputs| msfe::bifpn(b, "", inputs, 48))
}

/// Compares all outputs and taps, and the gradients that the file has; says how many those are.
fn check(file: &str, graph: Graph, inputs: &[&str], outputs: &[&str], taps: &[&str]) -> usize {
    let g = golden(file);
    let tensor = |name: &String| (name.clone(), weight_from_tensor(&g[name]));
    let weights = Weights { tensors: graph.parameters.iter().map(|p| tensor(&p.name)).collect(), ..Weights::default() };
    let network = Network::new(graph, &weights, Device::Cpu, Precision::F64).unwrap();

    let wanted: Vec<&str> = outputs.iter().chain(taps).copied().collect();
    let nodes: Vec<usize> = wanted.iter().map(|name| network.graph().tap(name).unwrap()).collect();
    let maps: Vec<Tensor> = inputs.iter().map(|name| leaf(&g[*name])).collect();
    let found = network.forward_from(&maps, Mode::Evaluate, &nodes);
    for (map, name) in found.iter().zip(&wanted) {
        assert_exact(&format!("{file} {name}"), map, &g[*name]);
    }

    let directions: Vec<String> = outputs.iter().map(|name| format!("grad_{name}")).collect();
    let pairs: Vec<(&Tensor, &Tensor)> = found.iter().zip(directions.iter().map(|name| &g[name])).collect();
    let learnt = network.trainable_parameters().map(|(name, tensor)| (format!("grad.{name}"), tensor.shallow_clone()));
    let given = inputs.iter().zip(&maps).map(|(name, map)| (format!("d_{name}"), map.shallow_clone()));
    let (names, leaves): (Vec<String>, Vec<Tensor>) =
        learnt.chain(given).filter(|(name, _)| g.contains_key(name)).unzip();
    for (gradient, name) in gradients_along(&pairs, &leaves).iter().zip(&names) {
        assert_exact(&format!("{file} {name}"), gradient, &g[name]);
    }
    names.len()
}

#[test]
fn design_a_is_the_reference() {
    let taps = ["tap.p3.topdown", "tap.p4.topdown"];
    let gradients = check("msfe_a", design_a(), &["c3", "c4", "c5"], &["out3", "out4", "out5"], &taps);
    assert_eq!(gradients, 5 + 3, "five parameters and the inputs");
}

#[test]
fn design_b_is_the_reference() {
    let parameters = design_b().parameters.len();
    let gradients = check("msfe_b", design_b(), &["c3", "c4", "c5", "f"], &["out"], &[]);
    assert_eq!(gradients, parameters + 4, "all parameters and the inputs");
}

#[test]
fn design_c_is_the_reference() {
    let parameters = design_c().parameters.len();
    let gradients = check("msfe_c", design_c(), &["c3", "c4", "c5"], &["out3", "out4", "out5"], &[]);
    assert_eq!(gradients, parameters + 3, "all parameters and the inputs");
}

#[test]
fn weights_of_the_wrong_shape_are_refused() {
    let graph = design_a();
    let mut weights = initial_weights(&graph, 0);
    weights.tensors.insert("p3.lat.weight".into(), WeightTensor { shape: vec![1], values: vec![0.0] });
    let error = Network::new(graph, &weights, Device::Cpu, Precision::F32).unwrap_err();
    assert_eq!(error.to_string(), "tensor \"p3.lat.weight\" has shape [1]; the network expects [32, 16, 1, 1]");
}

//! The whole network against reference tensors computed in double precision.

use crate::golden_support::{Golden, assert_close, assert_close_relative, golden};
use farsight_methods::smoke::codec::Codec;
use farsight_methods::smoke::targets::ObjectTarget;
use farsight_core::{Box3d, Camera, Dimensions};
use farsight_graph::layers::network;
use farsight_methods::smoke::config::{SmokeConfig, Msfe, NeckKind, NormKind};
use farsight_graph::count::{count, total};
use farsight_graph::graph::{LOGITS, REGRESSION};
use farsight_graph::init::initial_weights;
use farsight_graph::weights::Weights;
use farsight_train::executor::{Mode, Network, Precision, values_from_tensor, weight_from_tensor};
use farsight_train::loss::{BatchTargets, CornerWeights, RegressionCell, focal_loss, loss};
use tch::{Device, Tensor, no_grad};

/// Tolerances of the reference's own README.
const NECK_GROUP: f64 = 2e-4;
const NECK_BATCH: f64 = 1e-3;
const TINY: f64 = 1e-3;
const GRADIENT: f64 = 1e-3;
const LOSS: f64 = 1e-4;

fn tiny_config(norm: NormKind) -> SmokeConfig {
    SmokeConfig {
        level_channels: Some([16, 16, 32, 48, 64, 80]),
        head_channels: Some(32),
        norm,
        ..SmokeConfig::default()
    }
}

fn full_config(norm: NormKind) -> SmokeConfig {
    SmokeConfig { norm, ..SmokeConfig::default() }
}

/// The network of `config` with the reference's weights; statistics of norms that no forward pass uses stay as they start.
fn golden_network(config: &SmokeConfig, files: &[&Golden]) -> Network {
    let graph = network(config);
    let mut weights: Weights = initial_weights(&graph, 0);
    for (name, tensor) in files.iter().flat_map(|file| file.iter()) {
        if weights.tensors.contains_key(name) {
            weights.tensors.insert(name.clone(), weight_from_tensor(tensor));
        }
    }
    Network::new(graph, &weights, Device::Cpu, Precision::F32).unwrap()
}

fn check_taps(network: &Network, io: &Golden, tolerance: f64) {
    let names = [
        "base_layer",
        "level0",
        "level1",
        "level2",
        "level3",
        "level4",
        "level5",
        "dla_up_s16",
        "dla_up_s8",
        "dla_up_s4",
    ];
    let names = names.into_iter().chain(["ida_up_1", "neck", LOGITS, REGRESSION]).filter(|name| io.contains_key(*name));
    let names: Vec<&str> = names.collect();
    assert!(names.len() >= 10);
    let taps: Vec<usize> = names.iter().map(|name| network.graph().tap(name).unwrap()).collect();
    let maps = no_grad(|| network.forward(&io["input"], Mode::Evaluate, &taps));
    for (name, map) in names.iter().zip(&maps) {
        assert_close(name, map, &io[*name], tolerance);
    }
}

#[test]
fn full_network_with_group_norm() {
    let (Some(weights), Some(io)) = (golden("net_full_weights"), golden("net_full_io_gn")) else { return };
    check_taps(&golden_network(&full_config(NormKind::Group), &[&weights]), &io, NECK_GROUP);
}

#[test]
fn full_network_with_batch_norm() {
    let (Some(weights), Some(stats), Some(io)) =
        (golden("net_full_weights"), golden("net_full_bn_stats"), golden("net_full_io_bn"))
    else {
        return;
    };
    check_taps(&golden_network(&full_config(NormKind::Batch), &[&weights, &stats]), &io, NECK_BATCH);
}

#[test]
fn tiny_network_with_both_norms() {
    for (norm, file) in [(NormKind::Group, "net_tiny_io_gn"), (NormKind::Batch, "net_tiny_io_bn")] {
        let (Some(weights), Some(io)) = (golden("net_tiny_weights"), golden(file)) else { return };
        check_taps(&golden_network(&tiny_config(norm), &[&weights]), &io, TINY);
    }
}

#[test]
fn every_reference_weight_has_a_place() {
    let Some(weights) = golden("net_full_weights") else { return };
    let graph = network(&full_config(NormKind::Group));
    let ours: Vec<&str> = graph.parameters.iter().map(|p| p.name.as_str()).collect();
    assert_eq!(ours.len(), weights.len());
    assert!(weights.keys().all(|name| ours.contains(&name.as_str())));
}

/// Targets of the gradient reference, in our convention: the true heading instead of the official flipped label.
fn gradient_targets(g: &Golden) -> BatchTargets {
    let column = |name: &str| values_from_tensor(&g[name]).into_iter().map(f64::from).collect::<Vec<_>>();
    let (mask, class, flip, yaw) = (column("tgt.mask"), column("tgt.cls"), column("tgt.flip"), column("tgt.ry"));
    let (cells, sizes, locations) = (column("tgt.ipt"), column("tgt.lhw"), column("tgt.loc"));
    let slots = mask.len();
    let per_image = slots / 2;
    let object = |i: usize| ObjectTarget {
        class: class[i] as usize,
        cell: [cells[2 * i] as usize, cells[2 * i + 1] as usize],
        box3d: Box3d {
            dimensions: Dimensions { length: sizes[3 * i], height: sizes[3 * i + 1], width: sizes[3 * i + 2] },
            location: [locations[3 * i], locations[3 * i + 1], locations[3 * i + 2]],
            // Officially a flipped label is -ry and the prediction is turned by pi; here the label is the true heading.
            yaw: if flip[i] > 0.0 { yaw[i] + std::f64::consts::PI } else { yaw[i] },
        },
    };
    let camera = |i: usize| {
        let (k, t_inverse) = (&column("tgt.K")[9 * i..9 * i + 9], &column("tgt.Tinv")[9 * i..9 * i + 9]);
        let scale = 1.0 / t_inverse[0];
        let map = farsight_core::Affine2 {
            matrix: [[scale, 0.0, -scale * t_inverse[2]], [0.0, scale, -scale * t_inverse[5]]],
        };
        Camera::from_intrinsics(k[0], k[4], k[2], k[5]).unwrap().transformed(&map)
    };
    let size = g["heatmap_target"].size();
    let cell = |i: usize| RegressionCell { image: i / per_image, object: object(i), share: 1.0 };
    BatchTargets {
        heat_map: g["heatmap_target"].copy(),
        cells: (0..slots).filter(|&i| mask[i] > 0.0).map(cell).collect(),
        cameras: vec![camera(0), camera(per_image)],
        map_size: [size[3] as usize, size[2] as usize],
        surface_m: None,
    }
}

#[test]
fn losses_and_gradients_of_the_tiny_network() {
    let (Some(weights), Some(io), Some(g)) =
        (golden("net_tiny_weights"), golden("net_tiny_io_gn"), golden("net_tiny_grad_gn"))
    else {
        return;
    };
    let config = tiny_config(NormKind::Group);
    let network = golden_network(&config, &[&weights]);
    let taps = [LOGITS, REGRESSION].map(|name| network.graph().tap(name).unwrap());
    let maps = network.forward(&io["input"], Mode::Train, &taps);
    let codec: Codec = config.codec();
    let (objective, terms) = loss(&codec, &maps[0], &maps[1], &gradient_targets(&g), CornerWeights::alike(80.0));
    for (name, value) in [
        ("loss_focal", terms.heat_map),
        ("loss_ori", terms.orientation),
        ("loss_dim", terms.dimensions),
        ("loss_loc", terms.location),
    ] {
        let expected = g[name].double_value(&[]);
        assert!((value - expected).abs() <= LOSS * expected.abs(), "{name}: {value} instead of {expected}");
    }
    let (names, leaves): (Vec<String>, Vec<Tensor>) =
        network.learnt().map(|(name, tensor)| (format!("grad.{name}"), tensor.shallow_clone())).unzip();
    let gradients = Tensor::run_backward(&[objective], &leaves, false, false);
    for (name, gradient) in names.iter().zip(&gradients) {
        assert_close_relative(name, gradient, &g[name], GRADIENT);
    }
}

#[test]
fn parameter_counts_are_the_published_ones() {
    let parameters = |config: &SmokeConfig| total(&count(&network(config), 1280, 384).unwrap()).parameters;
    assert_eq!(parameters(&SmokeConfig::default()), 19_510_443);
    for (msfe, added) in [(Msfe::A, 557_872), (Msfe::B, 505_904), (Msfe::C, 531_217)] {
        assert_eq!(parameters(&SmokeConfig { msfe, ..SmokeConfig::default() }), 19_510_443 + added, "{msfe:?}");
    }
}

#[test]
fn a_fresh_msfe_changes_nothing() {
    for (msfe, norm, neck) in [
        (Msfe::A, NormKind::Group, NeckKind::Deformable),
        (Msfe::B, NormKind::Batch, NeckKind::Deformable),
        (Msfe::C, NormKind::Group, NeckKind::Plain),
    ] {
        let base = SmokeConfig { width: 0.25, norm, neck, ..SmokeConfig::default() };
        let input = Tensor::rand([1, 3, 64, 96], (tch::Kind::Float, Device::Cpu));
        let answer = |config: &SmokeConfig| {
            let graph = network(config);
            let taps = [LOGITS, REGRESSION].map(|name| graph.tap(name).unwrap());
            let weights = initial_weights(&graph, 7);
            let network = Network::new(graph, &weights, Device::Cpu, Precision::F32).unwrap();
            no_grad(|| network.forward(&input, Mode::Evaluate, &taps))
        };
        let (baseline, with_msfe) = (answer(&base), answer(&SmokeConfig { msfe, ..base.clone() }));
        for (a, b) in baseline.iter().zip(&with_msfe) {
            assert_eq!(values_from_tensor(a), values_from_tensor(b), "{msfe:?}");
        }
    }
}

#[test]
fn focal_loss_has_no_gradient_where_the_probability_is_clamped() {
    let logits = Tensor::from_slice(&[20.0_f32, -20.0]).view([1, 1, 1, 2]).set_requires_grad(true);
    let gradient = Tensor::run_backward(
        &[focal_loss(&logits, &Tensor::zeros([1, 1, 1, 2], (tch::Kind::Float, Device::Cpu)))],
        &[logits],
        false,
        false,
    );
    assert_eq!(values_from_tensor(&gradient[0]), [0.0, 0.0]);
}

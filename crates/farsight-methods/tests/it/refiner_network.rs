//! The refining network and its file.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use farsight_core::{DepthFusion, ObjectClass};
use farsight_graph::graph::Graph;
use farsight_graph::init::initial_weights;
use farsight_graph::layers::NormKind;
use farsight_graph::model::{ModelError, NetworkConfig};
use farsight_methods::refiner::geometry::{
    Evidence, FusedScoreExample, FusedScores, INPUT_CHANNELS, OUTPUT_CHANNELS, StageFusion,
};
use farsight_methods::refiner::{RefinerConfig, RefinerModel};
use farsight_methods::roi::{ANSWER, RoiBackbone};
use farsight_methods::smoke::SmokeConfig;
use farsight_methods::smoke::network::Backbone;

fn small() -> RefinerConfig {
    RefinerConfig { side: 32, channels: [8; 4], hidden: 16, ..RefinerConfig::default() }
}

fn mobilenet() -> RefinerConfig {
    RefinerConfig { backbone: RoiBackbone::MobilenetV2, ..small() }
}

fn model(config: RefinerConfig) -> RefinerModel {
    let weights = initial_weights(&config.graph(), 1);
    RefinerModel::new(config, weights).unwrap()
}

/// Some fit.
fn scores() -> FusedScores {
    let evidence = |i: u32| Evidence { score: 0.5, kind: f64::from(i % 7) - 3.0, overlap: 0.8 };
    let example =
        |i: u32| FusedScoreExample { class: ObjectClass::Car, evidence: evidence(i), is_right: i % 7 + i % 3 > 4 };
    let examples: Vec<FusedScoreExample> = (0..420).map(example).collect();
    FusedScores::fit(&examples, &[ObjectClass::Car, ObjectClass::Van]).unwrap()
}

#[test]
fn one_answer_comes_out_of_a_cut_out_of_any_size_that_is_allowed() {
    for (side, hidden) in [(16, 4), (96, 192), (160, 32)] {
        let config = RefinerConfig { side, hidden, ..RefinerConfig::default() };
        assert_eq!(config.problem(), None);
        let graph = config.graph();
        assert_eq!(graph.nodes[0].channels, INPUT_CHANNELS);
        let shapes = graph.shapes(side, side).unwrap();
        assert_eq!(shapes[graph.tap(ANSWER).unwrap()], [OUTPUT_CHANNELS, 1, 1], "{side} pixels");
    }
}

#[test]
fn a_mobilenet_reads_crops_of_multiples_of_its_stride() {
    for side in [32, 96, 128] {
        let config = RefinerConfig { side, ..mobilenet() };
        assert_eq!(config.problem(), None);
        let graph = config.graph();
        assert_eq!(graph.nodes[0].channels, INPUT_CHANNELS);
        let shapes = graph.shapes(side, side).unwrap();
        assert_eq!(shapes[graph.tap(ANSWER).unwrap()], [OUTPUT_CHANNELS, 1, 1], "{side} pixels");
    }
    let problem = RefinerConfig { side: 48, ..mobilenet() }.problem().unwrap();
    assert!(problem.contains("model.side is 48; expected a multiple of 32"), "{problem}");
}

/// Weights of ImageNet go into a refiner by their names.
#[test]
fn a_mobilenet_has_the_names_of_the_backbone_of_detectors() {
    let detector = SmokeConfig { backbone: Backbone::MobilenetV2, norm: NormKind::Batch, ..SmokeConfig::default() };
    let body = |graph: &Graph| -> BTreeMap<String, Vec<usize>> {
        let named = graph.parameters.iter().map(|parameter| (parameter.name.clone(), parameter.shape.clone()));
        named.filter(|(name, _)| name.starts_with("backbone.body.")).collect()
    };
    let (of_refiner, of_detector) = (body(&mobilenet().graph()), body(&detector.graph()));
    assert!(!of_refiner.is_empty());
    assert_eq!(of_refiner, of_detector);
}

/// The header of a file without the choice is that of before, so its seal still holds.
#[test]
fn what_was_no_choice_before_is_not_named() {
    let written = serde_json::to_string(&small()).unwrap();
    assert!(!written.contains("backbone") && !written.contains("alone") && !written.contains("people"), "{written}");
    assert!(serde_json::to_string(&mobilenet()).unwrap().contains("\"backbone\":\"mobilenet_v2\""));
}

#[test]
fn a_config_of_no_network_is_told() {
    let depths = DepthFusion { correlation: 1.5, ..DepthFusion::default() };
    let fusion = StageFusion { depths, ..StageFusion::default() };
    for (config, expected) in [
        (RefinerConfig { side: 90, ..small() }, "model.side is 90"),
        (RefinerConfig { side: 0, ..small() }, "model.side is 0"),
        (RefinerConfig { channels: [8, 0, 8, 8], ..small() }, "has 0; expected 1 to 4096"),
        (RefinerConfig { hidden: 0, ..small() }, "has 0; expected 1 to 4096"),
        (RefinerConfig { fusion, ..small() }, "model.fusion is"),
    ] {
        let problem = config.problem().unwrap();
        assert!(problem.contains(expected), "{problem}");
    }
}

#[test]
fn a_file_gives_back_what_was_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("refiner.safetensors");
    let depths = DepthFusion {
        depth_factor: 1.01,
        error_factor: 1.2,
        correlation: 0.4,
        joint_error_factor: 0.9,
        joint_error_power: 1.4,
        interval_sigmas: [0.6, 1.8],
        is_second_alone: true,
    };
    let fusion = StageFusion { depths, people_error_factor: 1.7, scores: scores(), ..StageFusion::default() };
    let written = model(RefinerConfig { fusion, ..small() });
    written.write_half(&path).unwrap();
    assert!(RefinerModel::is_one(&path));
    let read = RefinerModel::read(&path).unwrap();
    assert_eq!(read.config, written.config);
    for (name, tensor) in &written.weights.tensors {
        let found = &read.weights.tensors[name];
        let near = |(a, b): (&f32, &f32)| (a - b).abs() <= 1e-3 * a.abs() + 1e-6;
        assert!(tensor.shape == found.shape && tensor.values.iter().zip(&found.values).all(near), "{name}");
    }
    let onnx = farsight_methods::roi::runner::onnx(&read, farsight_onnx::Target::Portable, &path).unwrap();
    assert_eq!(onnx.channels(ANSWER), Some(OUTPUT_CHANNELS));
}

#[test]
fn a_file_that_is_no_refiner_is_told_with_its_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("other.safetensors");
    let error = |path: &Path| RefinerModel::read(path).unwrap_err();
    model(small()).weights.write(&path).unwrap();
    assert!(!RefinerModel::is_one(&path));
    let told = error(&path);
    assert!(matches!(told, ModelError::NoConfig { .. }), "{told:?}");
    assert!(told.to_string().contains("other.safetensors") && told.to_string().contains("a refiner"), "{told}");

    let mut missing = model(small());
    missing.weights.tensors.remove("stem.conv.weight");
    missing.write(&path).unwrap();
    assert!(error(&path).to_string().contains("stem.conv.weight"));

    let mut wrong = model(small());
    wrong.config.hidden = 32;
    wrong.write(&path).unwrap();
    assert!(error(&path).to_string().contains("whole.conv.weight"));

    fs::write(&path, b"no tensors").unwrap();
    assert!(error(&path).to_string().contains("other.safetensors"));
}

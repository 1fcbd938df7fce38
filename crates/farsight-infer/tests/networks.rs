//! Networks written as ONNX and run by rten, against each other and against reference tensors computed in double precision.
#![cfg(feature = "rten")]
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "the helpers of a test may panic and say that they were skipped"
)]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use farsight_core::detection::{DecodeOptions, raw_regression};
use farsight_core::{Camera, HeadMaps};
use farsight_data::read_image;
use farsight_infer::{Detector, DetectorSpec, Engine, PeaksHead, RtenEngine};
use farsight_net::build::network;
use farsight_net::config::{Backbone, ModelConfig, Msfe, NeckKind, NormKind};
use farsight_net::graph::{LOGITS, Op, REGRESSION};
use farsight_net::init::initial_weights;
use farsight_net::model::Model;
use farsight_net::onnx::{Facts, OnnxModel, PeaksOnly, Target, write};
use farsight_net::transform::Network;
use farsight_net::weights::{WeightTensor, Weights};
use image::RgbImage;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Rounding of single precision over 60 layers, as a share of the largest value of a map: networks with drawn weights answer with any size.
const RELATIVE: f32 = 1e-5;

/// The same for `MobileNetV2`, whose blocks end without an activation: their drawn sums are much larger than the answers.
const RELATIVE_MOBILE: f32 = 5e-5;

/// Tolerance of the reference's own README for the raw heads.
const GOLDEN_GROUP: f32 = 1e-4;
const GOLDEN_BATCH: f32 = 1e-3;

/// A network whose norms have seen something: all statistics and affine terms are drawn.
fn lively(config: ModelConfig) -> Model {
    let graph = network(&config);
    let mut weights = initial_weights(&graph, 3);
    let mut rng = Pcg64Mcg::seed_from_u64(11);
    for (name, tensor) in &mut weights.tensors {
        let ends = |suffix: &str| name.ends_with(suffix);
        for value in &mut tensor.values {
            if ends("running_var") || (ends("norm.weight") || tensor.shape.len() == 1 && ends(".weight")) {
                *value = rng.random_range(0.5..1.5);
            } else if tensor.shape.len() == 1 {
                *value = rng.random_range(-0.3..0.3);
            } else if ends("conv_offset_mask.weight") {
                *value = rng.random_range(-0.05..0.05);
            }
        }
    }
    Model::new(config, weights).unwrap()
}

fn input(size: [usize; 2]) -> Vec<f32> {
    let mut rng = Pcg64Mcg::seed_from_u64(5);
    (0..3 * size[0] * size[1]).map(|_| rng.random_range(-2.0..2.0)).collect()
}

fn engine(network: &Network, model: &Model, target: Target) -> RtenEngine {
    let bytes = write(network, &Facts::new(model, target), target).unwrap();
    RtenEngine::new(OnnxModel::from_bytes(bytes, Path::new("in memory")).unwrap(), Some(1)).unwrap()
}

fn difference(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[track_caller]
fn assert_same(what: &str, a: &HeadMaps, b: &HeadMaps) {
    assert_within(RELATIVE, what, a, b);
}

#[track_caller]
fn assert_within(relative: f32, what: &str, a: &HeadMaps, b: &HeadMaps) {
    assert_eq!(a.map_size, b.map_size, "{what}");
    for (name, a, b) in [(LOGITS, &a.logits, &b.logits), (REGRESSION, &a.regression, &b.regression)] {
        let tolerance = relative * a.iter().fold(0.0_f32, |largest, value| largest.max(value.abs()));
        let largest = difference(a, b);
        assert!(largest <= tolerance, "{what}: {name} differs by {largest:e}, tolerance {tolerance:e}");
    }
}

fn small(norm: NormKind, neck: NeckKind, msfe: Msfe) -> ModelConfig {
    ModelConfig { input: [96, 64], width: 0.25, norm, neck, msfe, ..ModelConfig::default() }
}

#[test]
fn folding_changes_nothing_but_the_node_count() {
    for msfe in [Msfe::None, Msfe::A, Msfe::B, Msfe::C] {
        for neck in [NeckKind::Plain, NeckKind::Deformable] {
            for backbone in [Backbone::Dla34, Backbone::MobilenetV2, Backbone::MobilenetV2Tensorflow] {
                let model = lively(ModelConfig { backbone, ..small(NormKind::Batch, neck, msfe) });
                let whole = Network::new(&model).keeping(&[LOGITS, REGRESSION]);
                let folded = whole.clone().batch_norm_folded().unwrap();
                let norms = |network: &Network| {
                    network.graph.nodes.iter().filter(|node| matches!(node.op, Op::BatchNorm { .. })).count()
                };
                assert!(norms(&whole) > 40);
                // The scale of TensorFlow's image has no convolution before it.
                let left = usize::from(backbone == Backbone::MobilenetV2Tensorflow);
                assert_eq!(norms(&folded), left, "{backbone:?} {msfe:?} {neck:?}");
                let image = input([96, 64]);
                let maps = [&whole, &folded]
                    .map(|network| engine(network, &model, Target::Portable).head_maps(&image, [96, 64]).unwrap());
                assert!(
                    maps[0].regression.iter().any(|value| value.abs() > 0.05),
                    "maps of a dead network prove nothing"
                );
                let relative = if backbone == Backbone::Dla34 { RELATIVE } else { RELATIVE_MOBILE };
                assert_within(relative, &format!("{backbone:?} {msfe:?} {neck:?}"), &maps[0], &maps[1]);
            }
        }
    }
}

#[test]
fn one_file_takes_every_input_size() {
    let model = lively(small(NormKind::Group, NeckKind::Deformable, Msfe::A));
    let mut engine = engine(&Network::deployable(&model).unwrap(), &model, Target::Portable);
    for size in [[96, 64], [128, 96], [32, 32], [96, 64]] {
        let maps = engine.head_maps(&input(size), size).unwrap();
        assert_eq!(maps.map_size, size.map(|side| side / 4));
        assert_eq!(maps.regression.len(), 8 * maps.map_size[0] * maps.map_size[1]);
    }
}

#[test]
fn an_image_has_the_same_maps_alone_and_in_a_batch() {
    let size = [96, 64];
    let model = lively(small(NormKind::Group, NeckKind::Deformable, Msfe::A));
    let mut engine = engine(&Network::deployable(&model).unwrap(), &model, Target::Portable);
    let first = input(size);
    let second: Vec<f32> = first.iter().rev().copied().collect();
    let together = engine.batch_head_maps(&[first.clone(), second.clone()].concat(), size).unwrap();
    assert_eq!(together.len(), 2);
    for (image, maps) in [first, second].iter().zip(&together) {
        assert_same("alone and in a batch", &engine.head_maps(image, size).unwrap(), maps);
    }
    assert!(difference(&together[0].regression, &together[1].regression) > 0.01, "two images, two answers");
}

#[test]
fn rten_says_that_it_has_no_deformable_convolution() {
    let model = lively(small(NormKind::Batch, NeckKind::Deformable, Msfe::None));
    let bytes =
        write(&Network::deployable(&model).unwrap(), &Facts::new(&model, Target::OnnxRuntime), Target::OnnxRuntime);
    let onnx = OnnxModel::from_bytes(bytes.unwrap(), Path::new("m.onnx")).unwrap();
    let error = RtenEngine::new(onnx, None).err().unwrap().to_string();
    assert!(error.starts_with("the engine rten failed: ") && error.contains("DeformConv"), "{error}");
}

/// Tensors of a reference file; `None`, with a printed reason, where the folder is not there.
fn golden(name: &str) -> Option<BTreeMap<String, WeightTensor>> {
    let default = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/golden");
    let folder = std::env::var_os("FARSIGHT_GOLDEN").map_or_else(default, PathBuf::from);
    let path = folder.join(format!("{name}.safetensors"));
    if !path.is_file() {
        println!("skipped: no {} (set FARSIGHT_GOLDEN to the folder of reference tensors)", path.display());
        return None;
    }
    Some(Weights::read(&path).unwrap().tensors)
}

/// The model of `config` with the reference's weights.
fn golden_model(config: ModelConfig, files: &[&BTreeMap<String, WeightTensor>]) -> Model {
    let mut weights = initial_weights(&network(&config), 0);
    for (name, tensor) in files.iter().flat_map(|file| file.iter()) {
        weights.tensors.insert(name.clone(), tensor.clone());
    }
    Model::new(config, weights).unwrap()
}

#[track_caller]
fn check_golden(what: &str, model: &Model, io: &BTreeMap<String, WeightTensor>, tolerance: f32) {
    let &[batch, _, height, width] = &io["input"].shape[..] else { panic!("{what}: no batch of images") };
    let mut engine = engine(&Network::deployable(model).unwrap(), model, Target::Portable);
    for image in 0..batch {
        let item = |name: &str| {
            let values = &io[name].values;
            &values[values.len() / batch * image..][..values.len() / batch]
        };
        let maps = engine.head_maps(item("input"), [width, height]).unwrap();
        for (name, found) in [(LOGITS, &maps.logits), (REGRESSION, &maps.regression)] {
            let largest = difference(found, item(name));
            println!("{what}: {name} differs by {largest:e}");
            assert!(largest <= tolerance, "{what}: {name} differs by {largest:e}, tolerance {tolerance:e}");
        }
    }
}

#[test]
fn reference_networks_give_the_reference_maps() {
    for (norm, io_name, tolerance) in
        [(NormKind::Group, "net_full_io_gn", GOLDEN_GROUP), (NormKind::Batch, "net_full_io_bn", GOLDEN_BATCH)]
    {
        let (Some(weights), Some(statistics), Some(io)) =
            (golden("net_full_weights"), golden("net_full_bn_stats"), golden(io_name))
        else {
            return;
        };
        let model = golden_model(ModelConfig { norm, ..ModelConfig::default() }, &[&weights, &statistics]);
        check_golden(io_name, &model, &io, tolerance);
    }
}

#[test]
fn tiny_reference_networks_give_the_reference_maps() {
    for (norm, io_name) in [(NormKind::Group, "net_tiny_io_gn"), (NormKind::Batch, "net_tiny_io_bn")] {
        let (Some(weights), Some(io)) = (golden("net_tiny_weights"), golden(io_name)) else { return };
        let config = ModelConfig {
            level_channels: Some([16, 16, 32, 48, 64, 80]),
            head_channels: Some(32),
            norm,
            ..ModelConfig::default()
        };
        check_golden(io_name, &golden_model(config, &[&weights]), &io, GOLDEN_BATCH);
    }
}

/// The network cut before its regression head, with that head; the model must have batch norm.
fn cut(model: &Model) -> (RtenEngine, PeaksHead) {
    let whole = OnnxModel::from_model(model, Target::Portable, Path::new("in memory")).unwrap();
    let cut = PeaksOnly::new(&whole, Path::new("in memory")).unwrap().unwrap();
    assert!(cut.model.bytes().len() < whole.bytes().len(), "the head's weights are still in the network");
    let head = PeaksHead::new(&cut);
    (RtenEngine::new(cut.model, Some(1)).unwrap(), head)
}

#[test]
fn the_head_at_single_cells_equals_the_dense_head() {
    for msfe in [Msfe::None, Msfe::B] {
        let model = lively(small(NormKind::Batch, NeckKind::Plain, msfe));
        let size = [96, 64];
        let dense = engine(&Network::deployable(&model).unwrap(), &model, Target::Portable)
            .head_maps(&input(size), size)
            .unwrap();
        let (mut engine, head) = cut(&model);
        let features = engine.head_maps(&input(size), size).unwrap();
        assert_eq!(features.logits, dense.logits);
        let [width, height] = dense.map_size;
        assert_eq!(features.regression.len(), head.channels() * width * height);
        let scale = dense.regression.iter().fold(0.0_f32, |largest, value| largest.max(value.abs()));
        for cell in (0..width * height).map(|at| [at % width, at / width]) {
            let at_cell = head.regression(&features.regression, features.map_size, cell);
            for (found, expected) in at_cell.iter().zip(raw_regression(&dense, cell)) {
                assert!(
                    (found - expected).abs() <= f64::from(RELATIVE * scale),
                    "{msfe:?} {cell:?}: {found} {expected}"
                );
            }
        }
    }
}

#[test]
fn a_head_with_group_norm_cannot_be_cut_off() {
    let model = lively(small(NormKind::Group, NeckKind::Plain, Msfe::None));
    let whole = OnnxModel::from_model(&model, Target::Portable, Path::new("in memory")).unwrap();
    assert_eq!(PeaksOnly::new(&whole, Path::new("in memory")).unwrap(), None);
}

/// Noise, and real frames where they are at hand.
fn images() -> Vec<RgbImage> {
    let mut rng = Pcg64Mcg::seed_from_u64(2);
    let mut images = vec![RgbImage::from_fn(640, 192, |_, _| image::Rgb(std::array::from_fn(|_| rng.random())))];
    let default = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/kitti");
    let folder = std::env::var_os("FARSIGHT_KITTI").map_or_else(default, PathBuf::from).join("frames/training/image_2");
    let mut paths: Vec<PathBuf> =
        std::fs::read_dir(&folder).into_iter().flatten().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    if paths.is_empty() {
        println!("real frames skipped: no {} (set FARSIGHT_KITTI)", folder.display());
    }
    images.extend(paths.iter().take(3).map(|path| read_image(path).unwrap()));
    images
}

#[test]
fn detections_at_the_peaks_are_those_of_the_dense_head() {
    let model = lively(ModelConfig { input: [640, 192], ..small(NormKind::Batch, NeckKind::Plain, Msfe::A) });
    // All scores, so that there is something to compare whatever the weights are.
    let spec = DetectorSpec::new(&model.config, DecodeOptions { min_score: Some(0.0), max_detections: 50 });
    let dense = engine(&Network::deployable(&model).unwrap(), &model, Target::Portable);
    let mut dense = Detector::new(Box::new(dense), spec.clone());
    let (engine, head) = cut(&model);
    let mut peaks = Detector::with_peaks_head(Box::new(engine), spec, head);
    let camera = Camera::from_hfov(80.0, 1242, 375).unwrap();
    for image in images() {
        let [dense, peaks] = [&mut dense, &mut peaks].map(|detector| detector.detect(&image, &camera).unwrap());
        assert!(dense.len() > 10, "{} detections prove little", dense.len());
        assert_eq!(dense.len(), peaks.len());
        for (a, b) in dense.iter().zip(&peaks) {
            assert_eq!((&a.class, a.score), (&b.class, b.score));
            for (a, b) in a.box3d.location.iter().zip(b.box3d.location) {
                assert!((a - b).abs() <= 1e-4 * a.abs().max(1.0), "{a} {b}");
            }
        }
    }
}

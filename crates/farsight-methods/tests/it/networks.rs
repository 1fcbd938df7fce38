//! Networks written as ONNX and run by rten, against each other and against reference tensors computed in double
//! precision.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use farsight_core::Camera;
use farsight_core::detection::DecodeOptions;
use farsight_data::read_image;
use farsight_graph::graph::{Node, Op};
use farsight_graph::init::initial_weights;
use farsight_graph::layers::{Msfe, NeckKind, NormKind};
use farsight_graph::model::NetworkConfig;
use farsight_graph::transform::Network;
use farsight_graph::weights::WeightTensor;
use farsight_methods::Detector;
use farsight_methods::smoke::SmokeConfig;
use farsight_methods::smoke::SmokeModel;
use farsight_methods::smoke::decode::raw_regression;
use farsight_methods::smoke::network::Backbone;
use farsight_methods::smoke::{DetectorFile, HeadMaps, SmokeDetector, SparseHead};
use farsight_methods::smoke::{LOGITS, REGRESSION};
use farsight_onnx::{Facts, LocalHeadFile, OnnxModel, Step, Target, write};
use farsight_runtime::RtenRunner;
use farsight_testing::{Array, Golden, kitti};
use image::RgbImage;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::support::{batch_head_maps, head_maps};

/// Rounding of single precision over 60 layers, as a share of the largest value of a map: networks with drawn weights
/// answer with any size.
const RELATIVE: f32 = 1e-5;

/// What rounds alike moves a map by so many times what the last bit of the image does: networks with drawn weights
/// enlarge both, each by as much as it likes.
const LAST_BITS: f32 = 5.0;

/// Tolerance of the reference's own README for the raw heads.
const GOLDEN_GROUP: f32 = 1e-4;
const GOLDEN_BATCH: f32 = 1e-3;

/// Tensors of a reference file by name.
type Tensors = BTreeMap<String, WeightTensor>;

/// A network whose norms have seen something: all statistics and affine terms are drawn.
fn lively(config: SmokeConfig) -> SmokeModel {
    let graph = config.graph();
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
    SmokeModel::new(config, weights).unwrap()
}

fn input(size: [usize; 2]) -> Vec<f32> {
    let mut rng = Pcg64Mcg::seed_from_u64(5);
    (0..3 * size[0] * size[1]).map(|_| rng.random_range(-2.0..2.0)).collect()
}

fn engine(network: &Network, model: &SmokeModel, target: Target) -> RtenRunner {
    let bytes = write(network, &Facts::new(model, target), target).unwrap();
    RtenRunner::new(OnnxModel::from_bytes(bytes, Path::new("in memory")).unwrap(), Some(1)).unwrap()
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

fn small(norm: NormKind, neck: NeckKind, msfe: Msfe) -> SmokeConfig {
    SmokeConfig { input: [96, 64], width: 0.25, norm, neck, msfe, ..SmokeConfig::default() }
}

#[test]
fn folding_changes_nothing_but_the_node_count() {
    for msfe in [Msfe::None, Msfe::A, Msfe::B, Msfe::C] {
        for neck in [NeckKind::Plain, NeckKind::Deformable] {
            for backbone in [
                Backbone::Dla34,
                Backbone::MobilenetV2,
                Backbone::MobilenetV2Tensorflow,
                Backbone::EfficientnetLite2,
                Backbone::Resnet18,
                Backbone::Vgg16,
            ] {
                let model = lively(SmokeConfig { backbone, ..small(NormKind::Batch, neck, msfe) });
                let whole = Network::new(&model).with_outputs(&[LOGITS, REGRESSION]);
                let folded = whole.clone().batch_norm_folded().unwrap();
                let norms = |network: &Network| {
                    network.graph.nodes.iter().filter(|node| matches!(node.op, Op::BatchNorm { .. })).count()
                };
                assert!(norms(&whole) > 20);
                // The scale of TensorFlow's image has no convolution before it.
                let has_a_scale = [Backbone::MobilenetV2Tensorflow, Backbone::EfficientnetLite2].contains(&backbone);
                let left = usize::from(has_a_scale);
                assert_eq!(norms(&folded), left, "{backbone:?} {msfe:?} {neck:?}");
                let image = input([96, 64]);
                let maps = [&whole, &folded]
                    .map(|network| head_maps(&mut engine(network, &model, Target::Portable), &image, [96, 64]));
                assert!(
                    maps[0].regression.iter().any(|value| value.abs() > 0.05),
                    "maps of a dead network prove nothing"
                );
                let nudged: Vec<f32> =
                    image.chunks(2).flat_map(|pair| [pair[0].next_up(), pair[1].next_down()]).collect();
                let [plain, folded] = maps;
                let nudged = head_maps(&mut engine(&whole, &model, Target::Portable), &nudged, [96, 64]);
                for map in [|maps: &HeadMaps| maps.logits.clone(), |maps: &HeadMaps| maps.regression.clone()] {
                    let [plain, folded, nudged] = [&plain, &folded, &nudged].map(map);
                    let (differs, tolerance) = (difference(&plain, &folded), LAST_BITS * difference(&plain, &nudged));
                    assert!(
                        differs <= tolerance,
                        "{backbone:?} {msfe:?} {neck:?}: {differs:e}, tolerance {tolerance:e}"
                    );
                }
            }
        }
    }
}

/// rten would be slower, and nothing else would show it.
#[test]
fn all_convolutions_are_steps_of_their_own() {
    for backbone in [Backbone::Dla34, Backbone::MobilenetV2Tensorflow, Backbone::Resnet18] {
        let model = lively(SmokeConfig { backbone, ..small(NormKind::Batch, NeckKind::Plain, Msfe::A) });
        let network = Network::deployable(&model).unwrap();
        let is_convolution = |node: &&Node| matches!(node.op, Op::Conv { .. } | Op::UpConv { .. });
        let convolutions = network.graph.nodes.iter().filter(is_convolution).count();
        let bytes = write(&network, &Facts::new(&model, Target::Portable), Target::Portable).unwrap();
        let onnx = OnnxModel::from_bytes(bytes, Path::new("in memory")).unwrap();
        let steps = onnx.steps(Path::new("in memory")).unwrap();
        let taken = steps.iter().filter(|step| matches!(step, Step::Convolution(_))).count();
        assert_eq!(taken, convolutions, "{backbone:?}");
        assert!(convolutions > 10);
    }
}

#[test]
fn one_file_takes_every_input_size() {
    let model = lively(small(NormKind::Group, NeckKind::Deformable, Msfe::A));
    let mut engine = engine(&Network::deployable(&model).unwrap(), &model, Target::Portable);
    for size in [[96, 64], [128, 96], [32, 32], [96, 64]] {
        let maps = head_maps(&mut engine, &input(size), size);
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
    let together = batch_head_maps(&mut engine, &[first.clone(), second.clone()].concat(), size);
    assert_eq!(together.len(), 2);
    for (image, maps) in [first, second].iter().zip(&together) {
        assert_same("alone and in a batch", &head_maps(&mut engine, image, size), maps);
    }
    assert!(difference(&together[0].regression, &together[1].regression) > 0.01, "two images, two answers");
}

#[test]
fn rten_says_that_it_has_no_deformable_convolution() {
    let model = lively(small(NormKind::Batch, NeckKind::Deformable, Msfe::None));
    let bytes =
        write(&Network::deployable(&model).unwrap(), &Facts::new(&model, Target::OnnxRuntime), Target::OnnxRuntime);
    let onnx = OnnxModel::from_bytes(bytes.unwrap(), Path::new("m.onnx")).unwrap();
    let error = RtenRunner::new(onnx, None).err().unwrap().to_string();
    assert!(error.starts_with("the engine rten failed: ") && error.contains("DeformConv"), "{error}");
}

/// A reference file as weights.
fn tensors(golden: &Golden) -> Tensors {
    let tensor = |array: &Array| WeightTensor { shape: array.shape.clone(), values: array.to_f32() };
    golden.iter().map(|(name, array)| (name.to_owned(), tensor(array))).collect()
}

/// A committed reference file.
fn golden(name: &str) -> Tensors {
    tensors(&Golden::open(name))
}

/// A reference file that is too large to be committed; `None` where it is not there.
fn large_golden(name: &str) -> Option<Tensors> {
    Golden::open_large(name).as_ref().map(tensors)
}

/// The model of `config` with the reference's weights.
fn golden_model(config: SmokeConfig, files: &[&Tensors]) -> SmokeModel {
    let mut weights = initial_weights(&config.graph(), 0);
    for (name, tensor) in files.iter().flat_map(|file| file.iter()) {
        weights.tensors.insert(name.clone(), tensor.clone());
    }
    SmokeModel::new(config, weights).unwrap()
}

#[track_caller]
fn check_golden(what: &str, model: &SmokeModel, io: &Tensors, tolerance: f32) {
    let &[batch, _, height, width] = &io["input"].shape[..] else { panic!("{what}: no batch of images") };
    let mut engine = engine(&Network::deployable(model).unwrap(), model, Target::Portable);
    for image in 0..batch {
        let item = |name: &str| {
            let values = &io[name].values;
            &values[values.len() / batch * image..][..values.len() / batch]
        };
        let maps = head_maps(&mut engine, item("input"), [width, height]);
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
            (large_golden("net_full_weights"), large_golden("net_full_bn_stats"), large_golden(io_name))
        else {
            return;
        };
        let model = golden_model(SmokeConfig { norm, ..SmokeConfig::default() }, &[&weights, &statistics]);
        check_golden(io_name, &model, &io, tolerance);
    }
}

#[test]
fn tiny_reference_networks_give_the_reference_maps() {
    let weights = golden("net_tiny_weights");
    for (norm, io_name) in [(NormKind::Group, "net_tiny_io_gn"), (NormKind::Batch, "net_tiny_io_bn")] {
        let config = SmokeConfig {
            level_channels: Some([16, 16, 32, 48, 64, 80]),
            head_channels: Some(32),
            norm,
            ..SmokeConfig::default()
        };
        check_golden(io_name, &golden_model(config, &[&weights]), &golden(io_name), GOLDEN_BATCH);
    }
}

/// The network cut before its regression head, with that head; the model must have batch norm.
fn cut(model: &SmokeModel) -> (RtenRunner, SparseHead) {
    let whole = DetectorFile::from_model(model, Target::Portable, Path::new("in memory")).unwrap().onnx;
    let cut = LocalHeadFile::new(&whole, REGRESSION, Path::new("in memory")).unwrap().unwrap();
    assert!(cut.model.bytes().len() < whole.bytes().len(), "the head's weights are still in the network");
    let head = SparseHead::new(&cut);
    (RtenRunner::new(cut.model, Some(1)).unwrap(), head)
}

#[test]
fn the_head_at_single_cells_equals_the_dense_head() {
    for msfe in [Msfe::None, Msfe::B] {
        let model = lively(small(NormKind::Batch, NeckKind::Plain, msfe));
        let size = [96, 64];
        let mut dense = engine(&Network::deployable(&model).unwrap(), &model, Target::Portable);
        let dense = head_maps(&mut dense, &input(size), size);
        let (mut engine, head) = cut(&model);
        let features = head_maps(&mut engine, &input(size), size);
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
    let whole = DetectorFile::from_model(&model, Target::Portable, Path::new("in memory")).unwrap().onnx;
    assert_eq!(LocalHeadFile::new(&whole, REGRESSION, Path::new("in memory")).unwrap(), None);
}

/// Noise, and real frames where they are at hand.
fn images() -> Vec<RgbImage> {
    let mut rng = Pcg64Mcg::seed_from_u64(2);
    let mut images = vec![RgbImage::from_fn(640, 192, |_, _| image::Rgb(std::array::from_fn(|_| rng.random())))];
    let frames = kitti("frames/training/image_2");
    let entries = frames.into_iter().flat_map(|frames| std::fs::read_dir(frames).unwrap());
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    images.extend(paths.iter().take(3).map(|path| read_image(path).unwrap()));
    images
}

#[test]
fn detections_at_the_peaks_are_those_of_the_dense_head() {
    let model = lively(SmokeConfig { input: [640, 192], ..small(NormKind::Batch, NeckKind::Plain, Msfe::A) });
    // All scores, so that there is something to compare whatever the weights are.
    let options = DecodeOptions { min_score: Some(0.0), ..DecodeOptions::default() };
    let dense = engine(&Network::deployable(&model).unwrap(), &model, Target::Portable);
    let mut dense = SmokeDetector::new(Box::new(dense), &model.config, None);
    let (engine, head) = cut(&model);
    let mut peaks = SmokeDetector::new(Box::new(engine), &model.config, Some(head));
    let camera = Camera::from_hfov(80.0, 1242, 375).unwrap();
    for image in images() {
        let [dense, peaks] = [&mut dense, &mut peaks]
            .map(|detector| detector.detect_batch(&[(&image, &camera)], &options).unwrap().0.remove(0));
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

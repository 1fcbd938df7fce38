//! The shipped SSD against the program that it was made for, LiteRT (`scripts/make_ssd_fixture.py`).

use std::path::{Path, PathBuf};

use farsight_core::detection::DecodeOptions;
use farsight_core::{Camera, ObjectClass};
use farsight_graph::weights::Weights;
use farsight_methods::Detector;
use farsight_methods::detectors::{NetworkForm, from_model};
use farsight_methods::ssd::anchors::{LEVELS, cells, shapes};
use farsight_methods::ssd::config::LABELS;
use farsight_methods::ssd::network::{BOXES, CLASSES};
use farsight_methods::ssd::{SsdDetector, SsdModel};
use farsight_onnx::{INPUT, Target};
use farsight_runtime::{RtenRunner, Runner, Tensor, TensorView};

/// Largest difference: single precision both, and weights of half precision.
const TOLERANCE: f32 = 2e-3;

/// Every so many of LiteRT's anchors are kept.
const EVERY: usize = 7;

const SIDE: usize = 300;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn model() -> SsdModel {
    SsdModel::read(&root().join("models/farsight-w.safetensors")).unwrap()
}

fn runner(model: &SsdModel) -> RtenRunner {
    let network = from_model(model, NetworkForm::Deployable, Target::Portable, Path::new("in memory")).unwrap();
    RtenRunner::new(network.first.onnx, Some(1)).unwrap()
}

/// Twin of `image` in the script.
fn image() -> Vec<f32> {
    let value = |k: usize| 2.0 * (0.37 * k as f64).sin() * (0.0011 * k as f64).cos();
    (0..3 * SIDE * SIDE).map(|k| value(k) as f32).collect()
}

/// The numbers of each anchor in LiteRT's order: level by level, row by row, cell by cell, anchor by anchor.
fn anchors(outputs: &[Tensor], runner: &RtenRunner, names: [&str; LEVELS], each: usize) -> Vec<Vec<f32>> {
    let mut all = Vec::new();
    for (level, name) in names.into_iter().enumerate() {
        let map = &outputs[runner.outputs().iter().position(|output| output.name == name).unwrap()];
        let [rows, columns] = [map.shape[2], map.shape[3]];
        for cell in 0..rows * columns {
            for anchor in 0..shapes(level).len() {
                let at = |part: usize| map.values[(anchor * each + part) * rows * columns + cell];
                all.push((0..each).map(at).collect());
            }
        }
    }
    all
}

#[test]
fn the_network_answers_as_litert_does() {
    let model = model();
    let mut runner = runner(&model);
    let (image, shape) = (image(), [1, 3, SIDE, SIDE]);
    let outputs = runner.run(&[(INPUT, TensorView { shape: &shape, values: &image })]).unwrap();
    let stored = Weights::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/ssd_litert.safetensors"));
    let stored = stored.unwrap();
    for (kind, names, each) in [("boxes", BOXES, 4), ("classes", CLASSES, LABELS.len())] {
        let found = anchors(&outputs, &runner, names, each);
        assert_eq!(found.len(), 1917);
        let expected = &stored.tensors[kind];
        let kept: Vec<f32> = found.into_iter().step_by(EVERY).flatten().collect();
        assert_eq!(expected.shape, [kept.len() / each, each]);
        let largest = kept.iter().zip(&expected.values).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(largest < TOLERANCE, "{kind}: {largest}");
    }
}

#[test]
fn maps_have_as_many_cells_as_the_decoder_thinks() {
    let mut runner = runner(&model());
    for size in [[320, 320], [352, 640], [384, 416]] {
        let [width, height] = size;
        let values = vec![0.0; 3 * width * height];
        let shape = [1, 3, height, width];
        let outputs = runner.run(&[(INPUT, TensorView { shape: &shape, values: &values })]).unwrap();
        for (level, name) in BOXES.into_iter().enumerate() {
            let map = &outputs[runner.outputs().iter().position(|output| output.name == name).unwrap()];
            let expected = [1, 4 * shapes(level).len(), cells(height)[level], cells(width)[level]];
            assert_eq!(map.shape, expected, "{name} of {width}x{height}");
        }
    }
}

#[test]
fn distances_are_those_of_similar_triangles() {
    let model = model();
    let mut detector = SsdDetector::new(Box::new(runner(&model)), model.config.clone());
    let scene = image::open(root().join("assets/scenes/image_2/000000.jpg")).unwrap().to_rgb8();
    let camera = Camera::from_hfov(81.0, scene.width() as usize, scene.height() as usize).unwrap();
    let options = DecodeOptions { min_score: Some(0.3), ..DecodeOptions::default() };
    let (answers, _) = detector.detect_batch(&[(&scene, &camera)], &options).unwrap();
    assert!(answers[0].iter().any(|found| found.class == ObjectClass::Car), "{answers:?}");
    for found in &answers[0] {
        assert!(found.score > 0.3 && found.box2d.x1 >= 0.0 && found.box2d.x2 <= f64::from(scene.width()));
        let height_px = camera.focal_y() * found.box3d.dimensions.height / found.box3d.depth_m();
        assert!((height_px / found.box2d.height() - 1.0).abs() < 1e-9, "{found:?}");
        let sigma_m = found.range_sigma_m.unwrap();
        assert!((sigma_m / found.box3d.depth_m() - model.config.relative_error).abs() < 1e-9);
    }
    assert!(answers[0].windows(2).all(|pair| pair[0].score >= pair[1].score));
}

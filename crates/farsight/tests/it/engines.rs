//! The same answers from every engine that is there, and from ONNX Runtime's own Python.

use std::path::{Path, PathBuf};
use std::process::Command;

use farsight::shipped::Family;
use farsight::{
    Camera, Device, EngineKind, EngineOptions, Error, ModelSource, Pipeline, Precision, StageSource, read_image,
};
use farsight_graph::init::initial_weights;
use farsight_graph::layers::{Msfe, NeckKind, NormKind};
use farsight_graph::model::{Model, NetworkConfig};
use farsight_graph::weights::{WeightTensor, Weights};
use farsight_methods::centernet3d::CenterNet3dConfig;
use farsight_methods::gs3d::Gs3dConfig;
use farsight_methods::monodle::MonoDleConfig;
use farsight_methods::monogrnet::MonoGrNetConfig;
use farsight_methods::oftnet::OftNetConfig;
use farsight_methods::oftnet::grid::Grid;
use farsight_methods::smoke::config::SmokeConfig;
use farsight_methods::smoke::network::Backbone;
use farsight_methods::smoke::{DetectorFile, SmokeModel};
use farsight_onnx::{INPUT, Target};
use farsight_runtime::{Tensor, TensorView, probe};
use serde_json::Value;

use crate::program::{done, farsight, root};

/// Head maps in single precision.
const MAPS: f64 = 1e-4;

/// Boxes, metres.
const BOXES_M: f64 = 1e-3;

/// Rounding differs with the number of threads, and errors of locations grow with the distance: this share of it.
const FAR: f64 = 1e-4;

/// Detections with a higher score are compared one by one.
const BEST: f64 = 0.3;

/// Scores.
const SCORES: f64 = 1e-4;

/// Engines that are ready here; says which are not.
fn engines(folder: &Path) -> Vec<String> {
    let diagnosis: Value = serde_json::from_str(&done(folder, &["doctor", "--json"])).unwrap();
    let engines = diagnosis["engines"].as_array().unwrap();
    let name = |engine: &Value| engine["name"].as_str().unwrap().to_owned();
    let (ready, missing): (Vec<&Value>, Vec<&Value>) = engines.iter().partition(|engine| engine["ready"] == true);
    for engine in missing {
        println!("skipped: {}: {}", name(engine), engine["note"]);
    }
    // libtorch runs our own files and has tests of its own.
    ready.into_iter().map(name).filter(|name| name != "libtorch").collect()
}

/// Networks with drawn weights: one whose head is cut off, one with everything that is hard to export, one on another
/// backbone.
fn models() -> [(&'static str, SmokeModel); 3] {
    let model = |backbone, norm, neck, msfe| {
        let config =
            SmokeConfig { input: [320, 96], width: 0.25, backbone, norm, neck, msfe, ..SmokeConfig::default() };
        let mut weights = initial_weights(&config.graph(), 9);
        for (name, tensor) in &mut weights.tensors {
            // Offsets of a fraction of a cell; a fresh network has none.
            if name.ends_with("conv_offset_mask.weight") {
                let len = tensor.values.len() as f32;
                tensor
                    .values
                    .iter_mut()
                    .enumerate()
                    .for_each(|(i, value)| *value = 0.005 * (i as f32 * 7919.0 / len).sin());
            }
        }
        with_ordinary_answers(SmokeModel::new(config, weights).unwrap())
    };
    [
        ("plain", model(Backbone::Dla34, NormKind::Batch, NeckKind::Plain, Msfe::A)),
        ("hard", model(Backbone::Dla34, NormKind::Group, NeckKind::Deformable, Msfe::C)),
        ("mobile", model(Backbone::MobilenetV2, NormKind::Batch, NeckKind::Plain, Msfe::None)),
    ]
}

/// The model with its last convolutions scaled so that it answers with numbers of the size that trained networks answer
/// with.
fn with_ordinary_answers(mut model: SmokeModel) -> SmokeModel {
    let [logits, regression] = answer(&model);
    let largest = |values: &[f32]| values.iter().fold(0.0_f32, |largest, value| value.abs().max(largest));
    for (head, values, size) in [("class_head", &logits.values, 2.0), ("regression_head", &regression.values, 0.5)] {
        for part in ["weight", "bias"] {
            let name = format!("heads.predictor.{head}.3.{part}");
            for value in &mut model.weights.tensors.get_mut(&name).unwrap().values {
                *value *= size / largest(values);
            }
        }
    }
    model
}

/// What rten answers to the fixed input.
fn answer(model: &SmokeModel) -> [Tensor; 2] {
    let (source, [width, height]) = (Path::new("in memory"), probe::SIZE);
    let file = DetectorFile::from_model(model, Target::Portable, source).unwrap();
    let mut runner = EngineOptions::from(EngineKind::Rten).start(file.onnx, source).unwrap();
    let input = TensorView { shape: &[1, 3, height, width], values: &probe::input(probe::SIZE) };
    runner.run(&[(INPUT, input)]).unwrap().try_into().unwrap()
}

/// Real frames where they are at hand, else noise; copied to `folder`.
fn images(folder: &Path) -> Vec<String> {
    let kitti = std::env::var_os("FARSIGHT_KITTI").map_or_else(|| root().join("../shared/kitti"), PathBuf::from);
    let frames = kitti.join("frames/training/image_2");
    let mut paths: Vec<PathBuf> =
        std::fs::read_dir(&frames).into_iter().flatten().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    if paths.is_empty() {
        println!("real frames skipped: no {} (set FARSIGHT_KITTI)", frames.display());
        let path = folder.join("noise.png");
        image::RgbImage::from_fn(1242, 375, |x, y| image::Rgb([(x * y) as u8, (x + y) as u8, (3 * x) as u8]))
            .save(&path)
            .unwrap();
        paths.push(path);
    }
    paths.iter().take(2).map(|path| path.to_str().unwrap().to_owned()).collect()
}

fn detections(folder: &Path, model: &str, engine: &str, images: &[String]) -> Vec<Value> {
    let mut arguments = vec!["range"];
    arguments.extend(images.iter().map(String::as_str));
    let options =
        ["--model", model, "--engine", engine, "--hfov", "80", "--min-score", "0.02", "--json", "answer.json"];
    arguments.extend(options);
    done(folder, &arguments);
    let text = std::fs::read_to_string(folder.join("answer.json")).unwrap();
    let answer: Vec<Value> = serde_json::from_str(&text).unwrap();
    answer.iter().flat_map(|image| image["detections"].as_array().unwrap().clone()).collect()
}

/// Each of the best detections has its twin. Their order may differ where scores are equal up to rounding.
fn assert_same_detections(what: &str, found: &[Value], expected: &[Value]) {
    assert_eq!(found.len(), expected.len(), "{what}");
    for best in expected.iter().filter(|detection| detection["score"].as_f64() > Some(BEST)) {
        assert!(found.iter().any(|other| same(best, other)), "{what}: {best} has no twin");
    }
}

fn same(a: &Value, b: &Value) -> bool {
    let apart = |a: &Value, b: &Value| (a.as_f64().unwrap() - b.as_f64().unwrap()).abs();
    let lengths_apart = |key: &str| {
        let pairs = a[key].as_array().unwrap().iter().zip(b[key].as_array().unwrap());
        pairs.map(|(a, b)| apart(a, b)).fold(0.0, f64::max)
    };
    a["class"] == b["class"]
        && apart(&a["score"], &b["score"]) <= SCORES
        && lengths_apart("location") <= BOXES_M.max(FAR * a["range_m"].as_f64().unwrap())
        && lengths_apart("dimensions_hwl") <= BOXES_M
}

#[test]
fn every_engine_finds_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (engines, images) = (engines(folder), images(folder));
    for (name, model) in models() {
        let [own, file] = ["safetensors", "onnx"].map(|extension| format!("{name}.{extension}"));
        model.write(&folder.join(&own)).unwrap();
        done(folder, &["export", "--model", &own, "--out", &file]);
        let expected = detections(folder, &file, "rten", &images);
        let best = expected.iter().filter(|detection| detection["score"].as_f64() > Some(BEST)).count();
        assert!(best > 5, "{best} detections prove little");
        for engine in &engines {
            for model in [&file, &own] {
                assert_same_detections(
                    &format!("{engine} {model}"),
                    &detections(folder, model, engine, &images),
                    &expected,
                );
            }
        }
    }
}

/// A command that must fail with this in its message.
fn fails(folder: &Path, arguments: &[&str], expected: &str) {
    let output = farsight(folder, arguments);
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && told.contains(expected), "{arguments:?}: {told}");
}

/// A Python that can import `packages`; says so where there is none.
fn python_with(packages: &str) -> Option<Command> {
    let python = || Command::new(std::env::var_os("FARSIGHT_PYTHON").unwrap_or_else(|| "python3".into()));
    let imported = python().args(["-c", &format!("import {packages}")]).output();
    if !imported.is_ok_and(|output| output.status.success()) {
        println!("skipped: no Python with {packages} (set FARSIGHT_PYTHON)");
        return None;
    }
    Some(python())
}

/// docs/onnx.md, step by step, in another language.
#[test]
fn the_example_without_farsight_finds_the_same() {
    finds_the_same_without_farsight("farsight-s", "onnx_example.py");
    let lines = std::fs::read_to_string(root().join("scripts/onnx_example.py")).unwrap().lines().count();
    assert!(lines <= 80, "{lines} lines; expected at most 80");
}

/// The same of what `--model shipped` writes.
#[test]
fn the_example_of_an_ssd_without_farsight_finds_the_same() {
    finds_the_same_without_farsight("shipped", "onnx_ssd_example.py");
}

fn finds_the_same_without_farsight(model: &str, script: &str) {
    let Some(_) = python_with("onnxruntime, numpy") else { return };
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    done(folder, &["export", "--model", model, "--out", "shipped.onnx"]);
    for scene in ["000000", "000001", "000002", "000003"] {
        let scenes = root().join("assets/scenes");
        let [image, calib] = [format!("{scene}.ppm"), format!("{scene}.txt")];
        let pixels = read_image(scenes.join(format!("image_2/{scene}.jpg"))).unwrap();
        let header = format!("P6 {} {} 255\n", pixels.width(), pixels.height());
        std::fs::write(folder.join(&image), [header.as_bytes(), pixels.as_raw()].concat()).unwrap();
        std::fs::copy(scenes.join("calib").join(&calib), folder.join(&calib)).unwrap();
        let mut python = python_with("onnxruntime, numpy").unwrap();
        let python = python.current_dir(folder).arg(root().join("scripts").join(script));
        let output = python.args(["shipped.onnx", &image, &calib]).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let found: Vec<Value> = serde_json::from_slice(&output.stdout).unwrap();
        let alone = ["--refiner", "none", "--plates", "none", "--above-road", "none", "--max-overlap", "1"];
        let input = ["range", &image, "--calib", &calib, "--model", "shipped.onnx", "--quiet", "--json", "-"];
        let expected: Value = serde_json::from_str(&done(folder, &[&input[..], &alone[..]].concat())).unwrap();
        let expected = expected[0]["detections"].as_array().unwrap();
        assert!(found.len() == expected.len() && found.len() > 4, "{scene}: {} of {}", found.len(), expected.len());
        for (found, expected) in found.iter().zip(expected) {
            assert_eq!(found["class"], expected["class"], "{scene}");
            let numbers = ["score", "range_m", "range_sigma_m", "location", "dimensions_hwl", "rotation_y", "box2d"];
            for (name, tolerance) in numbers.into_iter().zip([1e-3, 0.01, 0.01, 0.01, 0.01, 1e-3, 0.1]) {
                let largest = largest_difference(&found[name], &expected[name]);
                assert!(largest <= tolerance, "{scene} {name}: {found} is not {expected}");
            }
        }
    }
}

/// Of two numbers, or lists of numbers, of JSON; infinite where they are none.
fn largest_difference(found: &Value, expected: &Value) -> f64 {
    match (found, expected) {
        (Value::Array(found), Value::Array(expected)) if found.len() == expected.len() => {
            found.iter().zip(expected).map(|(a, b)| largest_difference(a, b)).fold(0.0, f64::max)
        }
        _ => found.as_f64().zip(expected.as_f64()).map_or(f64::INFINITY, |(a, b)| (a - b).abs()),
    }
}

#[test]
fn second_stages_become_onnx_files_too() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for (word, option, name) in
        [("farsight-w-refiner", "--refiner", "a refiner"), ("shipped-plates", "--plates", "a plate reader")]
    {
        let told = done(folder, &["export", "--model", word, "--out", "part.onnx"]);
        assert!(told.contains("answer") && told.contains("part.onnx"), "{told}");
        assert!(done(folder, &["info", "part.onnx"]).contains(&name[2..]));
        let expected = format!("error: part.onnx: an ONNX file; expected {name} (.safetensors) that it was made from");
        fails(folder, &["range", "part.onnx", "--hfov", "65", option, "part.onnx"], &expected);
        fails(folder, &["bench", "--model", "part.onnx"], "part.onnx: a model of the method");
        fails(folder, &["export", "--model", word, "--out", "x.onnx", "--input", "64x64"], "are of detectors");
        fails(folder, &["export", "--model", word, "--out", "x.safetensors", "--half"], "or neither for an ONNX file");
    }
}

/// Writes what rten answers to the fixed input, as reference tensors.
fn write_reference(model: &SmokeModel, path: &Path) {
    let [logits, regression] = answer(model);
    let [width, height] = probe::SIZE;
    let tensor = |Tensor { shape, values }| WeightTensor::new(shape, values).unwrap();
    let input = Tensor { shape: vec![1, 3, height, width], values: probe::input(probe::SIZE) };
    let mut reference = Weights::default();
    reference.tensors.insert("input".to_owned(), tensor(input));
    reference.tensors.insert("cls_logits".to_owned(), tensor(logits));
    reference.tensors.insert("reg_raw".to_owned(), tensor(regression));
    reference.write(path).unwrap();
}

#[test]
fn the_checker_and_onnx_runtimes_python_agree() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for (name, model) in models() {
        let reference = folder.join("reference.safetensors");
        write_reference(&model, &reference);
        for target in [Target::Portable, Target::OnnxRuntime] {
            let file = folder.join(format!("{name}-{}.onnx", target.name()));
            std::fs::write(&file, DetectorFile::from_model(&model, target, &file).unwrap().onnx.sealed()).unwrap();
            let Some(mut python) = python_with("onnx, onnxruntime, numpy") else { return };
            let output = python.arg(root().join("scripts/check_onnx.py")).args([&file, &reference]).output().unwrap();
            let text = String::from_utf8_lossy(&output.stdout);
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            for line in text.lines() {
                println!("{name} {} {line}", target.name());
                let difference: f64 = line.split_whitespace().nth(1).unwrap().parse().unwrap();
                assert!(difference <= MAPS, "{name}: {line}");
            }
            assert_eq!(text.lines().count(), 2);
        }
    }
}

#[test]
fn parity_tells_by_its_status() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let [(_, model), ..] = models();
    model.write(&folder.join("m.safetensors")).unwrap();
    let reference = folder.join("reference.safetensors");
    write_reference(&model, &reference);
    let arguments = ["parity", "--model", "m.safetensors", "--golden", "reference.safetensors", "--json", "p.json"];
    assert!(done(folder, &arguments).contains("same"));

    let mut none = Weights::default();
    none.tensors.insert("input".to_owned(), WeightTensor::new(vec![0, 3, 32, 32], Vec::new()).unwrap());
    none.tensors.insert("cls_logits".to_owned(), WeightTensor::new(vec![0, 3, 8, 8], Vec::new()).unwrap());
    none.write(&folder.join("none.safetensors")).unwrap();
    let output = farsight(folder, &["parity", "--model", "m.safetensors", "--golden", "none.safetensors"]);
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(2) && told.contains("has the shape [0, 3, 32, 32]; expected"), "{told}");

    let mut wrong = Weights::read(&reference).unwrap();
    wrong.tensors.get_mut("reg_raw").unwrap().values[5] += 0.01;
    wrong.write(&reference).unwrap();
    let output = farsight(folder, &arguments);
    assert_eq!(output.status.code(), Some(1));
    let parity: Value = serde_json::from_str(&std::fs::read_to_string(folder.join("p.json")).unwrap()).unwrap();
    assert_eq!(parity["within"], false);
    let largest = parity["outputs"][1]["largest_difference"].as_f64().unwrap();
    assert!((largest - 0.01).abs() < 1e-4, "{largest}");
}

/// Distances after refiner, plate reader and road plane, metres: what rounds differently is looked at again three
/// times.
const PIPELINE_M: f64 = 0.02;

/// What `pipeline` says of a shipped scene: class, distance and score of each sure object.
fn sure(pipeline: &Pipeline, scene: &str) -> Vec<(String, f64, f64)> {
    let image = read_image(root().join(format!("assets/scenes/image_2/{scene}.jpg"))).unwrap();
    let camera = Camera::from_hfov(81.4, image.width(), image.height()).unwrap();
    let objects = pipeline.detect(&image, &camera).unwrap();
    objects.into_iter().map(|object| (object.class.to_string(), object.range_m, object.score)).collect()
}

/// Each of the sure objects has its twin.
fn assert_same_objects(what: &str, found: &[(String, f64, f64)], expected: &[(String, f64, f64)]) {
    assert_eq!(found.len(), expected.len(), "{what}: {found:?}\n{expected:?}");
    for (class, range_m, score) in expected {
        let twin = |(other, other_m, other_score): &(String, f64, f64)| {
            other == class && (other_m - range_m).abs() <= PIPELINE_M && (other_score - score).abs() <= 10.0 * SCORES
        };
        assert!(found.iter().any(twin), "{what}: {class} at {range_m} m has no twin in {found:?}");
    }
}

/// Engines that are ready here, with libtorch where it is built in.
fn kinds() -> Vec<EngineKind> {
    let folder = tempfile::tempdir().unwrap();
    let ready = engines(folder.path());
    let is_ready = |kind: &EngineKind| ready.iter().any(|name| kind.name() == name);
    let is_here = |kind: &EngineKind| is_ready(kind) || (cfg!(feature = "train") && *kind == EngineKind::Libtorch);
    EngineKind::ALL.into_iter().filter(is_here).collect()
}

/// Detector, refiner and road of farsight-w and of farsight-n, which is the quickest, in mixtures and threads, too;
/// detector, refiner, plate reader and road of farsight-s.
#[test]
fn the_whole_pipeline_runs_on_every_engine_in_mixtures_and_in_threads() {
    let kinds = kinds();
    for family in Family::ALL {
        let builder = || Pipeline::builder().model(ModelSource::Shipped(family));
        let whole = builder().open().unwrap();
        // A scene in which each stage has a say.
        let plates_matter = |scene: &&str| {
            let without = builder().plates(StageSource::Off).open().unwrap();
            family != Family::FarsightS || sure(&without, scene) != sure(&whole, scene)
        };
        let scene = ["000000", "000001", "000002", "000003"].into_iter().find(plates_matter);
        let scene = scene.expect("a scene with a number plate that can be read");
        assert_eq!(whole.info().plates_sha256.is_some(), family == Family::FarsightS);
        let expected = sure(&whole, scene);
        assert!(expected.len() > 2, "{expected:?} prove little");
        for &kind in &kinds {
            let what = format!("{} on {kind}", family.name());
            let whole = builder().engine(kind).open().unwrap();
            assert_eq!(whole.engine(), kind.name());
            assert_same_objects(&what, &sure(&whole, scene), &expected);
            if family != Family::FarsightN {
                continue;
            }
            let second = builder().second_stage_engine(kind).open().unwrap();
            assert_eq!(second.engine(), "rten");
            assert_same_objects(&format!("{}, rten, then {kind}", family.name()), &sure(&second, scene), &expected);
            std::thread::scope(|scope| {
                let threads: Vec<_> = (0..2).map(|_| scope.spawn(|| sure(&whole, scene))).collect();
                for thread in threads {
                    assert_same_objects(&what, &thread.join().unwrap(), &expected);
                }
            });
        }
    }
}

/// A mixture has a precision of its own: 8 bits of the second stages alone move distances a little, and what an engine
/// cannot is an error.
#[test]
fn the_second_stages_have_a_precision_of_their_own() {
    let expected = sure(&Pipeline::shipped().unwrap(), "000000");
    let asked =
        |kind, precision| Pipeline::builder().second_stage_engine(kind).second_stage_precision(precision).open();
    assert!(matches!(asked(EngineKind::Rten, Precision::Int8), Err(Error::Option { engine: EngineKind::Rten, .. })));
    for kind in kinds().into_iter().filter(|kind| kind.library().is_some()) {
        let single = asked(kind, Precision::F32).unwrap();
        assert_same_objects(kind.name(), &sure(&single, "000000"), &expected);
        let eight = sure(&asked(kind, Precision::Int8).unwrap(), "000000");
        assert_ne!(eight, sure(&single, "000000"), "{kind}: 8 bits change something");
        let near = |(class, range_m, _): &(String, f64, f64)| {
            eight.iter().any(|(other, other_m, _)| other == class && (other_m / range_m - 1.0).abs() < 0.1)
        };
        assert!(expected.iter().filter(|one| near(one)).count() * 2 > expected.len(), "{kind}: {eight:?}");
    }
}

/// A device that the engine, its library or this computer has not got is an error that says what is missing; where it
/// is there, the answers are the CPU's.
#[test]
fn a_device_gives_the_same_answers_or_says_what_is_missing() {
    let opened = |kind, device| {
        let options = EngineOptions { kind, device, ..EngineOptions::default() };
        Pipeline::builder().model(ModelSource::from_word(Family::FarsightN.name())).engine_options(options).open()
    };
    let none = opened(EngineKind::Rten, Device::Cuda);
    let none = none.err().map(|error| error.to_string());
    assert_eq!(none.unwrap(), "the engine rten has no device cuda; onnxruntime has");
    for kind in kinds() {
        for device in [Device::Cuda, Device::TensorRt, Device::Gpu] {
            match opened(kind, device) {
                Ok(pipeline) => {
                    let expected = sure(&opened(kind, Device::Cpu).unwrap(), "000000");
                    assert_same_objects(device.name(), &sure(&pipeline, "000000"), &expected);
                }
                Err(Error::Device { engine, expected, .. }) => {
                    assert_eq!(engine, kind);
                    assert_ne!(expected, kind);
                }
                Err(Error::Option { engine, .. }) => assert_eq!(engine, EngineKind::Libtorch),
                Err(Error::EngineLibrary { source, .. }) => {
                    let text = format!("{source} {:?}", std::error::Error::source(&source));
                    assert!(text.contains(&format!("device {device}")) && text.contains("GPU"), "{text}");
                    println!("skipped: {kind} on {device}: {text}");
                }
                Err(error) => panic!("{kind} on {device}: {error}"),
            }
        }
    }
    let options = EngineOptions {
        kind: EngineKind::OnnxRuntime,
        device: Device::Cuda,
        precision: Precision::Int8,
        ..EngineOptions::default()
    };
    assert!(matches!(options.check_device(), Err(Error::DevicePrecision { .. })));
}

/// A small detector with drawn weights, and with these biases of its last convolutions: answers of the size that a
/// trained one's are.
fn drawn<C: NetworkConfig>(config: C, biases: &[(&str, f32)]) -> Model<C> {
    let mut weights = initial_weights(&config.graph(), 4);
    for (head, bias) in biases {
        weights.tensors.get_mut(&format!("heads.{head}.2.bias")).unwrap().values.fill(*bias);
    }
    Model::new(config, weights).unwrap()
}

#[test]
fn a_centernet_is_exported_shown_run_on_every_engine_and_evaluated() {
    let config = CenterNet3dConfig {
        input: [320, 96],
        width: 0.25,
        depth_focal_px: Some(200.0),
        ..CenterNet3dConfig::default()
    };
    // Scores about a half, depths about 20 m, sizes of small cars, 2D boxes of eight cells.
    let model = drawn(config, &[("hm", 0.0), ("dep", -3.0), ("dim", 1.7), ("wh", 8.0)]);
    does_all_that_a_detector_does(&model, ["hm", "CenterNet"]);
}

#[test]
#[ignore = "takes long: `cargo xtask test --all`"]
fn a_monodle_is_exported_shown_run_on_every_engine_and_evaluated() {
    let config =
        MonoDleConfig { input: [320, 96], width: 0.25, depth_focal_px: Some(200.0), ..MonoDleConfig::default() };
    let model = drawn(config, &[("heatmap", 0.0), ("depth", -3.0), ("size_3d", 1.7), ("size_2d", 8.0)]);
    does_all_that_a_detector_does(&model, ["heatmap", "MonoDLE"]);
}

#[test]
#[ignore = "takes long: `cargo xtask test --all`"]
fn an_oftnet_is_exported_shown_run_on_every_engine_and_evaluated() {
    let config = OftNetConfig {
        input: [320, 96],
        width: 0.0625,
        blocks: 2,
        grid: Grid { cell_m: 2.0, columns: 20, rows: 20, ..Grid::default() },
        ..OftNetConfig::default()
    };
    let mut weights = initial_weights(&config.graph(), 4);
    // Scores about a half.
    weights.tensors.get_mut("head.bias").unwrap().values[0] = 0.5;
    let model = Model::new(config, weights).unwrap();
    does_all_that_a_detector_does(&model, ["map8", "OFTNet"]);
}

#[test]
#[ignore = "takes long: `cargo xtask test --all`"]
fn a_gs3d_is_exported_shown_run_on_every_engine_and_evaluated() {
    let config = Gs3dConfig {
        input: [320, 96],
        width: 0.25,
        backbone: Backbone::Resnet18,
        surface_channels: 16,
        hidden: 32,
        ..Gs3dConfig::default()
    };
    // Scores above a half, 2D boxes of eight cells.
    let mut model = drawn(config, &[("heatmap", 2.0), ("size", 8.0)]);
    model.weights.tensors.get_mut("refine.bins.bias").unwrap().values.fill(1.0);
    does_all_that_a_detector_does(&model, ["surfaces", "GS3D"]);
}

#[test]
fn a_monogrnet_is_exported_in_three_files_shown_run_on_every_engine_and_evaluated() {
    let config =
        MonoGrNetConfig { input: [320, 96], width: 0.125, backbone: Backbone::Resnet18, ..MonoGrNetConfig::default() };
    let mut weights = initial_weights(&config.graph(), 5);
    // Cells that find boxes of two cells with cars in them, some more likely than others.
    let mut set = |name: &str, values: &[f32]| {
        weights.tensors.get_mut(name).unwrap().values[..values.len()].copy_from_slice(values);
    };
    set("cells.2.bias", &[-1.0, 1.0, 0.0, 0.0, 2.0, 1.0]);
    set("boxes.rezoom.6.bias", &[-1.0, 1.0]);
    let corners = [-1.9, -0.8, -0.8, 1.9, -0.8, -0.8, 1.9, 0.8, -0.8, 1.9, 0.8, 0.8, 1.9, -0.8, 0.8, -1.9, -0.8, 0.8];
    let corners = [&corners[..], &[-1.9, 0.8, 0.8, -1.9, 0.8, -0.8]].concat();
    let raw: Vec<f32> = corners.iter().map(|value: &f32| (value / 3.0).atanh()).collect();
    set("boxes.corners.6.bias", &raw);
    for name in ["cells.2.weight", "boxes.rezoom.6.weight", "depth.coarse.out.weight", "center.coarse.2.weight"] {
        weights.tensors.get_mut(name).unwrap().values.iter_mut().for_each(|value| *value *= 20.0);
    }
    let model = Model::new(config, weights).unwrap();
    does_all_that_a_detector_does(&model, ["corner_map", "MonoGRNet"]);
}

/// Exports, shows, runs and evaluates `model`, as model file and as ONNX file; `output` is one of its outputs, `word`
/// tells what it is.
fn does_all_that_a_detector_does<C: NetworkConfig>(model: &Model<C>, [output, word]: [&str; 2]) {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (engines, images) = (engines(folder), images(folder));
    model.write(&folder.join("c.safetensors")).unwrap();
    let told = done(folder, &["export", "--model", "c.safetensors", "--out", "c.onnx"]);
    assert!(told.contains(output) && told.contains("largest difference"), "{told}");
    let shown = ["c.safetensors", "c.onnx"].map(|model| done(folder, &["info", model]));
    assert!(shown[0] == shown[1] && shown[0].contains(word), "{shown:?}");
    let half = ["export", "--model", "c.safetensors", "--half", "--training-data", "noise", "--out", "h.safetensors"];
    assert!(done(folder, &half).contains("half-precision numbers"));
    assert!(done(folder, &["info", "h.safetensors"]).contains("trained on      noise\n"));
    for (options, reason) in [
        (&["--half", "--fit-on", "."][..], "--fit-on is of SMOKE"),
        (&["--int8", "--calibration", "."], "--int8 alone chooses layers by what SMOKE's answers bear"),
    ] {
        let out = if options[0] == "--half" { "x.safetensors" } else { "x.onnx" };
        fails(folder, &[&["export", "--model", "c.safetensors", "--out", out], options].concat(), reason);
    }
    fails(
        folder,
        &["prune", "--model", "c.safetensors", "--keep", "0.5", "--out", "p.safetensors"],
        "its training goes on with whole networks only; what is pruned must be trained on",
    );

    let mut expected = detections(folder, "c.safetensors", "rten", &images);
    expected.sort_by(|a, b| b["score"].as_f64().unwrap().total_cmp(&a["score"].as_f64().unwrap()));
    expected.truncate(10);
    assert!(expected.len() > 5 && expected[0]["score"].as_f64() > Some(BEST), "{expected:?} prove little");
    for engine in &engines {
        for model in ["c.safetensors", "c.onnx"] {
            let found = detections(folder, model, engine, &images);
            for best in &expected {
                assert!(found.iter().any(|other| same(best, other)), "{engine} {model}: {best} has no twin");
            }
        }
    }

    if cfg!(feature = "train") {
        let found = detections(folder, "c.safetensors", "libtorch", &images);
        for best in &expected {
            assert!(found.iter().any(|other| same(best, other)), "libtorch: {best} has no twin");
        }
        fails(folder, &["bench", "--engine", "libtorch", "--model", "c.onnx"], "it runs no ONNX files");
    }

    for part in ["image_2", "calib", "label_2"] {
        std::fs::create_dir_all(folder.join("data/training").join(part)).unwrap();
    }
    let scenes = root().join("assets/scenes");
    for (from, to) in [("image_2/000000.jpg", "image_2/000000.jpg"), ("calib/000000.txt", "calib/000000.txt")] {
        std::fs::copy(scenes.join(from), folder.join("data/training").join(to)).unwrap();
    }
    let car = "Car 0.00 0 0.00 500.00 170.00 560.00 220.00 1.50 1.60 3.90 0.00 1.70 20.00 0.00\n";
    std::fs::write(folder.join("data/training/label_2/000000.txt"), car).unwrap();
    done(folder, &["eval", "--data", "data", "--model", "c.onnx", "--json", "e.json", "--resamples", "0"]);
    assert!(std::fs::read_to_string(folder.join("e.json")).unwrap().contains("\"objects\": 1"));
}

/// More sizes than an engine makes a form of its own for: the others are seen by one that takes any.
#[test]
fn inputs_of_many_sizes_have_the_same_answers_on_every_engine() {
    let (_, model) = models().into_iter().next().unwrap();
    let source = Path::new("in memory");
    let sizes: [[usize; 2]; 7] = [[320, 96], [64, 64], [96, 64], [128, 32], [32, 128], [160, 96], [96, 160]];
    let answers = |kind: EngineKind| {
        let file = DetectorFile::from_model(&model, kind.target(), source).unwrap();
        let mut runner = EngineOptions::from(kind).start(file.onnx, source).unwrap();
        // Back again at last, and two images after one.
        let mut seen = |images: usize, size: [usize; 2]| {
            let values = probe::input(size).repeat(images);
            let input = TensorView { shape: &[images, 3, size[1], size[0]], values: &values };
            runner.run(&[(INPUT, input)]).unwrap()
        };
        let mut answers: Vec<_> = sizes.iter().chain(&sizes).map(|&size| seen(1, size)).collect();
        answers.extend([seen(2, sizes[1]), seen(2, sizes[6]), seen(1, sizes[1])]);
        answers
    };
    let expected = answers(EngineKind::Rten);
    for kind in kinds().into_iter().filter(|kind| ![EngineKind::Rten, EngineKind::Libtorch].contains(kind)) {
        for (found, expected) in answers(kind).iter().flatten().zip(expected.iter().flatten()) {
            assert_eq!(found.shape, expected.shape, "{kind}");
            let apart = found.values.iter().zip(&expected.values).map(|(a, b)| f64::from((a - b).abs()));
            let most = apart.fold(0.0, f64::max);
            assert!(most < MAPS, "{kind}: {:?}: {most} apart", found.shape);
        }
    }
}

/// The files of a folder of compiled networks, each with its bytes.
fn compiled(data: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let files = |folder: PathBuf| std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut found: Vec<_> = files(data.join("compiled")).flat_map(files).collect();
    found.sort();
    found.into_iter().map(|path| (path.clone(), std::fs::read(path).unwrap())).collect()
}

#[test]
fn what_openvino_compiled_is_used_again_unless_it_was_changed() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let diagnosis: Value = serde_json::from_str(&done(folder, &["doctor", "--json"])).unwrap();
    let openvino = diagnosis["engines"].as_array().unwrap().iter().find(|engine| engine["name"] == "openvino").unwrap();
    let Some(library) = openvino["path"].as_str().filter(|_| openvino["ready"] == true) else {
        println!("skipped: {}", openvino["note"]);
        return;
    };
    let data = folder.join("data");
    let image = root().join("assets/scenes/image_2/000000.jpg");
    let answer = || {
        let mut command = Command::new(env!("CARGO_BIN_EXE_farsight"));
        command.arg("range").arg(&image).args(["--model", "farsight-n", "--json", "-", "--quiet"]);
        command.args(["--engine", "openvino", "--engine-path", library]).env("FARSIGHT_DATA", &data);
        let output = command.output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        output.stdout
    };
    let expected = answer();
    let kept = compiled(&data);
    assert!(kept.len() >= 4, "the detector's network and the refiner's, each with its hash: {kept:?}");
    let written = |(path, _): &(PathBuf, Vec<u8>)| std::fs::metadata(path).unwrap().modified().unwrap();
    let is_network = |(path, _): &&(PathBuf, Vec<u8>)| path.file_name().unwrap() != "sha256";
    let times: Vec<_> = kept.iter().filter(is_network).map(written).collect();
    assert_eq!(answer(), expected);
    assert_eq!(
        compiled(&data).iter().filter(is_network).map(written).collect::<Vec<_>>(),
        times,
        "nothing is compiled"
    );

    // A flipped bit, and half a file: made anew, with the same answers.
    let changes: [fn(&mut Vec<u8>); 2] =
        [|bytes| *bytes.last_mut().unwrap() ^= 1, |bytes| bytes.truncate(bytes.len() / 2)];
    for change in changes {
        for (path, bytes) in kept.iter().filter(is_network) {
            let mut bytes = bytes.clone();
            change(&mut bytes);
            std::fs::remove_file(path).unwrap();
            std::fs::write(path, bytes).unwrap();
        }
        assert_eq!(answer(), expected);
        let anew = compiled(&data);
        assert_eq!(
            anew.iter().map(|(path, _)| path).collect::<Vec<_>>(),
            kept.iter().map(|(path, _)| path).collect::<Vec<_>>()
        );
        assert!(anew.iter().zip(&kept).all(|(new, old)| new.1.len() == old.1.len()));
    }

    // Where nothing can be kept it is compiled each time.
    std::fs::remove_dir_all(&data).unwrap();
    std::fs::write(&data, "a file").unwrap();
    assert_eq!(answer(), expected);
}

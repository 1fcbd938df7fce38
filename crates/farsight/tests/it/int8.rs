//! `farsight export --int8`: the shipped model in 8 bits, on every engine that is there, and what is refused.

use std::path::Path;
use std::process::Command;

use serde_json::Value;

use crate::program::{done, farsight, root};

/// How far the distance of a car may move between engines, as a share: a sum on the border between two steps may be
/// rounded either way.
const DISTANCE: f64 = 0.03;

/// The same for scores; the shipped model's are probabilities that change about three times as fast as the peaks they
/// are made from.
const SCORE: f64 = 0.15;

/// Detections with a higher score than this have a twin on every engine, but for a few.
const BEST: f64 = 0.9;

/// Share of them that have one: a peak that lies between two cells may be read from the other, where the network says
/// another distance or score.
const MOST: f64 = 0.9;

/// By what factor the limits are wider for those few.
const BESIDE: f64 = 3.0;

fn path(relative: &str) -> String {
    root().join(relative).to_str().unwrap().to_owned()
}

fn detections(folder: &Path, arguments: &[&str]) -> Vec<Value> {
    let images = path("assets/scenes/image_2");
    // All of them: which of two in one place is the better one is a question of digits.
    let common = ["range", &images, "--max-overlap", "1", "--min-score", "0.2", "--json", "answer.json"];
    done(folder, &[&common, arguments].concat());
    let answer: Vec<Value> =
        serde_json::from_str(&std::fs::read_to_string(folder.join("answer.json")).unwrap()).unwrap();
    let named = |image: &Value| {
        let detections = image["detections"].as_array().unwrap().clone();
        detections
            .into_iter()
            .map(|mut detection| {
                detection["image"] = image["image"].clone();
                detection
            })
            .collect::<Vec<_>>()
    };
    answer.iter().flat_map(named).collect()
}

/// The engines with kernels for 8 bits that are here; of the others it is printed why they are not.
fn engines(folder: &Path) -> Vec<String> {
    let diagnosis: Value = serde_json::from_str(&done(folder, &["doctor", "--json"])).unwrap();
    let mut ready = Vec::new();
    for engine in diagnosis["engines"].as_array().unwrap() {
        let name = engine["name"].as_str().unwrap();
        match (name, engine["ready"] == true) {
            ("libtorch" | "rten", _) => {}
            (_, true) => ready.push(name.to_owned()),
            (_, false) => println!("skipped: {name}: {}", engine["note"]),
        }
    }
    ready
}

fn number(detection: &Value, key: &str) -> f64 {
    detection[key].as_f64().unwrap()
}

fn assert_twins(what: &str, found: &[Value], expected: &[Value]) {
    let best: Vec<&Value> = expected.iter().filter(|detection| number(detection, "score") > BEST).collect();
    assert!(best.len() > 3, "{what}: {} detections prove little", best.len());
    let alone = |factor: f64| -> Vec<&Value> {
        let twins = |detection: &Value, other: &Value| {
            other["class"] == detection["class"]
                && other["image"] == detection["image"]
                && (number(other, "range_m") / number(detection, "range_m") - 1.0).abs() < factor * DISTANCE
                && (number(other, "score") - number(detection, "score")).abs() < factor * SCORE
        };
        best.iter().copied().filter(|detection| !found.iter().any(|other| twins(detection, other))).collect()
    };
    assert!(alone(1.0).len() as f64 <= (1.0 - MOST) * best.len() as f64, "{what}: without a twin: {:#?}", alone(1.0));
    assert!(alone(BESIDE).is_empty(), "{what}: without anything like it: {:#?}", alone(BESIDE));
}

#[test]
fn the_shipped_model_in_8_bits() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (model, scenes) = (path("models/farsight-s.safetensors"), path("assets/scenes/image_2"));
    let arguments =
        ["export", "--int8", "--model", &model, "--calibration", &scenes, "--float-layers", "0", "--out", "int8.onnx"];
    let told = done(folder, &arguments);
    assert!(told.contains("0 left in float"), "{told}");
    assert!(told.contains("int8.onnx: 5."), "a quarter of the size: {told}");

    let info = done(folder, &["info", "int8.onnx"]);
    let line = info.lines().find_map(|line| line.strip_prefix("8 bits")).unwrap();
    let facts: Value = serde_json::from_str(line.trim()).unwrap();
    assert_eq!(facts["images"], 4);
    assert_eq!(facts["observer"], "mse");
    assert_eq!(facts["float_layers"], serde_json::json!([]));
    assert!(facts["distance_change"].as_f64().unwrap() < 0.05, "{facts}");

    let float = detections(folder, &["--model", &model]);
    let int8 = detections(folder, &["--model", "int8.onnx"]);
    assert_twins("8 bits", &int8, &float);
    for name in engines(folder) {
        assert_twins(&name, &detections(folder, &["--model", "int8.onnx", "--engine", &name]), &int8);
    }
    check_with_onnx(&folder.join("int8.onnx"));
}

/// ONNX's own checker, where it is.
fn check_with_onnx(file: &Path) {
    let python = std::env::var_os("FARSIGHT_PYTHON").unwrap_or_else(|| "python3".into());
    let script = "import sys, onnx; onnx.checker.check_model(sys.argv[1], full_check=True)";
    let Ok(output) = Command::new(python).args(["-c", script]).arg(file).output() else {
        println!("skipped: no python3 (set FARSIGHT_PYTHON)");
        return;
    };
    let problem = String::from_utf8_lossy(&output.stderr);
    if problem.contains("No module named") {
        println!("skipped: no package onnx (set FARSIGHT_PYTHON to a Python that has it)");
        return;
    }
    assert!(output.status.success(), "{problem}");
}

#[test]
fn what_cannot_be_quantised_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    std::fs::create_dir(folder.join("empty")).unwrap();
    std::fs::write(folder.join("nonsense"), [0; 20]).unwrap();
    let (model, scenes) = (path("models/farsight-s.safetensors"), path("assets/scenes/image_2"));
    done(folder, &["export", "--model", &model, "--out", "already.onnx"]);
    let table: [(&[&str], &str); 8] = [
        (&["--model", "nonsense", "--calibration", &scenes], "nonsense: "),
        (&["--model", &model, "--calibration", "empty"], "empty: no images in this folder"),
        (&["--model", &model, "--calibration", "nowhere"], "nowhere: no such file or folder"),
        (&["--model", "already.onnx", "--calibration", &scenes], "already.onnx: an ONNX file already"),
        (&["--model", &model], "--calibration"),
        (&["--model", &model, "--calibration", &scenes, "--half"], "a name ending in .safetensors"),
        (&["--model", &model, "--calibration", &scenes, "--percentile", "20"], "expected a number from 50 to 100"),
        (&["--model", &model, "--calibration", &scenes, "--split", "x.txt"], "--data"),
    ];
    for (arguments, expected) in table {
        let output = farsight(folder, &[&["export", "--int8", "--out", "out.onnx"], arguments].concat());
        let problem = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {problem}");
        assert!(problem.contains(expected), "{arguments:?}: {problem}");
        assert!(!folder.join("out.onnx").exists(), "{arguments:?}");
    }
}

/// By farsight-n, the quickest.
#[test]
fn the_whole_pipeline_in_8_bits() {
    const MODEL: [&str; 2] = ["--model", "farsight-n"];
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let scenes = path("assets/scenes/image_2");
    let refused = farsight(folder, &["range", &scenes, "--precision", "int8"]);
    assert!(String::from_utf8_lossy(&refused.stderr).contains("--precision int8 is for onnxruntime or openvino;"));

    // Ranges are added, and nothing else changes: the weights are still those that come with the program.
    let file = ["--calibration", &scenes, "--out", "refiner.safetensors"];
    let told = done(folder, &[&["export", "--int8", "--half", "--model", "farsight-n-refiner"], &file[..]].concat());
    assert!(told.contains("ranges for 8 bits of") && told.contains("from 4 images (mse)"), "{told}");
    let float = detections(folder, &MODEL);
    assert_eq!(detections(folder, &[&MODEL[..], &["--refiner", "refiner.safetensors"]].concat()), float);

    for name in &engines(folder) {
        let int8 = detections(folder, &[&MODEL[..], &["--engine", name, "--precision", "int8"]].concat());
        assert_ne!(int8, float, "{name}: these are other numbers");
        assert_twins(name, &int8, &float);
        // Whoever trains a refiner measures its ranges before it can be used so.
        let image = path("assets/scenes/image_2/000000.jpg");
        let common = ["range", &image, "--engine", name, "--precision", "int8"];
        done(folder, &[&common[..], &MODEL, &["--refiner", "refiner.safetensors"]].concat());
        let shipped = path("models/farsight-s.safetensors");
        done(folder, &["export", "--half", "--model", &shipped, "--out", "copy.safetensors"]);
        let output = farsight(folder, &[&common[..], &["--model", "copy.safetensors"]].concat());
        assert!(output.status.success(), "a copy keeps its ranges");
    }
}

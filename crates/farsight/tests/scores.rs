//! `farsight export --scores-from`: scores as probabilities.

#![allow(clippy::unwrap_used)]

mod program;

use std::path::Path;
use std::process::Output;

use program::{done, farsight, root};
use serde_json::Value;

/// `model` with scores fitted on so many rendered frames, as fitted.safetensors.
fn fitted(folder: &Path, model: &str, frames: &str) -> Output {
    done(folder, &["synth", "--out", "scenes", "--frames", frames, "--seed", "5"]);
    let arguments = ["export", "--half", "--model", model, "--scores-from", "scenes", "--out", "fitted.safetensors"];
    farsight(folder, &arguments)
}

fn shipped() -> String {
    root().join("models/farsight-s.safetensors").display().to_string()
}

#[test]
fn scores_are_fitted_on_labelled_frames() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let scores = |model: &str| -> Vec<f64> {
        let told = fitted(folder, model, "24");
        let status = String::from_utf8_lossy(&told.stderr);
        assert!(told.status.success() && status.contains("scores of Car: fitted on its own detections"), "{status}");
        let image = "scenes/training/image_2/000003.png";
        let limits = ["--model", "fitted.safetensors", "--min-score", "0.1"];
        done(folder, &[&["range", image, "--hfov", "81.4", "--json", "answer.json"], &limits[..]].concat());
        let answer: Value = serde_json::from_slice(&std::fs::read(folder.join("answer.json")).unwrap()).unwrap();
        let found = answer[0]["detections"].as_array().unwrap();
        found.iter().map(|detection| detection["score"].as_f64().unwrap()).collect()
    };
    let first = scores(&shipped());
    assert!(!first.is_empty() && first.is_sorted_by(|a, b| a >= b), "{first:?}");
    // Fitting what is fitted already starts from the peaks again and comes to the same.
    std::fs::rename(folder.join("fitted.safetensors"), folder.join("once.safetensors")).unwrap();
    std::fs::remove_dir_all(folder.join("scenes")).unwrap();
    assert_eq!(scores("once.safetensors"), first);
}

#[test]
fn too_few_detections_to_fit_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let told = fitted(folder, &shipped(), "1");
    let problem = String::from_utf8_lossy(&told.stderr);
    assert!(!told.status.success() && problem.contains("expected at least 50 of each to fit scores on"), "{problem}");
    assert!(!folder.join("fitted.safetensors").exists());
}

//! `farsight export --scores-from`: scores as probabilities.

#![allow(clippy::unwrap_used)]

mod program;

use program::{done, farsight, root};
use serde_json::Value;

#[test]
fn scores_are_fitted_on_labelled_frames() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    done(folder, &["synth", "--out", "scenes", "--frames", "24", "--seed", "5"]);
    let model = root().join("models/farsight-s.safetensors").display().to_string();
    let told = farsight(
        folder,
        &["export", "--half", "--model", &model, "--scores-from", "scenes", "--out", "fitted.safetensors"],
    );
    let status = String::from_utf8_lossy(&told.stderr);
    assert!(told.status.success() && status.contains("scores of Car: fitted on its own detections"), "{status}");

    let image = "scenes/training/image_2/000003.png";
    let scores = |model: &str| -> Vec<f64> {
        done(
            folder,
            &["range", image, "--hfov", "81.4", "--model", model, "--min-score", "0.1", "--json", "answer.json"],
        );
        let answer: Value = serde_json::from_slice(&std::fs::read(folder.join("answer.json")).unwrap()).unwrap();
        let found = answer[0]["detections"].as_array().unwrap();
        found.iter().map(|detection| detection["score"].as_f64().unwrap()).collect()
    };
    let fitted = scores("fitted.safetensors");
    assert!(!fitted.is_empty() && fitted.is_sorted_by(|a, b| a >= b), "{fitted:?}");
    // Fitting what is fitted already starts from the peaks again and comes to the same.
    done(
        folder,
        &["export", "--half", "--model", "fitted.safetensors", "--scores-from", "scenes", "--out", "again.safetensors"],
    );
    assert_eq!(scores("again.safetensors"), fitted);
}

#[test]
fn too_few_detections_to_fit_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    done(folder, &["synth", "--out", "scenes", "--frames", "1", "--seed", "5"]);
    let model = root().join("models/farsight-s.safetensors").display().to_string();
    let told = farsight(
        folder,
        &["export", "--half", "--model", &model, "--scores-from", "scenes", "--out", "fitted.safetensors"],
    );
    let problem = String::from_utf8_lossy(&told.stderr);
    assert!(!told.status.success() && problem.contains("expected at least 50 of each to fit scores on"), "{problem}");
    assert!(!folder.join("fitted.safetensors").exists());
}

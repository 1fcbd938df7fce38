//! `--hfov auto`: cameras that are estimated from their images.

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::program;

/// The first shipped scene, where nothing beside it tells its camera.
fn alone(folder: &Path) -> &'static str {
    fs::copy(program::root().join("assets/scenes/image_2/000000.jpg"), folder.join("street.jpg")).unwrap();
    "street.jpg"
}

fn answer(folder: &Path, words: &[&str]) -> Value {
    let words: Vec<&str> =
        ["range", "--format", "json", "--model", "farsight-n"].iter().chain(words).copied().collect();
    let told: Value = serde_json::from_str(&program::done(folder, &words)).unwrap();
    told[0].clone()
}

#[test]
fn an_unknown_camera_is_estimated_and_widens_the_error_bars() {
    let folder = tempfile::tempdir().unwrap();
    let image = alone(folder.path());
    let told = answer(folder.path(), &[image, "--hfov", "auto"]);
    assert_eq!(told["camera"]["origin"], "estimated");
    let estimate = &told["camera"]["estimate"];
    let hfov = estimate["hfov_deg"].as_f64().unwrap();
    let interval: Vec<f64> = serde_json::from_value(estimate["hfov_interval_68_deg"].clone()).unwrap();
    assert!(interval[0] < hfov && hfov < interval[1], "{estimate}");
    // It has 81.4 degrees.
    assert!((60.0..105.0).contains(&hfov), "{estimate}");
    let focal = told["camera"]["projection"][0][0].as_f64().unwrap();
    assert!((2.0 * (621.0 / focal).atan().to_degrees() - hfov).abs() < 1e-6, "{focal} {hfov}");

    // The same field of view, known: the same boxes, and narrower error bars.
    let known = answer(folder.path(), &[image, "--hfov", &hfov.to_string()]);
    assert!(known["camera"].get("estimate").is_none(), "{known}");
    let objects = |told: &Value| told["detections"].as_array().unwrap().clone();
    let (estimated, known) = (objects(&told), objects(&known));
    assert!(!known.is_empty() && known.len() == estimated.len(), "{} {}", known.len(), estimated.len());
    let log_sigma = ((interval[1].to_radians() / 2.0).tan() / (hfov.to_radians() / 2.0).tan()).ln();
    for (unsure, sure) in estimated.iter().zip(&known) {
        let of = |object: &Value, name: &str| object[name].as_f64().unwrap();
        let (wide, narrow) = (of(unsure, "range_sigma_m"), of(sure, "range_sigma_m"));
        assert!(wide > narrow && wide > 0.8 * log_sigma * of(unsure, "range_m"), "{unsure} {sure}");
    }
}

#[test]
fn what_is_known_is_not_estimated() {
    let folder = tempfile::tempdir().unwrap();
    let scene = program::root().join("assets/scenes/image_2/000000.jpg");
    let told = answer(folder.path(), &[scene.to_str().unwrap(), "--hfov", "auto"]);
    assert_eq!(told["camera"]["origin"], "calibration");
    assert!(told["camera"].get("estimate").is_none());
}

#[test]
fn an_image_of_one_pixel_says_little() {
    let folder = tempfile::tempdir().unwrap();
    image::RgbImage::new(1, 1).save(folder.path().join("dot.png")).unwrap();
    let told = answer(folder.path(), &["dot.png", "--hfov", "auto"]);
    assert_eq!(told["detections"], serde_json::json!([]));
    assert!(told["camera"]["estimate"]["hfov_deg"].as_f64().unwrap() > 0.0);
}

#[test]
fn a_film_has_one_camera() {
    let folder = tempfile::tempdir().unwrap();
    for (place, name) in ["000000", "000001", "000002"].into_iter().enumerate() {
        let scene = program::root().join(format!("assets/scenes/image_2/{name}.jpg"));
        fs::copy(scene, folder.path().join(format!("{place}.jpg"))).unwrap();
    }
    let words = ["track", ".", "--fps", "10", "--hfov", "auto", "--json", "-", "--model", "farsight-n"];
    let lines = program::done(folder.path(), &words);
    assert_eq!(lines.lines().count(), 3, "{lines}");
}

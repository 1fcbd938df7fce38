//! Cameras that look down, which nobody says: what is seen says it.

use std::fs;
use std::path::Path;

use crate::program::{done, farsight, one_camera};
use serde_json::Value;

/// Vehicles that are told, and what is told besides.
fn vehicles(folder: &Path, options: &[&str]) -> (usize, String) {
    let range = ["range", "data/training/image_2", "--fx", "672", "--json", "found.json"];
    let output = farsight(folder, &[&range[..], options].concat());
    let told = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{told}");
    let records: Value = serde_json::from_str(&fs::read_to_string(folder.join("found.json")).unwrap()).unwrap();
    let found = records.as_array().unwrap().iter().flat_map(|record| record["detections"].as_array().unwrap());
    let is_vehicle = |one: &&Value| ["Car", "Van", "Truck"].contains(&one["class"].as_str().unwrap());
    (found.filter(is_vehicle).count(), told)
}

#[test]
fn a_camera_that_looks_down_finds_as_much_as_one_of_which_it_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    // Behind the windscreen of a car.
    fs::write(folder.join("world.toml"), one_camera([1.0, 1.4], 0.7, 1.5, 9.0)).unwrap();
    done(folder, &["synth", "--scene-config", "world.toml", "--out", "data", "--frames", "6", "--seed", "5"]);
    let (unsaid, note) = vehicles(folder, &[]);
    let told = note.lines().find(|line| line.contains("taken to look down by")).unwrap_or_else(|| panic!("{note}"));
    assert!(told.ends_with("degrees, by what is seen (--pitch tells)"), "{told}");
    let (said, note) = vehicles(folder, &["--pitch", "9"]);
    assert!(!note.contains("look down"), "{note}");
    let (level, _) = vehicles(folder, &["--pitch", "0"]);
    assert!(unsaid > level && 10 * unsaid >= 9 * said, "{unsaid} found, {said} if it is said, {level} if level");
}

#[test]
fn no_camera_looks_straight_down() {
    let output = farsight(Path::new("."), &["range", "a.jpg", "--hfov", "70", "--pitch", "90"]);
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(told.contains("--pitch <DEG>': expected degrees, from -45 to 60"), "{told}");
}

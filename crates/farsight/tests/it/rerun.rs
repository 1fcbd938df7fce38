//! `--rerun`, opened by rerun's own reader (Python package `rerun-sdk` of the same version).

#[allow(dead_code, reason = "each test uses a part of it")]
use crate::program;
use std::process::Command;

use serde_json::{Value, json};

const READER: &str = include_str!("../../../farsight-recordings/tests/support/rerun_reader.py");

#[test]
fn a_recording_has_every_image_and_what_was_found_in_it() {
    let folder = tempfile::tempdir().unwrap();
    let images = program::root().join("assets/scenes/image_2");
    let [first, second] = ["000000.jpg", "000001.jpg"].map(|name| images.join(name).to_string_lossy().into_owned());
    let words = ["range", &first, &second, "--hfov", "81.4", "--format", "jsonl", "--rerun", "two.rrd"];
    let printed = program::done(folder.path(), &words);
    let told: Vec<Value> = printed.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let file = folder.path().join("two.rrd");
    assert!(file.is_file());
    if !Command::new("python3").args(["-c", "import rerun.experimental"]).output().is_ok_and(|it| it.status.success()) {
        return eprintln!("skipped: no python3 with rerun-sdk, so the recording was not opened");
    }
    let output = Command::new("python3").args(["-c", READER]).arg(&file).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let rows: Vec<Value> =
        serde_json::Deserializer::from_slice(&output.stdout).into_iter().map(Result::unwrap).collect();
    let values = |name: &str| {
        let has_it = rows.iter().filter(|row| !row[name].is_null());
        has_it.map(|row| (row["time"].clone(), row[name].clone())).collect::<Vec<_>>()
    };
    let labels: Vec<(Value, usize)> =
        values("Boxes3D:labels").into_iter().map(|(time, labels)| (time, labels.as_array().unwrap().len())).collect();
    // Images have no times: one a second.
    let found = |place: usize| told[place]["detections"].as_array().unwrap().len();
    assert_eq!(labels, [(json!(0.0), found(0)), (json!(1.0), found(1))]);
    assert!(found(0) > 0);
    let sizes = told.iter().map(|image| json!([[image["width"].as_f64(), image["height"].as_f64()]]));
    let resolutions: Vec<Value> = values("Pinhole:resolution").into_iter().map(|(_, size)| size).collect();
    assert_eq!(resolutions, sizes.collect::<Vec<_>>());
    assert_eq!(values("EncodedImage:blob").len(), 2);
}

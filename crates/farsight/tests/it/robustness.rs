//! `farsight robustness`: worse images, worse figures; nothing else changes.

use std::fs;

use crate::program::{done, farsight};
use serde_json::Value;

#[test]
fn corruptions_and_weather_are_judged_beside_the_images_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    done(folder, &["synth", "--out", "kitti", "--frames", "2", "--seed", "4"]);
    let asked = ["--corruptions", "contrast", "--severities", "1,5", "--refiner", "none"];
    let files = ["--json", "a.json", "--table", "t.json", "--plot", "a.png"];
    let text = done(folder, &[&["robustness", "--data", "kitti"], &files[..], &asked[..]].concat());
    assert_eq!(text.lines().filter(|line| line.starts_with("contrast")).count(), 2, "{text}");
    let rows = |file: &str| {
        let text = fs::read_to_string(folder.join(file)).unwrap();
        serde_json::from_str::<Value>(&text).unwrap()["rows"].as_array().unwrap().clone()
    };
    let found = |row: &Value| row["found"].as_u64().unwrap();
    let all = rows("a.json");
    assert_eq!(all.len(), 3);
    assert!(all[0]["severity"] == 0 && found(&all[0]) > 0 && found(&all[2]) < found(&all[0]), "{all:?}");
    assert!(image::open(folder.join("a.png")).unwrap().width() > 300);
    let text = fs::read_to_string(folder.join("t.json")).unwrap();
    let table = serde_json::from_str::<Value>(&text).unwrap();
    assert_eq!(table["columns"], serde_json::json!(["condition", "severity 1", "severity 5"]));
    let share = |cell: &Value| cell.as_str().unwrap().split('%').next().unwrap().parse::<f64>().unwrap();
    let told = table["rows"].as_array().unwrap();
    assert_eq!((told.len(), &told[1][0]), (2, &Value::from("contrast")));
    for (cell, row) in [(&told[0][1], &all[0]), (&told[1][1], &all[1]), (&told[1][2], &all[2])] {
        let expected = 100.0 * found(row) as f64 / row["objects"].as_f64().unwrap();
        assert!((share(cell) - expected).abs() <= 0.5, "{cell} of {row}");
        let bars = &row["error_bars"];
        let within = |key: &str| bars[key].as_f64().is_some_and(|share| (0.0..=1.0).contains(&share));
        let are_told = within("within_68") && within("within_90") && bars["mean_sigma_m"].as_f64() > Some(0.0);
        assert_eq!(are_told, found(row) > 0, "{row}");
    }

    let asked = ["--frames", "1", "--weather", "fog", "--severities", "5", "--refiner", "none"];
    done(folder, &[&["robustness", "--twins", "kitti", "--json", "b.json"], &asked[..]].concat());
    let all = rows("b.json");
    assert!(all.len() == 2 && all[1]["condition"] == "fog" && all[0]["objects"] == all[1]["objects"], "{all:?}");
}

#[test]
fn what_is_asked_for_is_checked_first() {
    let folder = tempfile::tempdir().unwrap();
    let told = |arguments: &[&str]| {
        let output = farsight(folder.path(), &[&["robustness"], arguments].concat());
        assert_eq!(output.status.code(), Some(2));
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    assert!(told(&["--data", "a", "--corruptions", "snow"]).contains("expected one of gaussian_noise, gaussian_blur"));
    assert!(told(&["--data", "a", "--severities", "6"]).contains("6 is not in 1..=5"));
    assert!(told(&["--data", "a", "--weather", "fog"]).contains("cannot be used with"));
    assert!(told(&["--data", "nowhere"]).contains("nowhere"));
}

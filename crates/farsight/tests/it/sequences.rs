//! `farsight synth --sequence` and `farsight eval-tracks`: rendered sequences, and tracks judged by them.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::fs;
use std::path::Path;

use crate::program::{done, farsight};
use serde_json::json;

const WORLD: &str = "left_hand_share = 0
density = [1.0, 1.0]
[[cameras]]
image_sizes = [[832, 256]]
focal_widths = [0.58, 0.58]
center = [0.5, 0.5]
height_m = [1.65, 1.65]
[places]
city = 1
residential = 0
suburban = 0
rural = 0
motorway = 0
car_park = 0
[weather]
clear = 1
cloudy = 0
overcast = 0
dusk = 0
night = 0
rain = 0
fog = 0
";

fn render(folder: &Path, out: &str, seed: &str) {
    fs::write(folder.join("world.toml"), WORLD).unwrap();
    let sequence = ["synth", "--sequence", "1", "--frames", "3", "--fps", "20", "--scene-config", "world.toml", "-q"];
    done(folder, &[&sequence[..], &["--out", out, "--seed", seed]].concat());
}

#[test]
fn the_speed_of_a_film_tells_how_high_its_camera_is() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("world.toml"), WORLD).unwrap();
    let sequence = ["synth", "--sequence", "1", "--frames", "14", "--fps", "10", "--seed", "5", "-q"];
    done(folder, &[&sequence[..], &["--scene-config", "world.toml", "--out", "data"]].concat());
    let film = ["track", "data/training/image_02/0000", "--fps", "10", "--model", "farsight-n"];
    let camera = ["--calib", "data/training/calib/0000.txt", "--ego", "data/training/oxts/0000.txt"];
    let noted = |more: &[&str]| {
        let output = farsight(folder, &[&film[..], &camera, more].concat());
        assert!(output.status.success(), "{output:?}");
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        let words: Vec<&str> = text.split("by its speed the camera is ").nth(1)?.split_whitespace().collect();
        Some([words[0], words[1].trim_start_matches('±')].map(|word| word.parse::<f64>().unwrap()))
    };
    let [height_m, sigma_m] = noted(&[]).unwrap();
    assert!((height_m - 1.65).abs() < 2.5 * sigma_m && sigma_m < 0.15, "{height_m} ±{sigma_m}");
    assert_eq!(noted(&["--above-road", "1.65"]), None, "it is known");
}

/// Tracks that say what the labels say, each box shifted ahead by so much.
fn told(folder: &Path, ahead_m: f64, rename: impl Fn(u64, u64) -> u64) -> String {
    let labels = fs::read_to_string(folder.join("training/label_02/0000.txt")).unwrap();
    let mut lines = String::new();
    for frame in 0..3_u64 {
        let mut tracks = Vec::new();
        for row in labels.lines() {
            let fields: Vec<&str> = row.split(' ').collect();
            if fields[0] != frame.to_string() || fields[1] == "-1" {
                continue;
            }
            let number = |place: usize| fields[place].parse::<f64>().unwrap();
            let z = number(15) + ahead_m;
            tracks.push(json!({
                "id": rename(frame, fields[1].parse().unwrap()), "class": fields[2], "score": 0.9, "age": frame + 1,
                "box2d": [number(6), number(7), number(8), number(9)],
                "dimensions_hwl": [number(10), number(11), number(12)],
                "location": [number(13), number(14), z], "rotation_y": number(16),
                "range_m": z, "range_sigma_m": 1.0, "range_interval_m": [z - 1.6, z + 1.6],
                "velocity_mps": null, "velocity_sigma_mps": null, "closing_mps": null, "closing_sigma_mps": null,
                "ttc_s": null, "ttc_interval_s": null, "coasting": false,
            }));
        }
        writeln!(lines, "{}", json!({"frame": frame, "time_s": 0.05 * frame as f64, "tracks": tracks})).unwrap();
    }
    lines
}

#[test]
fn a_sequence_is_rendered_and_its_own_truth_has_full_marks() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    render(folder, "a", "3");
    let training = folder.join("a/training");
    for name in ["image_02/0000/000002.png", "label_02/0000.txt", "calib/0000.txt", "oxts/0000.txt"] {
        assert!(training.join(name).is_file(), "{name}");
    }
    let oxts = fs::read_to_string(training.join("oxts/0000.txt")).unwrap();
    assert!(oxts.lines().count() == 3 && oxts.lines().all(|row| row.split(' ').count() == 30), "{oxts}");
    let refused = farsight(folder, &["synth", "--sequence", "--out", "a", "--frames", "3"]);
    assert!(String::from_utf8(refused.stderr).unwrap().contains("there is a data set here already"));

    let judge = |tracks: &str, more: &[&str]| {
        fs::write(folder.join("tracks.jsonl"), tracks).unwrap();
        let common =
            ["eval-tracks", "--labels", "a/training/label_02", "--tracks", "tracks.jsonl", "--json", "out.json"];
        let printed = done(folder, &[&common[..], more].concat());
        let figures: serde_json::Value = serde_json::from_slice(&fs::read(folder.join("out.json")).unwrap()).unwrap();
        (printed, figures)
    };
    let same = |_: u64, id: u64| id + 5;
    let truth = told(&folder.join("a"), 0.0, same);
    let (_, figures) = judge(&truth, &[]);
    for place in ["image", "space"] {
        let hota = figures["all"][place]["hota"].as_f64().unwrap();
        assert!((hota - 1.0).abs() < 1e-6, "{figures}");
    }
    fs::write(folder.join("truth.jsonl"), truth).unwrap();
    let (printed, figures) = judge(&told(&folder.join("a"), 1.0, same), &["--against", "truth.jsonl"]);
    let off = figures["all"]["errors"]["depth_mae_m"].as_f64().unwrap();
    assert!((off - 1.0).abs() < 1e-9, "{figures}");
    assert!(printed.contains("distance MAE, m: 1.000 against 0.000"), "{printed}");
    // Who is another in each frame is found, and never known again.
    let (_, figures) = judge(&told(&folder.join("a"), 0.0, |frame, id| 1000 * frame + id), &[]);
    let image = &figures["all"]["image"];
    assert!(image["det_a"].as_f64().unwrap() > 0.999 && image["ass_a"].as_f64().unwrap() < 0.5, "{figures}");
}

#[test]
fn what_cannot_be_judged_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("0000.txt"), "0 7 Car 0 0\n").unwrap();
    fs::write(folder.join("empty.txt"), "").unwrap();
    fs::write(folder.join("0000.jsonl"), "{\"frame\": 1}\n").unwrap();
    for (labels, tracks, expected) in [
        ("nowhere", "0000.jsonl", "error: nowhere: cannot be read: "),
        ("0000.txt", "0000.jsonl", "error: 0000.txt:1: "),
        ("empty.txt", "nowhere", "error: nowhere: cannot be read: "),
    ] {
        let output = farsight(folder, &["eval-tracks", "--labels", labels, "--tracks", tracks]);
        let told = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(2) && told.starts_with(expected), "{told}");
    }
    fs::write(folder.join("good.txt"), "0 7 Car 0 0 -1.5 600 170 700 230 1.5 1.6 4.0 1.0 1.7 20.0 -1.57\n").unwrap();
    let output = farsight(folder, &["eval-tracks", "--labels", "good.txt", "--tracks", "0000.jsonl"]);
    let told = String::from_utf8(output.stderr).unwrap();
    assert!(told.starts_with("error: 0000.jsonl:1: no frame of tracks: "), "{told}");
}

/// Identity, place and size of each object of a file of tracking labels, by frame and identity.
fn objects(labels: &Path) -> BTreeMap<(u64, i64), [f64; 6]> {
    let text = fs::read_to_string(labels).unwrap();
    let row = |line: &str| {
        let fields: Vec<&str> = line.split(' ').collect();
        let number = |place: usize| fields[place].parse::<f64>().unwrap();
        ((fields[0].parse().unwrap(), fields[1].parse().unwrap()), [10, 11, 12, 13, 14, 15].map(number))
    };
    text.lines().map(row).filter(|((_, id), _)| *id >= 0).collect()
}

#[test]
fn label_files_of_tracks_are_rendered_again() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    render(folder, "a", "3");
    let again = |out: &str, rest: &[&str]| {
        let layout =
            ["synth", "--sequence", "--layout", "a/training/label_02", "--calib-dir", "a/training/calib", "-q"];
        let rest = [&["--fps", "20", "--seed", "8", "--out", out], rest].concat();
        farsight(folder, &[&layout[..], &rest].concat())
    };
    let told = again("b", &["--oxts-dir", "a/training/oxts", "--frames", "2"]);
    assert!(told.status.success(), "{}", String::from_utf8_lossy(&told.stderr));
    let [first, second] = ["a", "b"].map(|name| objects(&folder.join(name).join("training/label_02/0000.txt")));
    assert!(second.len() > 2 && second.keys().all(|(frame, _)| *frame < 2), "{second:?}");
    for (key, found) in &second {
        // The label file has two decimals of each metre.
        let expected = first[key];
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 0.011), "{key:?}: {found:?}, not {expected:?}");
    }
    // The camera drives as it did.
    let speeds = ["a", "b"].map(|name| {
        let text = fs::read_to_string(folder.join(name).join("training/oxts/0000.txt")).unwrap();
        text.lines().next().unwrap().split(' ').nth(8).unwrap().parse::<f64>().unwrap()
    });
    assert!((speeds[0] - speeds[1]).abs() < 1e-6, "{speeds:?}");
    // What is missing is named.
    let told = again("c", &["--oxts-dir", "a/training/nothing"]);
    assert!(!told.status.success());
    let error = String::from_utf8_lossy(&told.stderr);
    assert!(error.contains("a/training/nothing/0000.txt"), "{error}");
}

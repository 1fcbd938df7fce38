//! What `farsight range` prints for other programs, how an interrupted run goes on, and what is about the results.

use std::fs;
use std::path::Path;

use crate::program::{done, farsight, root};
use farsight::json::ImageRecord;

/// Copies of the shipped scenes, which need no calibration.
fn copies(folder: &Path) {
    fs::create_dir(folder.join("in")).unwrap();
    for id in ["000000", "000001", "000002"] {
        let scene = root().join(format!("assets/scenes/image_2/{id}.jpg"));
        fs::copy(scene, folder.join(format!("in/{id}.jpg"))).unwrap();
    }
}

// The smallest model, for time.
const RANGE: [&str; 6] = ["range", "in", "--hfov", "81", "--model", "farsight-n"];

fn lines(text: &str) -> Vec<ImageRecord> {
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

#[test]
fn one_answer_in_every_format() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    copies(folder);
    let range = |more: &[&str]| done(folder, &[&RANGE[..], more].concat());
    range(&["--json", "all.json"]);
    let file = fs::read_to_string(folder.join("all.json")).unwrap();
    assert_eq!(range(&["--json", "-"]), file);
    assert_eq!(range(&["--format", "json"]), file);
    let array: Vec<ImageRecord> = serde_json::from_str(&file).unwrap();
    assert_eq!(array.len(), 3);
    assert_eq!(lines(&range(&["--format", "jsonl", "--json", "all.jsonl"])), array);
    assert_eq!(lines(&fs::read_to_string(folder.join("all.jsonl")).unwrap()), array);
    assert!(range(&["--format", "table"]).starts_with("image   class "));
    assert!(!folder.join("all.json.partial").exists());
    let told = farsight(folder, &[&RANGE[..], &["--json", "-", "--format", "jsonl"]].concat());
    assert_eq!(told.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&told.stderr).contains("--json - prints an array"));
}

#[test]
fn an_interrupted_run_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    copies(folder);
    let range = |more: &[&str]| farsight(folder, &[&RANGE[..], more].concat());
    let text = |name: &str| fs::read_to_string(folder.join(name)).unwrap();
    assert!(range(&["--json", "whole.jsonl", "--kitti", "whole"]).status.success());
    let whole = text("whole.jsonl");
    let first = whole.lines().next().unwrap();

    // Killed while the second line was written.
    fs::write(folder.join("cut.jsonl"), &whole[..first.len() + 100]).unwrap();
    let output = range(&["--json", "cut.jsonl", "--resume"]);
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success() && told.contains("1 image left out, whose answers are there"), "{told}");
    assert_eq!(text("cut.jsonl"), whole);
    let shown = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(!shown.contains("000000") && shown.contains("000001"), "{shown}");

    // An array: what was done stands beside it.
    fs::write(folder.join("all.json.partial"), format!("{first}\n")).unwrap();
    assert!(range(&["--json", "all.json", "--resume"]).status.success());
    let array: Vec<ImageRecord> = serde_json::from_str(&text("all.json")).unwrap();
    assert_eq!(array, lines(&whole));
    assert!(!folder.join("all.json.partial").exists());

    // An image without its rows is looked at again.
    fs::remove_file(folder.join("whole/000002.txt")).unwrap();
    let told = range(&["--json", "whole.jsonl", "--kitti", "whole", "--resume"]);
    assert!(String::from_utf8_lossy(&told.stderr).contains("2 images left out"));
    assert!(folder.join("whole/000002.txt").is_file());
    assert_eq!(lines(&text("whole.jsonl")).len(), 3);

    let other = range(&["--json", "whole.jsonl", "--refiner", "none", "--resume"]);
    let told = String::from_utf8_lossy(&other.stderr).into_owned();
    assert!(told.contains("whole.jsonl: answers of another model; leave out --resume to begin anew"), "{told}");
    assert_eq!(lines(&text("whole.jsonl")).len(), 3);
    let told = range(&["--resume"]);
    assert!(String::from_utf8_lossy(&told.stderr).contains("expected --json FILE, --out or --kitti beside it"));
}

#[test]
fn what_is_about_the_results_can_be_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    copies(folder);
    fs::write(folder.join("in/empty.png"), "").unwrap();
    let errors = |more: &[&str]| {
        let output = farsight(folder, &[&RANGE[..], more].concat());
        assert_eq!(output.status.code(), Some(1));
        String::from_utf8(output.stderr).unwrap()
    };
    assert!(errors(&[]).lines().count() > 1);
    for quiet in [&["--quiet"][..], &["-q"], &["--log-level", "error"]] {
        let told = errors(quiet);
        assert!(told.lines().count() == 1 && told.starts_with("error: in/empty.png"), "{told}");
    }
}

#[test]
fn shells_and_manuals_know_every_command() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let script = done(folder, &["completions", shell]);
        assert!(script.contains("max-overlap") && script.contains("doctor"), "{shell}");
    }
    assert!(done(folder, &["man"]).contains(".TH farsight 1"));
    assert!(done(folder, &["man", "range"]).contains("max\\-overlap"));
    assert!(!farsight(folder, &["man", "nothing"]).status.success());
}

/// The hash of the detector that runs unless another is named.
fn hash_in_use() -> String {
    farsight::Pipeline::shipped().unwrap().info().weights_sha256.clone().unwrap()
}

#[test]
fn the_shipped_model_can_be_named() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    // "shipped" is what runs unless another is named: in `info`, in `export`, and in the answers.
    let hash = |info: &str| info.lines().find(|line| line.starts_with("weights SHA-256")).unwrap().to_owned();
    let shipped = done(folder, &["info", "shipped"]);
    assert_eq!(shipped, done(folder, &["info", "farsight-w"]));
    assert!(shipped.contains("views, by focal length"), "{shipped}");
    done(folder, &["export", "--model", "shipped", "--out", "w.onnx"]);
    assert_eq!(hash(&done(folder, &["info", "w.onnx"])), hash(&shipped));
    let used = hash_in_use();
    assert!(hash(&shipped).ends_with(&used), "{shipped}: {used}");

    for other in ["farsight-n", "farsight-s"] {
        let told = hash(&done(folder, &["info", other]));
        assert_ne!(told, hash(&shipped));
        done(folder, &["export", "--model", other, "--out", "other.onnx"]);
        assert_eq!(hash(&done(folder, &["info", "other.onnx"])), told);
    }
    // A file of that name is named with its folder.
    std::fs::copy(folder.join("other.onnx"), folder.join("shipped")).unwrap();
    assert_eq!(hash(&done(folder, &["info", "./shipped"])), hash(&done(folder, &["info", "farsight-s"])));
}

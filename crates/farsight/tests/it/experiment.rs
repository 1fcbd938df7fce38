//! `farsight experiment run`: cells in order, nothing done twice, killed at any moment, told when it belongs to another
//! plan.

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

use crate::program::{done, farsight};
use serde_json::Value;

/// Two arms and two seeds of a network of 16 channels, three steps each.
const PLAN: &str = r#"
name = "tiny"
data = { train = "train", evaluate = "val" }
endpoints = { primary = ["ap3d", "mae", "found"], least_seeds = 2, resamples = 50 }

[base]
method = "smoke"

[base.model]
input = [96, 32]
level_channels = [16, 16, 16, 16, 16, 16]
head_channels = 16
norm = "batch"
neck = "plain"
heatmap = { rule = "corner_net", min_overlap = 0.7 }
antialias = true
depth = { mean_m = 28.01, std_m = 16.32, focal_px = 55.8 }

[base.train]
epochs = 3
batch_size = 2
learning_rate = 1e-3
threads = 1
checkpoint_steps = 1
log_steps = 1

[arms.plain]
title = "plain"

[arms.wide]
title = "floor of two"
patch.model.heatmap = { rule = "fixed", radius = 0.0, min_radius = 2.0 }

[[blocks]]
arms = ["plain", "wide"]
seeds = [1, 2]

[[comparisons]]
arm = "wide"
against = "plain"
claims = { ap3d = 5.0 }
"#;

const CELLS: [&str; 4] = ["plain-1", "wide-1", "plain-2", "wide-2"];

/// A plan, and labels of four frames to render twins of.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    fs::write(root.join("plan.toml"), PLAN).unwrap();
    done(root, &["synth", "--out", "kitti", "--frames", "4", "--seed", "6"]);
    fs::write(root.join("kitti/ImageSets/train.txt"), "000000\n000001\n").unwrap();
    fs::write(root.join("kitti/ImageSets/val.txt"), "000002\n000003\n").unwrap();
    folder
}

fn arguments<'a>(out: &'a str, results: &'a str) -> Vec<&'a str> {
    let fixed = ["experiment", "run", "plan.toml", "--data", "twins", "--kitti", "kitti", "--out"];
    fixed.into_iter().chain([out, "--results", results]).collect()
}

fn json(path: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

fn start(root: &Path, out: &str, results: &str) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_farsight"));
    command.args(arguments(out, results)).current_dir(root).stdout(Stdio::null()).stderr(Stdio::null());
    command.spawn().unwrap()
}

/// How many files of any cell are there, and how long the metrics are: what grows while an experiment runs.
fn come_to(out: &Path) -> usize {
    let length = |path: &Path| fs::metadata(path).map_or(0, |data| data.len() as usize);
    CELLS.iter().map(|cell| length(&out.join(cell).join("metrics.jsonl"))).sum()
}

#[test]
#[ignore = "takes long: `cargo xtask test --all`"]
fn a_killed_experiment_ends_as_one_left_alone() {
    let folder = folder();
    let root = folder.path();
    let listed = done(root, &["experiment", "run", "plan.toml", "--list", "--results", "whole.json"]);
    assert!(listed.contains("plain-1") && listed.contains("0 of 4 cells"), "{listed}");
    let told = done(root, &arguments("whole", "whole.json"));
    let order: Vec<&str> = told.lines().map(|line| line.split(':').next().unwrap()).collect();
    assert_eq!(order, CELLS);
    assert!(!root.join("twins.unfinished").exists() && root.join("twins/ImageSets/val.txt").exists());

    let mut kills = 0;
    let killed = root.join("killed");
    loop {
        let before = come_to(&killed);
        let mut child = start(root, "killed", "killed.json");
        while child.try_wait().unwrap().is_none() && come_to(&killed) == before {
            sleep(Duration::from_millis(3));
        }
        // Not always at the same place.
        sleep(Duration::from_millis(7 * kills % 40));
        if child.try_wait().unwrap().is_some() {
            break;
        }
        child.kill().unwrap();
        child.wait().unwrap();
        kills += 1;
        assert!(kills < 60, "it does not come forward");
    }
    assert!(kills >= 3, "it was too short to be killed");
    done(root, &arguments("killed", "killed.json"));
    assert_eq!(json(&root.join("killed.json")), json(&root.join("whole.json")));
    for cell in CELLS {
        let model = |out: &str| fs::read(root.join(out).join(cell).join("model.safetensors")).unwrap();
        assert!(model("whole") == model("killed"), "{cell}: the models differ");
    }

    let results = json(&root.join("whole.json"));
    assert_eq!(results["cells"].as_array().unwrap().len(), 4);
    assert_eq!(results["cells"][1]["arm"], "wide");
    assert_eq!(results["cells"][1]["steps"], 3);
    assert!(results["cells"][1]["ap3d"].is_number(), "{results}");
    let comparison = &results["comparisons"][0];
    assert_eq!((&comparison["metric"], &comparison["seeds"]), (&"ap3d".into(), &2.into()), "{results}");
    let keys: Vec<&String> = results.as_object().unwrap().keys().collect();
    assert_eq!(keys, ["arms", "cells", "comparisons"]);
    let arm = &results["arms"][0];
    assert_eq!((&arm["arm"], &arm["metric"], &arm["seeds"]), (&"plain".into(), &"ap3d".into(), &2.into()), "{results}");
}

#[test]
fn minutes_stop_at_a_checkpoint_and_the_same_command_goes_on() {
    let folder = folder();
    let root = folder.path();
    let timed = |out: &str| {
        let mut words = arguments(out, "timed.json");
        words.extend(["--minutes", "0.0001"]);
        farsight(root, &words)
    };
    let mut stops = 0;
    loop {
        let output = timed("timed");
        match output.status.code() {
            Some(75) => stops += 1,
            Some(0) => break,
            other => panic!("{other:?}: {}", String::from_utf8_lossy(&output.stderr)),
        }
        assert!(stops < 40, "it does not come forward");
    }
    // Steps, frames and cells: each goes on where it was.
    assert!(stops >= 8, "{stops}");
    done(root, &arguments("whole", "whole.json"));
    assert_eq!(json(&root.join("timed.json")), json(&root.join("whole.json")));

    // One cell alone, and a cell of another plan.
    let mut words = arguments("one", "one.json");
    words.extend(["--only", "wide-2"]);
    done(root, &words);
    assert_eq!(json(&root.join("one.json"))["cells"][0], json(&root.join("whole.json"))["cells"][3]);
    fs::write(root.join("plan.toml"), PLAN.replace("learning_rate = 1e-3", "learning_rate = 2e-3")).unwrap();
    let output = farsight(root, &arguments("whole", "whole.json"));
    assert_eq!(output.status.code(), Some(2));
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(told.contains("plain-1: a cell of another experiment"), "{told}");
}

#[test]
fn cells_are_compared_by_their_records_when_the_weights_that_they_started_from_are_gone() {
    let folder = folder();
    let root = folder.path();
    done(root, &[&arguments("first", "first.json")[..], &["--only", "plain-1"]].concat());
    fs::copy(root.join("first/plain-1/model.safetensors"), root.join("start.safetensors")).unwrap();
    let started = PLAN.replace("[base.train]\n", "[base.train]\nstart_from = \"start.safetensors\"\n");
    assert_ne!(started, PLAN);
    fs::write(root.join("plan.toml"), started).unwrap();
    done(root, &[&arguments("whole", "whole.json")[..], &["--only", "plain-1", "--only", "wide-1"]].concat());

    fs::rename(root.join("start.safetensors"), root.join("gone.safetensors")).unwrap();
    let only = ["--records", "whole-cells", "--only", "plain-1", "--only", "wide-1"];
    done(root, &[&arguments("again", "again.json")[..], &only].concat());
    assert_eq!(json(&root.join("again.json")), json(&root.join("whole.json")));
    // What is not done cannot be done without.
    let output = farsight(root, &[&arguments("again", "again.json")[..], &["--only", "plain-2"]].concat());
    assert_eq!(output.status.code(), Some(2));
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(told.contains("plain-2: start.safetensors: no such file"), "{told}");
    // Other weights of that name are another experiment's.
    fs::copy(root.join("first/plain-1/model.safetensors"), root.join("start.safetensors")).unwrap();
    done(root, &[&arguments("again", "again.json")[..], &only].concat());
    fs::copy(root.join("whole/plain-1/model.safetensors"), root.join("start.safetensors")).unwrap();
    let output = farsight(root, &[&arguments("again", "again.json")[..], &only].concat());
    assert_eq!(output.status.code(), Some(2));
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(told.contains("plain-1: a cell of another experiment"), "{told}");
}

#[test]
fn an_arm_goes_on_from_the_model_of_another_one_and_all_are_judged_on_other_data() {
    let folder = folder();
    let root = folder.path();
    done(root, &["synth", "--out", "others", "--frames", "3", "--seed", "9"]);
    fs::write(root.join("others/ImageSets/val.txt"), "000000\n000002\n").unwrap();
    let plan = PLAN
        .replace("[[blocks]]", "[arms.later]\ntitle = \"later\"\nafter = \"plain\"\n\n[[blocks]]")
        .replace("arms = [\"plain\", \"wide\"]\nseeds = [1, 2]", "arms = [\"plain\", \"later\"]\nseeds = [1]")
        .replace("\"found\"]", "\"found_03\"]")
        .replace("arm = \"wide\"", "arm = \"later\"");
    fs::write(root.join("plan.toml"), plan).unwrap();
    let words = ["experiment", "run", "plan.toml", "--data", "kitti", "--judge", "others", "--out", "out"];
    let words = [&words[..], &["--results", "results.json"]].concat();
    done(root, &words);
    let results = json(&root.join("results.json"));
    let answers = |cell: &str| {
        let files = fs::read_dir(root.join("out").join(cell).join("results")).unwrap();
        let mut names: Vec<String> = files.map(|file| file.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    };
    for (place, cell) in ["plain-1", "later-1"].into_iter().enumerate() {
        assert_eq!(results["cells"][place]["steps"], 3, "{results}");
        assert_eq!(answers(cell), ["000000.txt", "000002.txt"], "{cell}");
    }
    let config = fs::read_to_string(root.join("out/later-1/cell.toml")).unwrap();
    assert!(config.contains("plain-1/model.safetensors"), "{config}");

    // From its record, where nothing else is left of it.
    fs::rename(root.join("out"), root.join("first")).unwrap();
    done(root, &words);
    assert_eq!(json(&root.join("results.json")), results);
    // Without its record, and without the model from which it goes on.
    fs::remove_dir_all(root.join("out")).unwrap();
    fs::remove_file(root.join("results-cells/later-1.json.gz")).unwrap();
    let output = farsight(root, &words);
    assert_eq!(output.status.code(), Some(2));
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(told.contains("later-1: out/plain-1/model.safetensors: no such file"), "{told}");
}

/// Arms of three methods.
const METHODS: &str = r#"
name = "methods"
data = { train = "train", evaluate = "val" }
endpoints = { primary = ["ap3d", "mae", "found"], least_seeds = 1, resamples = 50 }

[base.train]
epochs = 2
batch_size = 2
threads = 1

[arms.smoke]
title = "SMOKE"
patch.method = "smoke"
patch.model = { input = [96, 32], level_channels = [16, 16, 16, 16, 16, 16], head_channels = 16, norm = "batch", neck = "plain" }

[arms.monodle]
title = "MonoDLE"
patch.method = "monodle"
patch.model = { input = [96, 32], width = 0.03, head_channels = 8, stem = "half" }

[arms.oftnet]
title = "OFTNet"
patch.method = "oftnet"
patch.model = { input = [96, 32], width = 0.05, blocks = 1, grid = { cell_m = 4.0, columns = 10, rows = 10, slabs = 2 } }

[arms.gs3d]
title = "GS3D"
patch.method = "gs3d"
patch.model = { input = [96, 32], backbone = "resnet18", width = 0.05, head_channels = 8, surface_channels = 4, hidden = 8 }

[arms.similar_triangles]
title = "similar triangles"
of = "smoke"
ranger = "similar_triangles"

[arms.estimated_horizon]
title = "inverse perspective"
of = "smoke"
ranger = "estimated_horizon"

[arms.box_mlp]
title = "perceptron"
of = "smoke"
ranger = "box_mlp"

[arms.shipped]
title = "farsight-s"
shipped = "farsight-s"

[[blocks]]
arms = ["smoke", "monodle", "oftnet", "gs3d", "similar_triangles", "estimated_horizon", "box_mlp", "shipped"]
seeds = [1]

[[comparisons]]
arm = "monodle"
against = "oftnet"
"#;

#[test]
fn arms_of_several_methods_are_trained_and_judged_alike() {
    let folder = folder();
    let root = folder.path();
    fs::write(root.join("plan.toml"), METHODS).unwrap();
    let told = done(root, &arguments("methods", "methods.json"));
    let order: Vec<&str> = told.lines().map(|line| line.split(':').next().unwrap()).collect();
    assert_eq!(order[..4], ["smoke-1", "monodle-1", "oftnet-1", "gs3d-1"]);
    assert_eq!(order[4..], ["similar_triangles-1", "estimated_horizon-1", "box_mlp-1", "shipped-1"]);
    let results = json(&root.join("methods.json"));
    for (cell, arm) in results["cells"].as_array().unwrap().iter().zip(["smoke", "monodle", "oftnet", "gs3d"]) {
        assert_eq!((&cell["arm"], &cell["steps"]), (&arm.into(), &2.into()), "{results}");
        assert!(cell["ap3d"].is_number(), "{results}");
    }
    assert_eq!(results["comparisons"][0]["seeds"], 1, "{results}");
    let of_smoke = |figure: &&Value| figure["arm"] == "smoke" && figure["metric"] == "ap3d";
    let alone = results["arms"].as_array().unwrap().iter().find(of_smoke).unwrap();
    assert_eq!(alone["value"], results["cells"][0]["ap3d"], "of one seed the mean is its value");

    // Rangers are of the boxes of SMOKE's answers; without steps, as the shipped model.
    let rows = |cell: &str| {
        let text = fs::read_to_string(root.join("methods").join(cell).join("results/000002.txt")).unwrap();
        let words = |line: &str| line.split(' ').map(str::to_owned).collect::<Vec<_>>();
        text.lines().map(words).collect::<Vec<_>>()
    };
    let smoke = rows("smoke-1");
    assert!(!smoke.is_empty(), "a network that answers nothing proves nothing");
    for ranger in ["similar_triangles-1", "estimated_horizon-1", "box_mlp-1"] {
        let ranged = rows(ranger);
        let is_there = |row: &Vec<String>| smoke.iter().any(|other| row[0] == other[0] && row[4..8] == other[4..8]);
        assert!(ranged.iter().all(is_there), "{ranger}: {ranged:?} of {smoke:?}");
        assert!(ranged.iter().any(|row| smoke.iter().all(|other| row[13] != other[13])), "{ranger} has its own depths");
    }
    let found = |cell: &Value| cell["found"].as_f64().unwrap();
    let shipped = &results["cells"][7];
    assert_eq!(shipped["steps"], 0);
    assert!(found(shipped) > found(&results["cells"][0]), "{results}");

    // A field of another method is told before anything is rendered.
    fs::write(root.join("plan.toml"), METHODS.replace("blocks = 1, ", "blocks = 1, msfe = \"a\", ")).unwrap();
    let words = ["experiment", "run", "plan.toml", "--data", "nowhere", "--kitti", "kitti", "--out", "other"];
    let output = farsight(root, &words);
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(2) && !root.join("nowhere").exists(), "{told}");
    assert!(told.contains("arms.oftnet") && told.contains("msfe"), "{told}");
}

#[test]
fn arms_are_timed_and_drawn_against_what_they_are_worth() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    fs::write(root.join("plan.toml"), PLAN).unwrap();
    let time = ["experiment", "time", "plan.toml", "--engines", "rten", "--runs", "1", "--out", "times.json"];
    let told = done(root, &time);
    assert!(told.contains("| floor of two |"), "{told}");
    let times = json(&root.join("times.json"));
    let of_arm = |arm: &Value| (arm["arm"].as_str().unwrap().to_owned(), arm["ms"].as_f64().unwrap() > 0.0);
    let found: Vec<(String, bool)> = times["arms"].as_array().unwrap().iter().map(of_arm).collect();
    assert_eq!(found, [("plain".to_owned(), true), ("wide".to_owned(), true)]);

    let cell = |arm: &str, ap: f64| serde_json::json!({ "arm": arm, "seed": 1, "steps": 3, "ap3d": ap, "mae": 1.5 });
    let results = serde_json::json!({ "cells": [cell("plain", 4.0), cell("wide", 6.0)], "comparisons": [] });
    fs::write(root.join("results.json"), results.to_string()).unwrap();
    let plot = ["experiment", "plot", "plan.toml", "--results", "results.json", "--times", "times.json"];
    let with = |more: &[&'static str]| [&plot[..], more].concat();
    done(root, &with(&["--metrics", "ap3d,mae", "--out", "plot.svg"]));
    let drawn = fs::read_to_string(root.join("plot.svg")).unwrap();
    assert_eq!(drawn.matches("<circle").count(), 4);
    assert!(drawn.contains("MAE, metres") && drawn.contains(">floor of two</text>"));

    for (more, expected) in [
        (["--out", "plot.png", "--engine", "rten"], "expected a name ending in .svg"),
        (["--out", "other.svg", "--engine", "openvino"], "times.json: no times of \"openvino\"; expected one of rten"),
        (["--out", "other.svg", "--metrics", "found"], "no arm has both results and times"),
    ] {
        let output = farsight(root, &with(&more));
        assert!(!output.status.success());
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(told.contains(expected), "{told}");
    }
    assert!(!root.join("other.svg").exists());
}

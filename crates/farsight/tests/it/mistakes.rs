//! What the program refuses, and what it then leaves as it was: outputs over inputs, options that would be ignored,
//! files of another kind.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

use crate::program::{done, farsight, root};
use farsight_core::{ClassReference, ObjectClass};
use farsight_graph::init::initial_weights;
use farsight_graph::layers::{NeckKind, NormKind};
use farsight_graph::model::NetworkConfig;
use farsight_graph::weights::Weights;
use farsight_methods::centernet3d::{CenterNet3dConfig, CenterNet3dModel};
use farsight_methods::description::trained_methods;
use farsight_methods::smoke::SmokeModel;
use farsight_methods::smoke::config::SmokeConfig;

/// What the program says when it refuses to run.
fn refusal(folder: &Path, arguments: &[&str]) -> String {
    let output = farsight(folder, arguments);
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!((output.status.code(), output.stdout.len()), (Some(2), 0), "{arguments:?}: {told}");
    told
}

/// Writes a small network with fresh weights, which takes everything for a van.
fn write_small_model(folder: &Path) {
    let mut classes = ClassReference::smoke();
    for (class, name) in classes.iter_mut().zip([ObjectClass::Van, ObjectClass::Truck, ObjectClass::Tram]) {
        class.class = name;
    }
    let (norm, neck) = (NormKind::Batch, NeckKind::Plain);
    let config = SmokeConfig { input: [96, 64], width: 0.25, norm, neck, classes, ..SmokeConfig::default() };
    let weights = initial_weights(&config.graph(), 1);
    SmokeModel::new(config, weights).unwrap().write(&folder.join("m.safetensors")).unwrap();
}

fn text(folder: &Path, name: &str) -> String {
    fs::read_to_string(folder.join(name)).unwrap()
}

#[test]
fn results_replace_no_labels_and_a_models_own_classes_are_nothing_odd() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_small_model(folder);
    done(folder, &["synth", "--out", "k", "--frames", "1", "--seed", "3"]);
    let files = ["k/training/label_2/000000.txt", "k/training/calib/000000.txt"];
    let before = files.map(|name| text(folder, name));
    fs::create_dir(folder.join("copies")).unwrap();
    fs::copy(folder.join(files[0]), folder.join("copies/000000.txt")).unwrap();
    let eval = ["eval", "--data", "k", "--model", "m.safetensors", "--resamples", "0"];
    for (results, expected) in [
        (
            "k/training/label_2",
            "error: k/training/label_2: inputs come from this folder; expected another one for results\n",
        ),
        ("k/training/../training/calib", "calib: inputs come from this folder"),
        ("copies", "error: copies/000000.txt: there already and no result file; expected another folder for results\n"),
    ] {
        let told = refusal(folder, &[&eval[..], &["--results", results]].concat());
        assert!(told.contains(expected), "{told}");
    }
    assert_eq!(files.map(|name| text(folder, name)), before);
    assert_eq!(text(folder, "copies/000000.txt"), before[0]);

    for (option, target, expected) in [
        ("--json", files[0], "there already and no JSON; expected another file"),
        ("--json", "m.safetensors", "m.safetensors: an input; expected another file for the JSON"),
        ("--json", "nowhere/a.json", "error: nowhere/a.json: no folder nowhere; expected one that is there\n"),
        ("--json", "copies", "error: copies: a folder; expected the name of a file to write\n"),
        ("--report", "m.safetensors", "m.safetensors: cannot be made"),
        ("--report", "m.safetensors/page", "m.safetensors/page: cannot be made"),
    ] {
        let told = refusal(folder, &[&eval[..], &[option, target]].concat());
        assert!(told.contains(expected), "{told}");
    }

    // Vans and trucks, and twice into one folder.
    for _ in 0..2 {
        let output = farsight(folder, &[&eval[..], &["--strict", "--results", "kept"]].concat());
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success() && told.contains("1 frame looked at by rten"), "{told}");
    }
    assert!(text(folder, "kept/000000.txt").contains("Van"));
}

#[test]
fn an_image_that_fails_loses_no_other_ones() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_small_model(folder);
    done(folder, &["synth", "--out", "k", "--frames", "3", "--seed", "3"]);
    let eval = ["eval", "--data", "k", "--model", "m.safetensors", "--resamples", "0", "--results", "kept"];
    done(folder, &eval);
    fs::write(folder.join("k/training/image_2/000001.png"), "no picture").unwrap();
    let output = farsight(folder, &eval);
    let [answer, told] = [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes).into_owned());
    assert_eq!(output.status.code(), Some(1), "{told}");
    assert!(answer.starts_with("2 frames"), "{answer}");
    assert!(told.contains("000001.png: no image that is known here"), "{told}");
    assert!(told.ends_with("error: 1 frame failed, see above; not in these figures\n"), "{told}");
    assert!(folder.join("kept/000002.txt").exists() && !folder.join("kept/000001.txt").exists());

    for id in ["000000", "000002"] {
        fs::write(folder.join(format!("k/training/image_2/{id}.png")), "no picture").unwrap();
    }
    let told = refusal(folder, &eval);
    assert!(told.ends_with("error: nothing was evaluated: 3 frames failed\n"), "{told}");
}

#[test]
fn many_frames_that_fail_are_told_in_few_lines() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_small_model(folder);
    done(folder, &["synth", "--out", "k", "--frames", "9", "--seed", "3"]);
    for id in 0..8 {
        fs::write(folder.join(format!("k/training/image_2/{id:06}.png")), "no picture").unwrap();
    }
    let output = farsight(folder, &["eval", "--data", "k", "--model", "m.safetensors", "--resamples", "0"]);
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!((output.status.code(), told.matches("no image that is known here").count()), (Some(1), 5), "{told}");
    assert!(told.contains("error: 3 more frames failed\n"), "{told}");
    assert!(told.ends_with("error: 8 frames failed, see above; not in these figures\n"), "{told}");
}

#[test]
fn scenes_replace_no_data_set() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for (there, expected) in [
        ("labels/training/label_2", "labels: there is a data set here already; name another --out"),
        ("calib/training/calib", "calib: there is a data set here already; name another --out"),
        (
            "stopped/ImageSets",
            "stopped: there is an interrupted data set here, without a split in ImageSets; --resume goes on with it, or remove it or name another --out",
        ),
    ] {
        fs::create_dir_all(folder.join(there)).unwrap();
        let out = there.split('/').next().unwrap();
        assert_eq!(refusal(folder, &["synth", "--out", out, "--frames", "1"]), format!("error: {expected}\n"));
    }
    fs::create_dir_all(folder.join("cameras")).unwrap();
    for id in ["000000", "000001", "000002"] {
        fs::write(folder.join(format!("labels/training/label_2/{id}.txt")), "").unwrap();
    }
    fs::write(folder.join("cameras/000000.txt"), "P2: 700 0 600 45 0 700 170 0.2 0 0 1 0.003\n").unwrap();
    let twin = ["synth", "--out", "twin", "--layout", "labels/training/label_2", "--calib-dir", "cameras"];
    assert_eq!(refusal(folder, &twin), "error: cameras/000001.txt: no such file; 2 files missing in all\n");
    assert!(!folder.join("twin").exists());
    for frames in ["0", "-1"] {
        let told = refusal(folder, &[&twin[..], &["--frames", frames]].concat());
        assert!(told.contains("for '--frames <N>': expected a whole number, at least 1"), "{told}");
    }
}

#[test]
fn a_scene_larger_than_any_camera_is_refused_before_it_is_made() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for (name, content) in [("labels", ""), ("cameras", "P2: 9000 0 6500 0 0 9000 6500 0 0 0 1 0\n")] {
        fs::create_dir(folder.join(name)).unwrap();
        fs::write(folder.join(name).join("000000.txt"), content).unwrap();
    }
    let told = refusal(folder, &["synth", "--out", "twin", "--layout", "labels", "--calib-dir", "cameras"]);
    let expected = "error: cameras/000000.txt: the camera of an image of ";
    assert!(told.starts_with(expected) && told.ends_with("; expected at most 16000000 in all\n"), "{told}");
}

#[test]
fn numbers_and_options_that_mean_nothing_here_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let range = ["range", "a.png", "--hfov", "80"];
    let eval = ["eval", "--labels", ".", "--results", "."];
    let table: [(&[&str], &[&str], &str); 24] = [
        (&range, &["--cx", "600"], "'--hfov <DEG>' cannot be used with"),
        (&range, &["--fy", "600"], "'--hfov <DEG>' cannot be used with"),
        (&["range", "a.png", "--calib", "c.txt"], &["--cy", "9"], "'--calib <FILE>' cannot be used with"),
        (&range, &["--above-road", "-1.65"], "expected metres, from 0.2 to 50, any or none"),
        (&range, &["--max-overlap", "-1"], "expected a number above 0 and at most 1"),
        (&range, &["--min-score", "-1"], "expected at least 0 and less than 1"),
        (
            &range,
            &["--json", "a.json", "--resume", "--mcap", "a.mcap"],
            "'--resume' cannot be used with '--mcap <FILE>'",
        ),
        (&eval, &["--min-score", "NaN"], "expected a finite number"),
        (&eval, &["--geometric-baselines", "--camera-height", "-1"], "expected a positive number of metres"),
        (&eval, &["--geometric-baselines", "--camera-height", "inf"], "expected a positive number of metres"),
        (&eval, &["--resamples", "99999999999"], "expected a number from 0 to 100000"),
        (&eval, &["--model", "m.safetensors"], "for a model that looks at images first; expected --data"),
        (&eval, &["--engine", "openvino"], "for a model that looks at images first; expected --data"),
        (&eval, &["--threads", "2"], "for a model that looks at images first; expected --data"),
        (&eval, &["--split", "val"], "error: val: no such file; a bare name such as val is for --data\n"),
        (
            &["bench"],
            &["--precision", "bf16"],
            "error: --precision bf16 is for openvino; expected --engine openvino beside it\n",
        ),
        (&["bench", "--engine", "onnxruntime"], &["--precision", "bf16"], "error: --precision bf16 is for openvino;"),
        (&["bench"], &["--device", "cuda"], "error: --device cuda is for onnxruntime; expected --engine onnxruntime"),
        (&["bench", "--engine", "onnxruntime"], &["--device", "gpu"], "error: --device gpu is for openvino;"),
        (&["bench"], &["--engine-path", "lib"], "error: --engine-path is for onnxruntime and openvino;"),
        (&["bench"], &["--json", "nowhere/a.json"], "nowhere/a.json: no folder nowhere; expected one that is there"),
        (&["parity", "--model", "a", "--golden", "b"], &["--tolerance", "-1"], "expected 0 or a positive number"),
        (&["prune", "--model", "a", "--out", "b"], &["--keep", "1.5"], "expected a share above 0 and at most 1"),
        (&["prune", "--model", "a", "--out", "b"], &["--keep", "-1"], "expected a share above 0 and at most 1"),
    ];
    for (command, options, expected) in table {
        let told = refusal(folder.path(), &[command, options].concat());
        assert!(told.contains(expected), "{options:?}: {told}");
    }
    // A score is a score.
    assert!(refusal(folder.path(), &[&eval[..], &["--min-score", "-3.5"]].concat()).contains("no .txt file"));
}

#[test]
fn files_of_another_kind_are_told_for_what_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_small_model(folder);
    done(folder, &["export", "--model", "m.safetensors", "--out", "m.onnx"]);
    image::RgbImage::new(96, 64).save(folder.join("photo.png")).unwrap();
    image::RgbImage::new(96, 64).save(folder.join("photo.jpg")).unwrap();
    fs::write(folder.join("run.toml"), "method = \"smoke\"\n").unwrap();
    fs::create_dir(folder.join("models")).unwrap();
    for (model, found) in [
        ("photo.png", "a PNG image"),
        ("photo.jpg", "a JPEG image"),
        ("run.toml", "a TOML file"),
        ("models", "a folder"),
        ("none", "no such file"),
    ] {
        let range = ["range", "photo.png", "--hfov", "80", "--model", model];
        let prune = ["prune", "--keep", "0.5", "--out", "p.safetensors", "--model", model];
        let export = ["export", "--out", "p.onnx", "--model", model];
        for arguments in [&range[..], &prune, &export] {
            let told = refusal(folder, arguments);
            assert!(told.starts_with(&format!("error: {model}: {found}; expected a model that ")), "{told}");
        }
    }
    assert!(
        refusal(folder, &["info", "photo.jpg"])
            .contains("photo.jpg: a JPEG image; expected a model, a refiner, a plate reader or")
    );
    let prune = ["prune", "--model", "m.onnx", "--keep", "0.5", "--out", "p.safetensors"];
    assert!(refusal(folder, &prune).contains("m.onnx: an ONNX file already; expected the model that it was made from"));

    let own = ["--model", "m.safetensors", "--out"];
    for (command, out, expected) in [
        (&["export"][..], "m2.safetensors", "m2.safetensors: expected a name ending in .onnx, or --half"),
        (&["export", "--half"], "h.onnx", "h.onnx: expected a name ending in .safetensors, as --half writes"),
        (&["prune", "--keep", "0.5"], "p.onnx", "p.onnx: expected a name ending in .safetensors"),
        (&["export"], "nowhere/m.onnx", "nowhere/m.onnx: no folder nowhere; expected one that is there"),
    ] {
        let told = refusal(folder, &[command, &own, &[out]].concat());
        assert!(told.contains(expected), "{told}");
    }
}

/// As [`refusal`], of a command that must not wait for anybody.
#[cfg(unix)]
fn prompt_refusal(folder: &Path, arguments: &[&str]) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_farsight"));
    command.args(arguments).current_dir(folder).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    let start = std::time::Instant::now();
    while child.try_wait().unwrap().is_none() {
        if start.elapsed().as_secs() >= 60 {
            child.kill().unwrap();
            panic!("{arguments:?}: waits");
        }
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    let output = child.wait_with_output().unwrap();
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {told}");
    told
}

#[cfg(unix)]
#[test]
fn pipes_and_devices_are_refused_as_any_input_and_not_waited_for() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_small_model(folder);
    image::RgbImage::new(96, 64).save(folder.join("photo.png")).unwrap();
    for name in ["pipe", "pipe.onnx", "pipe.safetensors", "pipe.toml", "pipe.json", "pipe.png"] {
        assert!(Command::new("mkfifo").arg(folder.join(name)).status().unwrap().success());
    }
    let range = ["range", "photo.png", "--hfov", "80"];
    let table: [(&[&str], &[&str]); 15] = [
        (&range, &["--model"]),
        (&[&range[..], &["--model", "m.safetensors"]].concat(), &["--refiner"]),
        (&[&range[..], &["--model", "m.safetensors"]].concat(), &["--plates"]),
        (&["range", "photo.png", "--model", "m.safetensors"], &["--calib"]),
        (&["range", "--hfov", "80", "--model", "m.safetensors"], &[]),
        (&["info"], &[]),
        (&["export", "--out", "x.onnx"], &["--model"]),
        (&["prune", "--keep", "0.5", "--out", "x.safetensors"], &["--model"]),
        (&["bench", "--runs", "1"], &["--model"]),
        (&["import", "--out", "x.safetensors"], &[]),
        (&["eval", "--results", "."], &["--labels"]),
        (&["eval-tracks", "--tracks", "photo.png"], &["--labels"]),
        (&["synth", "--out", "x", "--frames", "1"], &["--world"]),
        (&["track", "photo.png", "--fps", "10", "--hfov", "80", "--model", "m.safetensors"], &["--ego"]),
        (&["parity", "--golden", "m.safetensors"], &["--model"]),
    ];
    let inputs = ["pipe", "pipe.onnx", "pipe.safetensors", "pipe.toml", "pipe.png", "/dev/zero"];
    // A third of all pairs, each command and each input among them; every pair with `cargo xtask test --all`.
    let takes_all = std::env::var_os("FARSIGHT_FAULTS").is_some();
    for (row, (command, option)) in table.into_iter().enumerate() {
        for input in inputs.into_iter().enumerate().filter(|(i, _)| takes_all || (row + i) % 3 == 0).map(|(_, x)| x) {
            let told = prompt_refusal(folder, &[command, option, &[input]].concat());
            assert!(told.contains(input), "{command:?} {option:?}: {told}");
        }
    }
    assert!(!folder.join("x").exists() && !folder.join("x.onnx").exists() && !folder.join("x.safetensors").exists());
    // Files that nobody named are looked at, too.
    let told = done(folder, &["doctor"]);
    assert!(told.contains("./pipe.onnx"), "{told}");
}

#[test]
fn a_config_is_read_as_the_training_would() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let known = trained_methods().collect::<Vec<_>>().join(", ");
    assert!(known.contains("centernet3d") && known.contains("plate_reader") && !known.contains("ssd"), "{known}");
    let class = |name: &str| {
        format!("method = \"smoke\"\n[[model.classes]]\nclass = \"{name}\"\ndimensions_lhw = [3.88, 1.63, 1.53]\n")
    };
    for (config, expected) in [
        ("method = \"smoke\"\n[modell]\nwidth = 0.5\n", "unknown field `modell`"),
        ("method = \"smoke\"\n[augmentation]\nflip = 0.5\n", "unknown field `flip`"),
        ("method = \"smoke\"\n[model]\nside = 96\n", "unknown field `side`"),
        ("farthest_m = 75.0\n", "unknown field `farthest_m`"),
        (&class("Carr"), "model.classes names Carr; expected Car, as KITTI writes it"),
        (&class(""), "model.classes names \"\"; expected one word"),
        (&class("bus stop"), "model.classes names \"bus stop\"; expected one word"),
        ("[model]\nwidth = 0.5\n", &format!("method is missing; expected one of {known}")),
        ("method = \"smokey\"\n", &format!("method is \"smokey\"; expected one of {known}")),
    ] {
        fs::write(folder.join("run.toml"), config).unwrap();
        for command in [&["info", "run.toml"][..], &["bench", "--model", "run.toml"]] {
            let told = refusal(folder, command);
            assert!(told.contains(expected) && told.contains("run.toml: "), "{told}");
        }
    }
    let configs = fs::read_dir(root().join("configs")).unwrap().map(|entry| entry.unwrap().path());
    for config in configs.filter(|path| path.extension().is_some_and(|extension| extension == "toml")) {
        let output = farsight(folder, &["info", config.to_str().unwrap()]);
        // What describes scenes, or what is measured, describes no network.
        let describes_network = fs::read_to_string(&config).unwrap().lines().any(|line| line.starts_with("method = "));
        let told = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.success(), describes_network, "{}: {told}", config.display());
    }
}

#[test]
fn what_is_said_of_a_model_goes_with_it() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_small_model(folder);
    fs::write(folder.join("figures.json"), r#"{"ap": 12}"#).unwrap();
    let facts = ["--training-data", "noise", "--training-data-licence", "CC0", "--evaluation", "figures.json"];
    let export = ["export", "--half", "--model", "m.safetensors", "--out", "h.safetensors"];
    done(folder, &[&export[..], &facts].concat());
    let told = done(folder, &["info", "h.safetensors"]);
    for fact in ["trained on      noise\n", "its licence     CC0\n", "evaluation      {\"ap\":12}\n"] {
        assert!(told.contains(fact), "{told}");
    }

    done(folder, &["prune", "--model", "m.safetensors", "--keep", "0.5", "--out", "p.safetensors"]);
    done(folder, &["export", "--model", "p.safetensors", "--out", "p.onnx"]);
    let told = done(folder, &["info", "p.onnx"]);
    assert!(told.contains("pruned          yes; these are the counts of the network before pruning\n"), "{told}");
    assert!(!done(folder, &["info", "m.safetensors"]).contains("pruned"));
}

#[test]
fn doctor_knows_models_their_parts_and_checkpoints() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_small_model(folder);
    fs::copy(root().join("models/farsight-refiner.safetensors"), folder.join("r.safetensors")).unwrap();
    fs::copy(root().join("models/farsight-plates.safetensors"), folder.join("p.safetensors")).unwrap();
    // Detectors of other methods, whole and without their weights.
    fs::copy(root().join("models/farsight-w.safetensors"), folder.join("w.safetensors")).unwrap();
    let config = CenterNet3dConfig { input: [96, 64], width: 0.25, neck: NeckKind::Plain, ..Default::default() };
    let weights = initial_weights(&config.graph(), 1);
    CenterNet3dModel::new(config, weights).unwrap().write(&folder.join("c.safetensors")).unwrap();
    let mut hollow = Weights::read(&folder.join("c.safetensors")).unwrap();
    hollow.tensors.clear();
    hollow.write(&folder.join("hollow.safetensors")).unwrap();
    let mut checkpoint = Weights::default();
    checkpoint.metadata.insert("farsight.progress".to_owned(), "{}".to_owned());
    checkpoint.write(&folder.join("checkpoint.safetensors")).unwrap();
    fs::write(folder.join("x.onnx"), "nothing").unwrap();
    let told: serde_json::Value = serde_json::from_str(&done(folder, &["doctor", "--json"])).unwrap();
    let here: Vec<_> =
        told["models"].as_array().unwrap().iter().filter(|m| m["path"].as_str().unwrap().starts_with("./")).collect();
    let state: Vec<_> = here
        .iter()
        .map(|m| (m["path"].as_str().unwrap(), m["kind"].as_str().unwrap(), m["problem"].is_null()))
        .collect();
    let expected = [
        ("./c.safetensors", "detector", true),
        ("./hollow.safetensors", "detector", false),
        ("./m.safetensors", "detector", true),
        ("./p.safetensors", "plate_reader", true),
        ("./r.safetensors", "refiner", true),
        ("./w.safetensors", "detector", true),
        ("./x.onnx", "detector", false),
    ];
    assert_eq!(state, expected);
    let shown = done(folder, &["doctor"]);
    assert!(
        shown.contains("  ./r.safetensors (a refiner)\n") && shown.contains("  ./p.safetensors (a plate reader)\n")
    );
}

#[test]
fn a_reader_that_has_gone_away_is_nothing_to_tell() {
    let folder = tempfile::tempdir().unwrap();
    write_small_model(folder.path());
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let program = Command::new(env!("CARGO_BIN_EXE_farsight"))
        .args(["info", "m.safetensors"])
        .current_dir(folder.path())
        .stdout(writer)
        .stderr(Stdio::piped())
        .spawn();
    let output = program.unwrap().wait_with_output().unwrap();
    assert!(output.status.success() && output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
}

//! Weights that are damaged, not finite or out of all proportion: told by every engine, and never an empty road.

use std::fs;
use std::path::Path;

use farsight::shipped::{self, Family};
use farsight_graph::init::initial_weights;
use farsight_graph::layers::{NeckKind, NormKind};
use farsight_graph::model::{CONFIG_KEY, NetworkConfig};
use farsight_graph::weights::Weights;
use farsight_methods::smoke::{SmokeConfig, SmokeModel};
use farsight_methods::ssd::SsdModel;

use crate::program::{done, farsight, root};

/// Those that this build may run; weights are told before one is looked for.
const ENGINES: &[&str] = &[
    "rten",
    "onnxruntime",
    "openvino",
    #[cfg(feature = "train")]
    "libtorch",
];

/// A small network with fresh weights.
fn model() -> SmokeModel {
    let (norm, neck) = (NormKind::Batch, NeckKind::Plain);
    let config = SmokeConfig { input: [96, 64], width: 0.25, norm, neck, ..SmokeConfig::default() };
    let weights = initial_weights(&config.graph(), 1);
    SmokeModel::new(config, weights).unwrap()
}

/// Its first weight.
fn first_tensor(model: &SmokeModel) -> String {
    model.graph.parameters[0].name.clone()
}

fn image() -> String {
    root().join("assets/scenes/image_2/000000.jpg").to_string_lossy().into_owned()
}

/// What `range` says of the model, which it must refuse.
fn refusal(folder: &Path, model: &str, more: &[&str]) -> String {
    let image = image();
    let output = farsight(folder, &[&["range", &image, "--hfov", "81", "--model", model], more].concat());
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!((output.status.code(), output.stdout.len()), (Some(2), 0), "{told}");
    told
}

#[test]
fn a_flipped_bit_of_a_model_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    model().write(&folder.join("m.safetensors")).unwrap();
    done(folder, &["export", "--model", "m.safetensors", "--out", "m.onnx"]);
    for name in ["m.safetensors", "m.onnx"] {
        flips_are_told(folder, name, &[3, 5, 7, 9]);
    }
}

/// A bit is flipped at these tenths of the file.
fn flips_are_told(folder: &Path, name: &str, tenths: &[usize]) {
    let whole = fs::read(folder.join(name)).unwrap();
    for share in tenths {
        let mut flipped = whole.clone();
        flipped[whole.len() / 10 * share] ^= 0x40;
        fs::write(folder.join(format!("flipped-{name}")), flipped).unwrap();
        let told = refusal(folder, &format!("flipped-{name}"), &[]);
        assert!(told.contains(&format!("flipped-{name}: its contents have the hash ")), "{told}");
    }
}

#[test]
fn weights_that_are_not_finite_are_told_with_file_and_tensor() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for value in [f32::NAN, f32::INFINITY] {
        for all in [true, false] {
            let mut bad = model();
            let name = first_tensor(&bad);
            let tensors = bad.weights.tensors.iter_mut().filter(|(found, _)| all || **found == name);
            tensors.for_each(|(_, tensor)| {
                let count = if all { tensor.values.len() } else { 1 };
                tensor.values[..count].fill(value);
            });
            bad.write(&folder.join("m.safetensors")).unwrap();
            for engine in ENGINES {
                let told = refusal(folder, "m.safetensors", &["--engine", engine]);
                let expected = format!("has {value} at place 0; expected finite numbers");
                assert!(told.contains("m.safetensors: tensor \"") && told.contains(&expected), "{told}");
            }
        }
    }
}

#[test]
fn answers_that_are_no_numbers_or_out_of_this_world_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let rows = [
        ("heads.predictor.class_head.3.weight", "m.safetensors: output \"cls_logits\" has "),
        ("heads.predictor.regression_head.3.weight", "m.safetensors: its answer has a "),
    ];
    for (name, expected) in rows {
        let mut bad = model();
        bad.weights.tensors.get_mut(name).unwrap().values.fill(3e38);
        // Something is found everywhere.
        bad.weights.tensors.get_mut("heads.predictor.class_head.3.bias").unwrap().values.fill(5.0);
        bad.write(&folder.join("m.safetensors")).unwrap();
        let told = refusal(folder, "m.safetensors", &[]);
        assert!(told.contains(expected) && told.contains("are the weights broken?"), "{told}");
    }
}

#[test]
fn headers_with_absurd_numbers_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let absurd = [
        ("\"std_m\":16.32", "\"std_m\":1e300", "model.depth has a mean of 28.01 m and a deviation of 1000"),
        ("\"mean_m\":28.01", "\"mean_m\":-1e300", "model.depth has a mean of -1000"),
        ("[3.88,1.63,1.53]", "[3.88,1e300,1.53]", "model.classes has Car with a size or factor out of all proportion"),
    ];
    for (found, replaced, expected) in absurd {
        let mut weights = model().weights;
        let config = serde_json::to_string(&model().config).unwrap();
        assert!(config.contains(found), "{config}");
        weights.metadata.insert(CONFIG_KEY.to_owned(), config.replace(found, replaced));
        weights.write(&folder.join("m.safetensors")).unwrap();
        let told = refusal(folder, "m.safetensors", &[]);
        assert!(
            told.contains("m.safetensors: \"farsight.model\" in the header: ") && told.contains(expected),
            "{told}"
        );
    }
}

#[cfg(unix)]
#[test]
fn a_header_that_asks_for_huge_maps_is_refused_before_they_are_made() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let small = model();
    let mut weights = small.weights;
    let config = SmokeConfig { input: [8192, 8192], ..small.config };
    weights.metadata.insert(CONFIG_KEY.to_owned(), serde_json::to_string(&config).unwrap());
    weights.write(&folder.join("m.safetensors")).unwrap();
    // The input alone and the first two maps take 3 GB: an engine that gets none ends the process.
    let script = "ulimit -v 2500000; exec \"$0\" \"$@\"";
    let program = env!("CARGO_BIN_EXE_farsight");
    for arguments in [&["range", &image(), "--hfov", "81"][..], &["export", "--out", "m.onnx"]] {
        let mut command = std::process::Command::new("sh");
        command.args(["-c", script, program]).args(arguments).args(["--model", "m.safetensors"]);
        let output = command.current_dir(folder).output().unwrap();
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{told}");
        assert!(told.contains(": its value \"image\" takes 805 MB for an image; no model of ours"), "{told}");
    }
}

/// The SSD that comes with the program.
fn ssd() -> SsdModel {
    SsdModel::read(&root().join("models/farsight-w.safetensors")).unwrap()
}

#[test]
fn an_ssd_with_weights_that_are_not_finite_is_told_by_every_engine() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for value in [f32::NAN, f32::NEG_INFINITY] {
        let mut bad = ssd();
        bad.weights.tensors.get_mut("heads.2.classes.bias").unwrap().values[3] = value;
        bad.write(&folder.join("w.safetensors")).unwrap();
        for engine in ["rten", "onnxruntime", "openvino"] {
            let told = refusal(folder, "w.safetensors", &["--engine", engine]);
            let expected = format!("w.safetensors: tensor \"heads.2.classes.bias\" has {value} at place 3; expected");
            assert!(told.contains(&expected), "{told}");
        }
    }
}

#[test]
fn a_flipped_bit_of_an_ssd_is_told_in_both_kinds_of_files() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    done(folder, &["export", "--model", "farsight-w", "--out", "w.onnx"]);
    fs::copy(root().join("models/farsight-w.safetensors"), folder.join("w.safetensors")).unwrap();
    for name in ["w.safetensors", "w.onnx"] {
        flips_are_told(folder, name, &[2, 6, 9]);
    }
}

#[test]
fn an_ssd_whose_boxes_are_out_of_this_world_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    // The last overflows within the network.
    let rows = [(1e4, "\"boxes0\" has 10000; expected at most 1000: "), (3.4e38, "expected finite numbers")];
    for (value, expected) in rows {
        let mut bad = ssd();
        // Something is found everywhere.
        bad.weights.tensors.get_mut("heads.0.classes.bias").unwrap().values.fill(50.0);
        bad.weights.tensors.get_mut("heads.0.boxes.weight").unwrap().values.fill(if value > 1e5 { value } else { 0.0 });
        bad.weights.tensors.get_mut("heads.0.boxes.bias").unwrap().values.fill(value);
        bad.write(&folder.join("w.safetensors")).unwrap();
        let told = refusal(folder, "w.safetensors", &[]);
        assert!(told.contains("w.safetensors: output ") && told.contains(expected), "{told}");
        assert!(told.contains("are the weights broken?"), "{told}");
    }
}

#[test]
fn headers_of_an_ssd_with_absurd_numbers_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let view = "{\"focal_px\":400.0}";
    let views = vec![view; 2000].join(",");
    let absurd = [
        ("\"focal_px\":400.0", "\"focal_px\":1e-300", "model.views has focal_px 0.000"),
        (view, &views, "model.views has 2001 views; expected 1 to 8"),
        ("\"relative_error\":0.2", "\"relative_error\":1e300", "model.relative_error is 1000"),
        ("\"max_overlap\":0.45", "\"max_overlap\":0.0", "model.max_overlap is 0; expected above 0"),
        ("[3.88,1.63,1.53]", "[3.88,1e300,1.53]", "model.classes has Car with a size or factor out of all proportion"),
    ];
    for (found, replaced, expected) in absurd {
        let mut weights = ssd().weights;
        let config = serde_json::to_string(&ssd().config).unwrap();
        assert!(config.contains(found), "{config}");
        weights.metadata.insert(CONFIG_KEY.to_owned(), config.replacen(found, replaced, 1));
        weights.write(&folder.join("w.safetensors")).unwrap();
        let told = refusal(folder, "w.safetensors", &[]);
        let header = "w.safetensors: \"farsight.model\" in the header: ";
        assert!(told.contains(header) && told.contains(expected), "{told}");
    }
}

#[test]
fn files_from_before_the_hash_are_told_once() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    model().write(&folder.join("m.safetensors")).unwrap();
    let range = |model: &str| {
        let output = farsight(folder, &["range", &image(), "--hfov", "81", "--model", model]);
        assert!(output.status.success());
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    assert!(!range("m.safetensors").contains("has no hash"));
    let old = without_hash(&fs::read(folder.join("m.safetensors")).unwrap());
    fs::write(folder.join("old.safetensors"), old).unwrap();
    let told = range("old.safetensors");
    assert_eq!(told.matches("note: old.safetensors: has no hash, so damage to it would not be noticed").count(), 1);
}

/// `bytes` with another key in the place of the hash's, of the same length.
fn without_hash(bytes: &[u8]) -> Vec<u8> {
    let key = b"farsight.file_sha256";
    let at = bytes.windows(key.len()).position(|window| window == key).unwrap();
    let mut old = bytes.to_vec();
    old[at..at + key.len()].copy_from_slice(b"farsight.file_sha-no");
    old
}

#[test]
fn an_onnx_file_without_a_hash_is_told_once_and_its_constants_are_looked_at() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let small = model();
    small.write(&folder.join("m.safetensors")).unwrap();
    done(folder, &["export", "--model", "m.safetensors", "--out", "m.onnx"]);
    let old = without_hash(&fs::read(folder.join("m.onnx")).unwrap());
    fs::write(folder.join("old.onnx"), &old).unwrap();
    let note = "old.onnx: has no hash, so damage to it would not be noticed";
    let output = farsight(folder, &["range", &image(), "--hfov", "81", "--model", "old.onnx"]);
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success() && told.matches(note).count() == 1, "{told}");

    // The last layer of the regression has no norm that would be folded into it: it stands there as it was made.
    let values = &small.weights.tensors["heads.predictor.regression_head.3.weight"].values;
    let bytes: Vec<u8> = values[..8].iter().flat_map(|value| value.to_le_bytes()).collect();
    let at = old.windows(bytes.len()).position(|window| window == bytes).unwrap();
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let mut bad = old.clone();
        bad[at + 12..at + 16].copy_from_slice(&value.to_le_bytes());
        fs::write(folder.join("old.onnx"), bad).unwrap();
        let told = refusal(folder, "old.onnx", &[]);
        let expected = format!("\" has {value} at place 3; expected finite numbers");
        assert!(told.contains("error: old.onnx: constant \"") && told.contains(&expected), "{told}");
    }
}

#[test]
fn second_stages_are_checked_as_detectors_are() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    model().write(&folder.join("m.safetensors")).unwrap();
    for (option, name) in [("--refiner", "farsight-refiner"), ("--plates", "farsight-plates")] {
        let path = root().join(format!("models/{name}.safetensors"));
        let (whole, weights) = (fs::read(&path).unwrap(), Weights::read(&path).unwrap());
        let told = || refusal(folder, "m.safetensors", &[option, "stage.safetensors"]);
        for share in [2, 5, 9] {
            let mut flipped = whole.clone();
            flipped[whole.len() / 10 * share] ^= 0x40;
            fs::write(folder.join("stage.safetensors"), flipped).unwrap();
            let told = told();
            assert!(told.contains("stage.safetensors: its contents have the hash "), "{told}");
        }
        for value in [f32::NAN, f32::INFINITY] {
            let mut bad = weights.clone();
            bad.tensors.get_mut("answer.bias").unwrap().values[1] = value;
            bad.write(&folder.join("stage.safetensors")).unwrap();
            let expected = format!("stage.safetensors: tensor \"answer.bias\" has {value} at place 1; expected finite");
            let told = told();
            assert!(told.contains(&expected), "{told}");
        }
        let config: serde_json::Value = serde_json::from_str(&weights.metadata[CONFIG_KEY]).unwrap();
        for (key, value, expected) in [
            ("side", 1_u64 << 40, "model.side is 1099511627776; expected a multiple of "),
            ("hidden", 1 << 40, "model.hidden has 1099511627776; expected 1 to 4096"),
        ] {
            let (mut bad, mut absurd) = (weights.clone(), config.clone());
            absurd[key] = value.into();
            bad.metadata.insert(CONFIG_KEY.to_owned(), absurd.to_string());
            bad.write(&folder.join("stage.safetensors")).unwrap();
            let told = told();
            let header = "stage.safetensors: \"farsight.model\" in the header: ";
            assert!(told.contains(header) && told.contains(expected), "{told}");
        }
        fs::write(folder.join("stage.safetensors"), without_hash(&whole)).unwrap();
        let output = farsight(
            folder,
            &["range", &image(), "--hfov", "81", "--model", "m.safetensors", option, "stage.safetensors"],
        );
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(told.matches("note: stage.safetensors: has no hash").count(), 1, "{told}");
    }
}

#[test]
fn every_command_that_takes_a_model_tells_of_a_missing_hash() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    model().write(&folder.join("m.safetensors")).unwrap();
    let old = without_hash(&fs::read(folder.join("m.safetensors")).unwrap());
    fs::write(folder.join("old.safetensors"), old).unwrap();
    let image = image();
    for arguments in [
        &["info", "old.safetensors"][..],
        &["export", "--model", "old.safetensors", "--out", "m.onnx"],
        &["prune", "--model", "old.safetensors", "--keep", "0.5", "--out", "p.safetensors"],
        &["bench", "--model", "old.safetensors", "--image", &image, "--runs", "1", "--images", "0"],
        // What follows cannot be done; the file is told all the same.
        &["parity", "--model", "old.safetensors", "--golden", "old.safetensors"],
    ] {
        let output = farsight(folder, arguments);
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        let note = "note: old.safetensors: has no hash, so damage to it would not be noticed";
        assert_eq!(told.matches(note).count(), 1, "{arguments:?}: {told}");
    }
    // Weights that are not the shipped ones do without what is made for those.
    let output =
        farsight(folder, &["bench", "--model", "m.safetensors", "--image", &image, "--runs", "1", "--images", "2"]);
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(told.matches("m.safetensors: not the shipped weights").count(), 1, "{told}");
}

#[test]
fn what_is_left_out_with_other_weights_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mut weights = Weights::read(&root().join("models/farsight-s.safetensors")).unwrap();
    let told = |model: &str| {
        let output = farsight(folder, &["range", &image(), "--hfov", "81", "--model", model]);
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    weights.write(&folder.join("same.safetensors")).unwrap();
    assert!(!told("same.safetensors").contains("not the shipped weights"));
    weights.tensors.values_mut().next().unwrap().values[0] += 1e-3;
    weights.write(&folder.join("other.safetensors")).unwrap();
    let expected = "note: other.safetensors: not the shipped weights, so without what is made for those: refiner, plate reader, road plane";
    assert!(told("other.safetensors").contains(expected), "{}", told("other.safetensors"));
}

#[test]
fn the_hashes_that_are_kept_of_shipped_detectors_are_theirs() {
    for family in Family::ALL {
        let computed = match family {
            Family::FarsightW => shipped::ssd().unwrap().weights.sha256(),
            Family::FarsightS => shipped::smoke().unwrap().weights.sha256(),
            Family::FarsightN => shipped::small_smoke().unwrap().weights.sha256(),
        };
        let place = "DETECTOR_SHA256 of its crate farsight-weights-*";
        assert_eq!(family.weights_sha256(), computed, "{}: write the second one to {place}", family.name());
        assert_eq!(shipped::family_of(&computed), Some(family));
    }
    assert_eq!(shipped::family_of(""), None);
}

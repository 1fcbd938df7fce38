//! Files that are read: good ones, and those of strangers.

use std::fs;
use std::path::{Path, PathBuf};

use farsight_graph::init::initial_weights;
use farsight_graph::layers::NormKind;
use farsight_graph::model::NetworkConfig;
use farsight_methods::smoke::SmokeConfig;
use farsight_methods::smoke::SmokeModel;
use farsight_methods::smoke::{DetectorFile, REGRESSION};
use farsight_onnx::{LocalHeadFile, OnnxModel, Target, key};

fn corpus() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus/model")
}

fn read(name: &str) -> Result<DetectorFile, String> {
    DetectorFile::from_bytes(fs::read(corpus().join(name)).unwrap(), Path::new("m.onnx"))
        .map_err(|error| error.to_string())
}

#[test]
fn saved_inputs() {
    let artifacts = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/artifacts/model");
    let mut replayed = 0;
    for entry in [corpus(), artifacts].iter().filter_map(|folder| fs::read_dir(folder).ok()).flatten() {
        let path = entry.unwrap().path();
        eprintln!("{}", path.display());
        crate::laws::model(&fs::read(&path).unwrap());
        replayed += 1;
    }
    assert!(replayed > 10);
}

#[test]
fn a_file_cut_anywhere_is_an_error() {
    let bytes = fs::read(corpus().join("whole")).unwrap();
    assert!(OnnxModel::from_bytes(bytes.clone(), Path::new("m.onnx")).is_ok());
    for length in 0..bytes.len() {
        crate::laws::model(&bytes[..length]);
        assert!(OnnxModel::from_bytes(bytes[..length].to_vec(), Path::new("m.onnx")).is_err(), "{length} bytes");
    }
}

#[test]
fn files_of_strangers() {
    let table = [
        ("empty", "no \"farsight.model\" in its metadata; expected a file written by `farsight export`"),
        ("foreign", "no \"farsight.model\" in its metadata; expected a file written by `farsight export`"),
        ("cut", "not a whole ONNX file: byte "),
        ("long_number", "not a whole ONNX file: byte 0: a number longer than ten bytes"),
        ("config_no_json", "\"farsight.model\" in its metadata: EOF while parsing an object at line 1 column 1"),
        (
            "config_hostile_size",
            "\"farsight.model\" in its metadata: model.input is 3200000000x3200000000; expected at most 8192 pixels a side",
        ),
        ("external", "constant \"stem.weight\" lies in another file; expected everything in one"),
        ("operator", "operator \"Loop\"; expected only those that `farsight export` writes"),
        ("function", "operator \"a function of the file's own\"; expected only those that `farsight export` writes"),
        ("no_graph", "no graph in it; expected an ONNX model"),
        ("no_output", "no output \"reg_raw\"; found [\"cls_logits\"]"),
        ("no_input", "no input \"image\"; found []"),
        ("channels", "output \"reg_raw\" has 7 channels; its description says 8"),
    ];
    for (name, expected) in table {
        let error = read(name).unwrap_err();
        assert!(error.starts_with(&format!("m.onnx: {expected}")), "{name}: {error}");
    }
}

fn names(file: &LocalHeadFile) -> Vec<&str> {
    file.model.outputs().iter().map(|output| output.name.as_str()).collect()
}

#[test]
fn heads_of_strangers() {
    let cut = |name: &str| LocalHeadFile::new(&read(name).unwrap().onnx, REGRESSION, Path::new("m.onnx"));
    let whole = cut("whole").unwrap().unwrap();
    assert_eq!(names(&whole), ["cls_logits", "neck"]);
    assert_eq!((&whole.hidden.weight.shape[..], whole.hidden.bias.values.len()), (&[3, 4, 3, 3][..], 3));
    let quantized = cut("quantized").unwrap().unwrap();
    assert_eq!(names(&quantized), ["cls_logits", "neck/rounded"]);
    assert_eq!(quantized.hidden, whole.hidden, "the head itself stays in float");
    let table = [
        ("quantized_head", "constant \"stem.weight\" holds no floats"),
        ("head_missing", "no node makes \"nowhere\""),
        ("head_constant", "no constant \"x\""),
        ("head_shape", "a convolution of shape [3, 4, 1, 1] with a bias of shape [3, 4, 1, 1]"),
        ("head_size", "constant \"h.weight\": 108 values for a tensor of shape [1099511627776, 4, 3, 3]"),
    ];
    for (name, expected) in table {
        let error = cut(name).unwrap_err().to_string();
        assert_eq!(error, format!("m.onnx: \"farsight.peaks_head\" in its metadata: {expected}"));
    }
}

#[test]
fn facts_of_a_model_travel_with_it() {
    let config = SmokeConfig { input: [96, 64], width: 0.25, norm: NormKind::Batch, ..SmokeConfig::default() };
    let mut weights = initial_weights(&config.graph(), 1);
    weights.metadata.insert(key::TRAINING.to_owned(), "{\"steps\":7}".to_owned());
    weights.metadata.insert("other".to_owned(), "stays behind".to_owned());
    let model = SmokeModel::new(config.clone(), weights).unwrap();
    let file = DetectorFile::from_model(&model, Target::Portable, Path::new("in memory")).unwrap();
    assert_eq!(file.config, config);
    let file = file.onnx;
    let expected = DetectorFile::facts(&model, Target::Portable);
    for (key, value) in expected.entries() {
        assert_eq!(file.facts().get(&key), Some(value.as_str()), "{key}");
    }
    assert_eq!(file.facts().get(key::TRAINING), Some("{\"steps\":7}"));
    assert_eq!(file.facts().get(key::CLASSES), Some("Car,Cyclist,Pedestrian"));
    assert_eq!(file.facts().get(key::INPUT_SIZE), Some("96x64"));
    assert_eq!(file.facts().get("other"), None);
    assert_eq!(file.facts().get(key::WEIGHTS_SHA256).unwrap().len(), 64);
    assert!(file.facts().get(key::PEAKS_HEAD).is_some());

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.safetensors");
    model.write(&path).unwrap();
    let read = DetectorFile::read(&path, Target::Portable).unwrap();
    assert_eq!(read.onnx.bytes(), file.bytes(), "the same model gives the same file");
}

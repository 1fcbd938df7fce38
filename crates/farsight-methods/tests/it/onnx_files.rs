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

#[test]
fn numbers_that_ask_for_all_memory_are_refused_before_it_is_asked_for() {
    let error = read("head_size").unwrap_err();
    assert!(error.ends_with("MB for an image; no model of ours has more than 2147 MB"), "{error}");
    let whole = fs::read(corpus().join("whole")).unwrap();
    // The settings of the file's own convolutions, replaced by others.
    for (name, value, expected) in [
        ("pads", 1_u64 << 30, "\"pads\" of an operator Conv is 1073741824; no model of ours has more than 128"),
        ("strides", 1_000_000, "\"strides\" of an operator Conv is 1000000; no model of ours has more than 128"),
        ("dilations", u64::MAX / 2, "\"dilations\" of an operator Conv is 9223372036854775807; no model of ours"),
    ] {
        let hostile = with_setting(&whole, name, value);
        let error = OnnxModel::from_bytes(hostile, Path::new("m.onnx")).map(|_| ()).unwrap_err().to_string();
        assert!(error.starts_with(&format!("m.onnx: {expected}")), "{error}");
    }
}

/// The file with one more node in its graph: a convolution of the image whose setting `name` is `value`.
fn with_setting(file: &[u8], name: &str, value: u64) -> Vec<u8> {
    let field = |number: u8, content: &[u8]| [&[number << 3 | 2], &varint(content.len() as u64)[..], content].concat();
    let number = |field: u8, value: u64| [&[field << 3][..], &varint(value)].concat();
    let setting = [field(1, name.as_bytes()), number(8, value)].concat();
    let node = [field(1, b"image"), field(2, b"more"), field(4, b"Conv"), field(5, &setting)].concat();
    // A message that stands twice is one message of both (protobuf), but the last graph is what is read: it needs all
    // of the first.
    let mut rest = file;
    let (mut graph, mut others) = (Vec::new(), Vec::new());
    while !rest.is_empty() {
        let start = rest;
        let (key, after) = read_varint(rest);
        let kind = key % 8;
        let content = if kind == 0 {
            rest = read_varint(after).1;
            &[][..]
        } else {
            let (length, after) = read_varint(after);
            rest = &after[length as usize..];
            &after[..length as usize]
        };
        if key >> 3 == 7 {
            graph.extend_from_slice(content);
        } else {
            others.extend_from_slice(&start[..start.len() - rest.len()]);
        }
    }
    graph.extend(field(1, &node));
    [others, field(7, &graph)].concat()
}

fn varint(mut value: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
    bytes
}

fn read_varint(bytes: &[u8]) -> (u64, &[u8]) {
    let length = 1 + bytes.iter().take_while(|byte| **byte & 0x80 != 0).count();
    let value = bytes[..length].iter().rev().fold(0, |value, byte| value << 7 | u64::from(byte & 0x7f));
    (value, &bytes[length..])
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

    // What is written has a hash, what is made for an engine has none, and that is all they differ by.
    let written = OnnxModel::from_bytes(file.sealed().into_owned(), &path).unwrap();
    assert!(written.has_hash() && !file.has_hash());
    assert!(written.bytes().starts_with(file.bytes()) && written.sealed() == written.bytes());
    let mut flipped = written.bytes().to_vec();
    let middle = flipped.len() / 2;
    flipped[middle] ^= 1;
    assert!(OnnxModel::from_bytes(flipped, &path).is_err());
}

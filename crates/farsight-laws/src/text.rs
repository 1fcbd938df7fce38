//! Laws of files of text: what is accepted says the same when it is printed and read again.

use std::fmt::Debug;
use std::path::Path;

use farsight::json::ImageRecord;
use farsight_data::annotations::{FileAnnotation, Plates};
use farsight_data::kitti::split::split_from_text;
use farsight_methods::each_method;
use farsight_methods::method::{Method, MethodVisitor};
use farsight_synth::SceneConfig;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

/// A list of frames: each once, and each a good name of a file.
pub(crate) fn split(bytes: &[u8]) {
    let path = Path::new("input");
    match split_from_text(&String::from_utf8_lossy(bytes), path) {
        Ok(ids) => {
            let again = split_from_text(&(ids.join("\n") + "\n"), path).expect("what was accepted");
            assert_eq!(again, ids);
            assert!(ids.iter().all(|id| !id.contains('/') && id != ".." && !id.is_empty()), "{ids:?}");
        }
        Err(error) => assert!(error.to_string().starts_with("input"), "{error}"),
    }
}

/// A map of class names, through a file as users have it.
pub(crate) fn class_map(bytes: &[u8]) {
    let folder = tempfile::tempdir().expect("a folder for the file");
    let path = folder.path().join("classes.txt");
    std::fs::write(&path, bytes).expect("a file for the bytes");
    match farsight_data::ClassMap::read(&path) {
        Ok(map) => drop(map.class("Car")),
        Err(error) => assert!(error.to_string().contains("classes.txt"), "{error}"),
    }
}

/// Number plates beside a label file.
pub(crate) fn plates(bytes: &[u8]) {
    let Ok(plates) = Plates::from_text(&String::from_utf8_lossy(bytes)) else { return };
    let text = plates.to_text();
    let again = Plates::from_text(&text).expect("what was printed");
    assert_eq!(again.to_text(), text);
}

/// What scenes look like.
pub(crate) fn scene_config(bytes: &[u8]) {
    let Some(config) = toml_round_trip::<SceneConfig>(bytes) else { return };
    if config.problem().is_none() {
        // A config that is accepted can be drawn from.
        drop(farsight_synth::generate_scene(&config, 1, 0));
    }
}

/// What a network is made of, of every method.
pub(crate) fn model_config(bytes: &[u8]) {
    each_method(&mut Configs(bytes));
}

struct Configs<'a>(&'a [u8]);

impl MethodVisitor for Configs<'_> {
    fn visit<C: Method>(&mut self) {
        let Some(config) = toml_round_trip::<C>(self.0) else { return };
        if config.problem().is_none() {
            let graph = config.graph();
            assert!(C::OUTPUTS.iter().all(|output| graph.tap(output).is_some()));
            assert!(config.counted_input().iter().all(|side| *side > 0) && !config.facts().is_empty());
        }
    }
}

fn toml_round_trip<T: DeserializeOwned + Serialize + PartialEq + Debug>(bytes: &[u8]) -> Option<T> {
    let config: T = toml::from_str(std::str::from_utf8(bytes).ok()?).ok()?;
    // What is no number equals nothing, and TOML has no integers beyond 63 bits.
    let text = toml::to_string(&config).ok()?;
    let again: T = toml::from_str(&text).expect("what was printed");
    assert_eq!(toml::to_string(&again).expect("what was printed once"), text);
    Some(config)
}

/// Answers of `farsight range`, which it reads back to go on.
pub(crate) fn answers(bytes: &[u8]) {
    let Ok(record) = serde_json::from_slice::<ImageRecord>(bytes) else { return };
    let text = serde_json::to_string(&record).expect("what was read");
    let again: ImageRecord = serde_json::from_str(&text).expect("what was printed");
    let [first, second] = [&record, &again].map(|record| serde_json::to_value(record).expect("what was read"));
    assert!(same(&first, &second), "{first} is not {second}");
}

/// Whether two values are the same up to the last bit of their numbers: the reader of JSON rounds numbers of many
/// digits to a neighbour at times.
fn same(a: &Value, b: &Value) -> bool {
    match (a, b) {
        (Value::Number(a), Value::Number(b)) => match (a.as_f64(), b.as_f64()) {
            (Some(a), Some(b)) => (a - b).abs() <= 4.0 * f64::EPSILON * a.abs(),
            _ => a == b,
        },
        (Value::Array(a), Value::Array(b)) => a.len() == b.len() && a.iter().zip(b).all(|(a, b)| same(a, b)),
        (Value::Object(a), Value::Object(b)) => {
            a.len() == b.len() && a.iter().all(|(key, a)| b.get(key).is_some_and(|b| same(a, b)))
        }
        _ => a == b,
    }
}

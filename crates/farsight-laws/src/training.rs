//! Laws of what trainings read: configs and checkpoints.

use std::path::Path;

use farsight_graph::weights::{FILE_SHA256_KEY, Weights};
use farsight_methods::each_task;
use farsight_methods::training::{TaskVisitor, check};
use farsight_train::checkpoint::{data_of, read};
use farsight_train::config::{RunConfig, read_table};
use farsight_train::task::{RunOf, Task};

use crate::text::{accepted, as_file};

/// A config of a training, of every method, through a file as users have it; or of one in parts.
pub(crate) fn config(bytes: &[u8]) -> bool {
    let (_folder, path) = as_file("input.toml", bytes);
    if let Ok(table) = read_table(&path)
        && table.contains_key("parts")
    {
        return accepted(check(&table, &path), &path).is_some();
    }
    let mut runs = Runs { bytes, accepted: false };
    each_task(&mut runs);
    runs.accepted
}

struct Runs<'a> {
    bytes: &'a [u8],
    /// Whether it is the config of any method.
    accepted: bool,
}

impl TaskVisitor for Runs<'_> {
    fn visit<T: Task>(&mut self) {
        self.accepted |= run::<T>(self.bytes);
    }
}

fn run<T: Task>(bytes: &[u8]) -> bool {
    let (_folder, path) = as_file("input.toml", bytes);
    let read = |path: &Path| -> Result<RunOf<T>, _> { RunConfig::read(path) };
    let Some(run) = accepted(read(&path), &path) else { return false };
    assert!(run.problem().is_none());
    let Ok(text) = toml::to_string(&run) else { return true };
    std::fs::write(&path, &text).expect("a file for the text");
    let again = read(&path).expect("what was printed");
    assert_eq!(toml::to_string(&again).expect("what was printed once"), text);
    true
}

/// A checkpoint: whatever the bytes, it is one of this run as it was written, or an error that names the file; and so
/// with a hash that fits the bytes, which lets mutants get further.
pub(crate) fn checkpoint(bytes: &[u8]) -> bool {
    let is_accepted = whole(bytes);
    let key = FILE_SHA256_KEY.as_bytes();
    let mut unsealed = bytes.to_vec();
    if let Some(at) = bytes.windows(key.len()).position(|window| window == key) {
        unsealed[at + key.len() - 1] = b'x';
    }
    if let Ok(weights) = Weights::from_safetensors(&unsealed, Path::new("unsealed")) {
        let mut sealed = Vec::new();
        weights.write_safetensors(&mut sealed).expect("memory takes all");
        whole(&sealed);
    }
    is_accepted
}

fn whole(bytes: &[u8]) -> bool {
    let (_folder, path) = as_file("input.safetensors", bytes);
    let read = accepted(read(&path, &"the run"), &path);
    if let Some((weights, _)) = &read {
        assert!(weights.tensors.values().all(|t| t.shape.iter().product::<usize>() == t.values.len()));
    }
    accepted(data_of(&path), &path);
    read.is_some()
}

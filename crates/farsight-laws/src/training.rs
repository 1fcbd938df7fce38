//! Laws of what trainings read: configs and checkpoints.

use std::path::Path;

use farsight_methods::each_task;
use farsight_methods::training::TaskVisitor;
use farsight_train::checkpoint::{data_of, read};
use farsight_train::config::RunConfig;
use farsight_train::task::{RunOf, Task};

/// A config of a training, of every method, through a file as users have it.
pub(crate) fn config(bytes: &[u8]) {
    let folder = tempfile::tempdir().expect("a folder for the file");
    let path = folder.path().join("input.toml");
    std::fs::write(&path, bytes).expect("a file for the bytes");
    each_task(&mut Runs(&path));
}

struct Runs<'a>(&'a Path);

impl TaskVisitor for Runs<'_> {
    fn visit<T: Task>(&mut self) {
        run::<T>(self.0);
    }
}

fn run<T: Task>(path: &Path) {
    let read = |path: &Path| -> Result<RunOf<T>, _> { RunConfig::read(path) };
    match read(path) {
        Ok(run) => {
            assert!(run.problem().is_none());
            let Ok(text) = toml::to_string(&run) else { return };
            std::fs::write(path, &text).expect("a file for the text");
            let again = read(path).expect("what was printed");
            assert_eq!(toml::to_string(&again).expect("what was printed once"), text);
        }
        Err(error) => assert!(error.to_string().contains("input.toml"), "no file in: {error}"),
    }
}

/// A checkpoint: whatever the bytes, it is one of this run as it was written, or an error that names the file.
pub(crate) fn checkpoint(bytes: &[u8]) {
    let folder = tempfile::tempdir().expect("a folder for the file");
    let path = folder.path().join("input.safetensors");
    std::fs::write(&path, bytes).expect("a file for the bytes");
    match read(&path, &"the run") {
        Ok((weights, _)) => {
            assert!(weights.tensors.values().all(|t| t.shape.iter().product::<usize>() == t.values.len()));
        }
        Err(error) => assert!(error.to_string().contains("input.safetensors"), "no file in: {error}"),
    }
    if let Err(error) = data_of(&path) {
        assert!(error.to_string().contains("input.safetensors"), "no file in: {error}");
    }
}

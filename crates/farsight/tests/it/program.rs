//! Running the program, for the tests that do so.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The top of the workspace.
pub(crate) fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().unwrap()
}

pub(crate) fn farsight(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_farsight")).args(arguments).current_dir(folder).output().unwrap()
}

/// Standard output of a command that must work.
pub(crate) fn done(folder: &Path, arguments: &[&str]) -> String {
    let output = farsight(folder, arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

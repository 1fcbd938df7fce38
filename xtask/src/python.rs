//! The Python environment of the workspace, `target/python`: what builds the wheel, and what single tests want.

use std::env;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::{root, run};

/// Versions of maturin that build the wheel.
const MATURIN: &str = "maturin>=1.16,<2";

/// What tests of the workspace want of Python: engines, and the official readers of recordings. That of rerun must be
/// of the version that writes them (`re_sdk` in Cargo.toml).
const OPTIONAL: [&str; 8] = [
    "numpy",
    "onnx",
    "onnxruntime",
    "openvino",
    "mcap",
    "mcap-protobuf-support",
    "mcap-ros2-support",
    "rerun-sdk==0.36.3",
];

/// The environment's interpreter; the environment is made when it is missing.
fn python() -> Result<PathBuf, String> {
    let environment = root().join("target/python");
    let python = script(&environment, "python");
    if !python.is_file() {
        run(Command::new("python3").args(["-m", "venv"]).arg(&environment))?;
    }
    Ok(python)
}

fn install(python: &Path, packages: &[&str]) -> Result<(), String> {
    let pip = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check"];
    run(Command::new(python).args(pip).args(packages))
}

/// The search path for programs, with a `python3` at its front that has whatever tests want.
pub(crate) fn path_with_everything() -> Result<OsString, String> {
    let python = python()?;
    install(&python, &OPTIONAL)?;
    let folder = python.parent().map(Path::to_path_buf);
    let before = env::var_os("PATH").unwrap_or_default();
    let folders = folder.into_iter().chain(env::split_paths(&before));
    env::join_paths(folders).map_err(|error| format!("PATH: {error}"))
}

/// The environment's maturin, which is put there when it is missing.
pub(crate) fn maturin() -> Result<PathBuf, String> {
    let python = python()?;
    let maturin = script(&root().join("target/python"), "maturin");
    if !maturin.is_file() {
        install(&python, &[MATURIN])?;
    }
    Ok(maturin)
}

/// A command of a Python environment.
pub(crate) fn script(environment: &Path, name: &str) -> PathBuf {
    let folder = if cfg!(windows) { "Scripts" } else { "bin" };
    environment.join(folder).join(format!("{name}{}", env::consts::EXE_SUFFIX))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::OPTIONAL;
    use crate::root;

    #[test]
    fn the_reader_of_rerun_has_the_version_of_its_writer() {
        let manifest = fs::read_to_string(root().join("Cargo.toml")).unwrap();
        let line = manifest.lines().find(|line| line.starts_with("re_sdk = ")).unwrap();
        let version = line.split('"').nth(1).unwrap();
        assert!(OPTIONAL.contains(&&*format!("rerun-sdk=={version}")), "{version}");
    }
}

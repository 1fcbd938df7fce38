//! What tests of several crates share: reference tensors ([`Golden`]), and folders of test data outside the repository
//! ([`kitti`], [`folder`]).
//!
//! For tests only, so it panics where a program would return an error.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout, reason = "used by tests only")]
#![allow(clippy::missing_panics_doc, reason = "a test that cannot go on stops")]

mod golden;

use std::path::{Path, PathBuf};

pub use golden::{Array, Golden};

/// The top of the workspace.
fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// A folder inside that of KITTI's files: `$FARSIGHT_KITTI`, else `../shared/kitti`; as [`folder`].
pub fn kitti(inside: &str) -> Option<PathBuf> {
    folder("FARSIGHT_KITTI", "../shared/kitti", inside)
}

/// The folder `inside` the one that the environment variable `variable` names, else `default`.
///
/// Both are relative to the top of the workspace.
///
/// `None`, with a printed reason for the reader of the test's output, where there is no such folder.
pub fn folder(variable: &str, default: &str, inside: &str) -> Option<PathBuf> {
    let path = workspace().join(std::env::var_os(variable).unwrap_or_else(|| default.into())).join(inside);
    if path.is_dir() {
        return Some(path);
    }
    println!("skipped: no folder {}; set {variable}", path.display());
    None
}

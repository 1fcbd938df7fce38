//! What tests of several crates share: reference tensors ([`Golden`]), folders of test data outside the repository
//! ([`kitti`], [`folder`]), memory that is counted ([`peak`]), and tables that documents quote ([`keep_table`]).
//!
//! For tests only, so it panics where a program would return an error.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout, reason = "used by tests only")]
#![allow(clippy::missing_panics_doc, reason = "a test that cannot go on stops")]

mod counting;
mod golden;

use std::path::{Path, PathBuf};

pub use counting::{Counting, asked, peak};
use farsight_files::MeasuredTable;
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

/// Writes a table that a test measured to `NAME.json` in the folder that `FARSIGHT_TABLES` names, which is relative to
/// the top of the workspace; without it, nowhere.
pub fn keep_table(name: &str, table: &MeasuredTable) {
    if let Some(folder) = std::env::var_os("FARSIGHT_TABLES") {
        table.write(&workspace().join(folder).join(format!("{name}.json"))).unwrap();
    }
}

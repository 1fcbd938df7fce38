//! The user's Python: it has pip, and maybe the wheels already.

use std::ffi::OsStr;
use std::path::PathBuf;
use std::process::{Command, Stdio};

use super::LibraryError;

/// Prints the folder of a package without importing it.
const FOLDER_OF: &str = "import importlib.util as u, sys; s = u.find_spec(sys.argv[1]); print(list(s.submodule_search_locations)[0] if s else '')";

/// Python as the user calls it.
fn python() -> Command {
    Command::new(if cfg!(windows) { "python" } else { "python3" })
}

/// The folder of an installed package.
pub(super) fn package_folder(package: &str) -> Option<PathBuf> {
    let output = python().args(["-c", FOLDER_OF, package]).stderr(Stdio::null()).output().ok()?;
    let folder = String::from_utf8(output.stdout).ok()?;
    let folder = folder.trim();
    (output.status.success() && !folder.is_empty()).then(|| PathBuf::from(folder))
}

/// Runs Python with these arguments; what it writes to standard error goes to the user.
pub(super) fn run<S: AsRef<OsStr>>(arguments: &[S], task: &'static str) -> Result<(), LibraryError> {
    let status = python().args(arguments).stdout(Stdio::null()).status();
    let status = status.map_err(|source| LibraryError::NoPython { task, source })?;
    if status.success() { Ok(()) } else { Err(LibraryError::Python { task, status }) }
}

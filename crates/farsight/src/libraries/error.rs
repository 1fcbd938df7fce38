//! Why a library is not there.

use std::io;
use std::path::PathBuf;
use std::process::ExitStatus;

use farsight_runtime::EngineError;
use thiserror::Error;

/// A shared library that was not found or not fetched.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LibraryError {
    /// It is nowhere where it is looked for.
    #[error(
        "the library of {name} is not there; `farsight engine install {name}` fetches it with pip; if you have it, say where with --engine-path or {variable}"
    )]
    NotFound {
        /// Name of the engine.
        name: &'static str,
        /// The environment variable that may name it.
        variable: &'static str,
    },
    /// It is not where the user says.
    #[error("{}: no library of {name} here; expected {file} or a folder with it ({through})", folder.display())]
    NotIn {
        /// What was named.
        folder: PathBuf,
        /// Name of the engine.
        name: &'static str,
        /// The file that was expected.
        file: String,
        /// What named it.
        through: String,
    },
    /// A Python wheel from before the library was in it.
    #[error("{}: pip's onnxruntime without a shared library (its Python module {module} is none); versions from 1.18 bring one: `farsight engine install onnxruntime` ({through})", folder.display())]
    OldWheel {
        /// What was named.
        folder: PathBuf,
        /// The module of Python.
        module: String,
        /// What named it.
        through: String,
    },
    /// The user has no data folder to put it.
    #[error("no data folder of yours is known; set FARSIGHT_DATA to a folder")]
    NoDataFolder,
    /// There is no Python.
    #[error("no python3 to {task} with; it needs a Python that has pip: {source}")]
    NoPython {
        /// What it was wanted for.
        task: &'static str,
        /// What the system says.
        source: io::Error,
    },
    /// Python could not do it.
    #[error("python3 could not {task} ({status}); its own words are above")]
    Python {
        /// What it was wanted for.
        task: &'static str,
        /// How it ended.
        status: ExitStatus,
    },
    /// pip left something else.
    #[error("pip left no wheel of {0}")]
    NoWheel(&'static str),
    /// A wheel without the library.
    #[error("{}: no library of {name} in it", wheel.display())]
    NotInWheel {
        /// The wheel.
        wheel: PathBuf,
        /// Name of the engine.
        name: &'static str,
    },
    /// What was fetched does not work.
    #[error("the library that was fetched does not load: {0}")]
    Broken(#[source] EngineError),
    /// A file or folder.
    #[error("{}: cannot be {step}: {source}", path.display())]
    File {
        /// The file or folder.
        path: PathBuf,
        /// What was to be done with it.
        step: &'static str,
        /// What the system says.
        source: io::Error,
    },
}

impl LibraryError {
    /// A file or folder that cannot be `step`, as in "made".
    pub(super) fn file(path: impl Into<PathBuf>, step: &'static str) -> impl FnOnce(io::Error) -> Self {
        let path = path.into();
        move |source| Self::File { path, step, source }
    }
}

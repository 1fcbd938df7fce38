//! Shared libraries of the optional engines: where they are looked for, and how they get there.

mod error;
mod install;
mod python;

use std::env::{
    self,
    consts::{DLL_PREFIX, DLL_SUFFIX},
};
use std::fs;
use std::path::{Path, PathBuf};

use farsight_runtime::{EngineError, onnxruntime, openvino};

pub use error::LibraryError;
pub use install::install;

/// Where this program's own files lie, instead of the user's data folder.
const DATA_VARIABLE: &str = "FARSIGHT_DATA";

/// An engine that needs a shared library.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Library {
    /// Microsoft's ONNX Runtime, 1.17 or later.
    OnnxRuntime,
    /// Intel's OpenVINO, 2025.1 or later.
    OpenVino,
}

/// A library that was found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FoundLibrary {
    /// The library.
    pub path: PathBuf,
    /// How it was found, as in "found through ...".
    pub through: String,
}

impl Library {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::OnnxRuntime, Self::OpenVino];

    /// As users write it; also the name of its Python wheel.
    pub fn name(self) -> &'static str {
        match self {
            Self::OnnxRuntime => "onnxruntime",
            Self::OpenVino => "openvino",
        }
    }

    /// The environment variable that says where it is: the library, or a folder with it.
    fn variable(self) -> &'static str {
        match self {
            Self::OnnxRuntime => "FARSIGHT_ONNXRUNTIME",
            Self::OpenVino => "FARSIGHT_OPENVINO",
        }
    }

    /// The folder of the library within its wheel.
    fn wheel_folder(self) -> &'static str {
        match self {
            Self::OnnxRuntime => "onnxruntime/capi",
            Self::OpenVino => "openvino/libs",
        }
    }

    /// The file's name without prefix, suffix and version.
    fn stem(self) -> &'static str {
        match self {
            Self::OnnxRuntime => "onnxruntime",
            Self::OpenVino => "openvino_c",
        }
    }

    /// Where `farsight engine install` puts it.
    fn data_folder(self) -> Option<PathBuf> {
        Some(data_folder()?.join("engines").join(self.name()))
    }

    /// The library: at `given` if that is given, else where the environment, the user's data folder or the user's
    /// Python has it.
    ///
    /// # Errors
    /// When it is not there.
    pub fn find(self, given: Option<&Path>) -> Result<FoundLibrary, LibraryError> {
        if let Some(given) = given {
            return self.named(given, "--engine-path");
        }
        if let Some(named) = env::var_os(self.variable()).filter(|named| !named.is_empty()) {
            return self.named(Path::new(&named), self.variable());
        }
        let installed = self.data_folder().and_then(|folder| self.within(&folder));
        if let Some(path) = installed {
            return Ok(FoundLibrary { path, through: "`farsight engine install`".to_owned() });
        }
        if let Some(path) = python::package_folder(self.name()).and_then(|folder| self.within(folder.parent()?)) {
            return Ok(FoundLibrary { path, through: "the installed Python wheel".to_owned() });
        }
        Err(LibraryError::NotFound { name: self.name(), variable: self.variable() })
    }

    /// The library that the user names: the file itself, or a folder with it.
    fn named(self, named: &Path, through: &str) -> Result<FoundLibrary, LibraryError> {
        let path = if named.is_file() { Some(named.to_owned()) } else { self.within(named) };
        if let Some(path) = path {
            return Ok(FoundLibrary { path, through: through.to_owned() });
        }
        if let Some(module) = self.python_module(named) {
            return Err(LibraryError::OldWheel { folder: named.to_owned(), module, through: through.to_owned() });
        }
        Err(LibraryError::NotIn {
            folder: named.to_owned(),
            name: self.name(),
            file: format!("{DLL_PREFIX}{}{DLL_SUFFIX}", self.stem()),
            through: through.to_owned(),
        })
    }

    /// The library in `folder`, or in its place in an unpacked wheel there.
    fn within(self, folder: &Path) -> Option<PathBuf> {
        self.places(folder).iter().find_map(|folder| self.directly_in(folder))
    }

    /// `folder`, and the places of the library in a wheel there.
    fn places(self, folder: &Path) -> [PathBuf; 3] {
        let last = Path::new(self.wheel_folder()).file_name().unwrap_or_default();
        [folder.to_owned(), folder.join(self.wheel_folder()), folder.join(last)]
    }

    /// The module of Python that ONNX Runtime's wheels had alone up to 1.17, where it is in `folder`.
    fn python_module(self, folder: &Path) -> Option<String> {
        let is_module = |name: &String| self == Self::OnnxRuntime && name.starts_with("onnxruntime_pybind11_state.");
        let names = |folder: &PathBuf| {
            fs::read_dir(folder)
                .into_iter()
                .flatten()
                .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
                .collect::<Vec<_>>()
        };
        self.places(folder).iter().flat_map(names).find(is_module)
    }

    fn directly_in(self, folder: &Path) -> Option<PathBuf> {
        let names = fs::read_dir(folder).ok()?.filter_map(|entry| Some(entry.ok()?.path()));
        let mut found: Vec<PathBuf> = names.filter(|path| self.is_file_name(path)).collect();
        // The shortest name is the one without a version.
        found.sort_by_key(|path| (path.as_os_str().len(), path.clone()));
        found.into_iter().next()
    }

    /// `libonnxruntime.so`, `libonnxruntime.so.1.31.1`, `libonnxruntime.1.31.1.dylib`, `onnxruntime.dll`, but no other
    /// library beside it.
    fn is_file_name(self, path: &Path) -> bool {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let rest = name.strip_prefix(DLL_PREFIX).and_then(|name| name.strip_prefix(self.stem()));
        rest.is_some_and(|rest| rest.starts_with('.') && rest.contains(DLL_SUFFIX)) && path.is_file()
    }

    /// Loads the library at `path` and says which version it is.
    ///
    /// # Errors
    /// When it cannot be loaded, is too old, or its engine is not compiled in.
    pub fn version(self, path: &Path) -> Result<String, EngineError> {
        match self {
            Self::OnnxRuntime => onnxruntime::version(path),
            Self::OpenVino => openvino::version(path),
        }
    }
}

/// The user's data folder for this program.
pub fn data_folder() -> Option<PathBuf> {
    match env::var_os(DATA_VARIABLE).filter(|folder| !folder.is_empty()) {
        Some(folder) => Some(PathBuf::from(folder)),
        None => Some(dirs::data_dir()?.join("farsight")),
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::Library;

    #[cfg(target_os = "linux")]
    #[test]
    fn a_library_is_found_by_its_name_and_nothing_else_is() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir_all(at("onnxruntime/capi")).unwrap();
        for name in
            ["libonnxruntime_providers_shared.so", "libonnxruntime.txt", "onnxruntime/capi/libonnxruntime.so.1.31.1"]
        {
            fs::write(at(name), "").unwrap();
        }
        let found = Library::OnnxRuntime.find(Some(folder.path())).unwrap();
        assert_eq!(found.path, at("onnxruntime/capi/libonnxruntime.so.1.31.1"));
        assert_eq!(found.through, "--engine-path");
        fs::create_dir_all(at("old/onnxruntime/capi")).unwrap();
        fs::write(at("old/onnxruntime/capi/onnxruntime_pybind11_state.cpython-311-x86_64-linux-gnu.so"), "").unwrap();
        for named in ["old", "old/onnxruntime", "old/onnxruntime/capi"] {
            let error = Library::OnnxRuntime.find(Some(&at(named))).unwrap_err().to_string();
            assert!(error.contains("pip's onnxruntime without a shared library"), "{error}");
        }
        let error = Library::OpenVino.find(Some(folder.path())).unwrap_err().to_string();
        assert!(error.contains("no library of openvino here; expected libopenvino_c.so"), "{error}");
    }
}

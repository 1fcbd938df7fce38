//! Putting the library of a Python wheel into the user's data folder.

use std::ffi::{OsStr, OsString};
use std::fs;
use std::path::{Path, PathBuf};

use super::{FoundLibrary, Library, LibraryError, python};

/// Fetches the wheel of `library` with the user's pip, so that mirrors and proxies keep working, loads its shared
/// library once to see that it works, and keeps it. An older one is replaced.
///
/// # Errors
/// When there is no Python with pip, it cannot fetch the wheel, or the library in it does not load.
pub fn install(library: Library) -> Result<(FoundLibrary, String), LibraryError> {
    let target = library.data_folder().ok_or(LibraryError::NoDataFolder)?;
    let scratch = Scratch::beside(&target)?;
    let wheel = download(library, &scratch.0)?;
    let unpacked = scratch.0.join("unpacked");
    let unpack: [&OsStr; 5] =
        ["-m".as_ref(), "zipfile".as_ref(), "-e".as_ref(), wheel.as_os_str(), unpacked.as_os_str()];
    python::run(&unpack, "unpack the wheel")?;
    let fresh = unpacked.join(library.wheel_folder());
    let missing = || LibraryError::NotInWheel { wheel: wheel.clone(), name: library.name() };
    let path = library.within(&fresh).ok_or_else(missing)?;
    let version = library.version(&path).map_err(LibraryError::Broken)?;
    replace(&fresh, &target)?;
    let path = library.within(&target).ok_or_else(missing)?;
    Ok((FoundLibrary { path, through: "`farsight engine install`".to_owned() }, version))
}

/// The wheel, in `folder`.
fn download(library: Library, folder: &Path) -> Result<PathBuf, LibraryError> {
    let options = ["-m", "pip", "download", "--no-deps", "--only-binary", ":all:", "--dest"];
    let mut arguments: Vec<OsString> = options.iter().map(OsString::from).collect();
    arguments.extend([folder.into(), library.name().into()]);
    python::run(&arguments, "download the wheel")?;
    let names = fs::read_dir(folder).map_err(LibraryError::file(folder, "listed"))?;
    let wheel =
        names.filter_map(|entry| Some(entry.ok()?.path())).find(|path| path.extension() == Some("whl".as_ref()));
    wheel.ok_or(LibraryError::NoWheel(library.name()))
}

/// Puts `fresh` where `target` was.
fn replace(fresh: &Path, target: &Path) -> Result<(), LibraryError> {
    if target.exists() {
        fs::remove_dir_all(target).map_err(LibraryError::file(target, "replaced"))?;
    }
    fs::rename(fresh, target).map_err(LibraryError::file(target, "made"))
}

/// A folder that goes away again.
struct Scratch(PathBuf);

impl Scratch {
    fn beside(target: &Path) -> Result<Self, LibraryError> {
        let folder = target.with_extension(format!("partial-{}", std::process::id()));
        fs::create_dir_all(&folder).map_err(LibraryError::file(&folder, "made"))?;
        Ok(Self(folder))
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // What is left of it is of no use and does no harm.
        let _ = fs::remove_dir_all(&self.0);
    }
}

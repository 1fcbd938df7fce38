//! Putting the library of a Python wheel into the user's data folder.

use std::ffi::{OsStr, OsString};
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};

use super::{Found, Library, python};

/// Fetches the wheel of `library` with the user's pip, so that mirrors and proxies keep working, loads its shared library once to see that it
/// works, and keeps it. An older one is replaced.
pub(crate) fn install(library: Library) -> Result<(Found, String)> {
    let target = library.data_folder().context("no data folder of yours is known; set FARSIGHT_DATA to a folder")?;
    let scratch = Scratch::beside(&target)?;
    let wheel = download(library, &scratch.0)?;
    let unpacked = scratch.0.join("unpacked");
    let unpack: [&OsStr; 5] =
        ["-m".as_ref(), "zipfile".as_ref(), "-e".as_ref(), wheel.as_os_str(), unpacked.as_os_str()];
    python::run(&unpack, "unpack the wheel")?;
    let fresh = unpacked.join(library.wheel_folder());
    let Some(path) = library.within(&fresh) else {
        bail!("{}: no library of {} in it", wheel.display(), library.name())
    };
    let version = library.version(&path).context("the library that was fetched does not load")?;
    replace(&fresh, &target)?;
    let path = library.within(&target).context("the library is gone again")?;
    Ok((Found { path, through: "`farsight engine install`".to_owned() }, version))
}

/// The wheel, in `folder`.
fn download(library: Library, folder: &Path) -> Result<PathBuf> {
    let options = ["-m", "pip", "download", "--no-deps", "--only-binary", ":all:", "--dest"];
    let mut arguments: Vec<OsString> = options.iter().map(OsString::from).collect();
    arguments.extend([folder.into(), library.name().into()]);
    python::run(&arguments, "download the wheel")?;
    let names = fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    let wheel =
        names.filter_map(|entry| Some(entry.ok()?.path())).find(|path| path.extension() == Some("whl".as_ref()));
    wheel.with_context(|| format!("pip left no wheel of {}", library.name()))
}

/// Puts `fresh` where `target` was.
fn replace(fresh: &Path, target: &Path) -> Result<()> {
    if target.exists() {
        fs::remove_dir_all(target).with_context(|| format!("{}: cannot be replaced", target.display()))?;
    }
    fs::rename(fresh, target).with_context(|| format!("{}: cannot be made", target.display()))
}

/// A folder that goes away again.
struct Scratch(PathBuf);

impl Scratch {
    fn beside(target: &Path) -> Result<Self> {
        let folder = target.with_extension(format!("partial-{}", std::process::id()));
        fs::create_dir_all(&folder).with_context(|| format!("{}: cannot be made", folder.display()))?;
        Ok(Self(folder))
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // What is left of it is of no use and does no harm.
        let _ = fs::remove_dir_all(&self.0);
    }
}

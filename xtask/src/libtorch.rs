//! Finding libtorch 2.11, or fetching it: three wheels, unpacked, nothing installed.

use std::env;
use std::ffi::OsString;
use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::{root, run};

/// The PyTorch that tch 0.24 binds to.
const VERSION: &str = "2.11";

/// The wheels that hold libtorch and what it needs to start on a CPU: 0.54 GB, 1.2 GB unpacked.
const WHEELS: [&str; 3] = ["torch==2.11.0", "nvidia-cuda-runtime==13.0.96", "nvidia-cuda-cupti==13.0.85"];

/// Asks a Python for the folder of its PyTorch and the version, without the seconds that importing it takes.
const ASK_PYTHON: &str = "\
import importlib.metadata as m, importlib.util as u
print(m.version('torch'))
print(u.find_spec('torch').submodule_search_locations[0])";

/// A libtorch on this machine.
#[derive(Debug)]
pub(crate) struct Libtorch {
    /// The folder with `include` and `lib`.
    torch: PathBuf,
    /// Folders of shared libraries.
    libraries: Vec<PathBuf>,
}

impl Libtorch {
    /// The one that the user names in `LIBTORCH`, the one fetched before, the one of the Python on the path, or a fresh
    /// one.
    pub(crate) fn find_or_fetch() -> Result<Self, String> {
        if let Some(torch) = env::var_os("LIBTORCH") {
            return Self::at(Path::new(&torch))
                .ok_or_else(|| format!("LIBTORCH is {}; expected a folder with lib/libtorch_cpu.so", torch.display()));
        }
        let folder = root().join(".libtorch");
        if let Some(found) = Self::at(&folder.join("torch")).or_else(Self::of_python) {
            return Ok(found);
        }
        fetch(&folder)?;
        Self::at(&folder.join("torch")).ok_or_else(|| format!("{}: the wheels hold no libtorch", folder.display()))
    }

    /// The libtorch in `torch`, with the CUDA libraries that wheels put beside it.
    fn at(torch: &Path) -> Option<Self> {
        let library = torch.join("lib");
        if !library.join("libtorch_cpu.so").is_file() && !library.join("libtorch_cpu.dylib").is_file() {
            return None;
        }
        let mut libraries = vec![library];
        let nvidia = torch.parent()?.join("nvidia");
        if let Ok(entries) = fs::read_dir(nvidia) {
            let mut folders: Vec<PathBuf> =
                entries.flatten().map(|e| e.path().join("lib")).filter(|p| p.is_dir()).collect();
            folders.sort();
            libraries.extend(folders);
        }
        Some(Self { torch: torch.to_path_buf(), libraries })
    }

    fn of_python() -> Option<Self> {
        let output = Command::new("python3").args(["-c", ASK_PYTHON]).stderr(Stdio::null()).output().ok()?;
        let text = String::from_utf8(output.stdout).ok()?;
        let mut lines = text.lines();
        let version = lines.next()?;
        version.starts_with(VERSION).then(|| Self::at(Path::new(lines.next()?))).flatten()
    }

    /// Makes `command`, and what it starts, use this libtorch.
    pub(crate) fn apply(&self, command: &mut Command) {
        let variable = if cfg!(target_os = "macos") { "DYLD_LIBRARY_PATH" } else { "LD_LIBRARY_PATH" };
        let before: Vec<PathBuf> = env::var_os(variable).map(|v| env::split_paths(&v).collect()).unwrap_or_default();
        let path = env::join_paths(self.libraries.iter().chain(&before)).unwrap_or_else(|_| OsString::new());
        command.env("LIBTORCH", &self.torch).env(variable, path);
        // OpenMP's threads otherwise wait for each other at full speed: beside any other work on the machine a training
        // takes several times as long.
        if env::var_os("OMP_WAIT_POLICY").is_none() {
            command.env("OMP_WAIT_POLICY", "passive");
        }
        // glibc otherwise gives each large tensor back to the system, and gets zeroed pages for the next one.
        for (variable, value) in [("MALLOC_MMAP_MAX_", "0"), ("MALLOC_TRIM_THRESHOLD_", "8589934592")] {
            if env::var_os(variable).is_none() {
                command.env(variable, value);
            }
        }
        if self.torch.join("lib/libtorch_cuda.so").is_file() && Path::new("/dev/nvidia0").exists() {
            // The linker drops a library that no symbol asks for, and CUDA registers itself only when it is loaded.
            command.env("LD_PRELOAD", self.torch.join("lib/libtorch_cuda.so"));
        }
    }
}

impl fmt::Display for Libtorch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "libtorch: {}", self.torch.display())
    }
}

/// Downloads the wheels with the user's pip, so that mirrors and proxies keep working, and unpacks them into `folder`.
fn fetch(folder: &Path) -> Result<(), String> {
    if !cfg!(all(target_os = "linux", target_arch = "x86_64")) {
        return Err(format!(
            "no PyTorch {VERSION} found, and fetching it is only known to work on 64-bit x86 Linux. Install it for the python3 \
             on your path (pip install torch=={VERSION}.*), or set LIBTORCH to an unpacked libtorch {VERSION}."
        ));
    }
    eprintln!("fetching libtorch {VERSION} with pip (0.54 GB) into {}", folder.display());
    let partial = folder.with_extension("partial");
    let wheels = partial.join("wheels");
    let io_error = |what: &Path| format!("{}: could not be written", what.display());
    // What a killed run left behind is no use.
    let _ = fs::remove_dir_all(&partial);
    fs::create_dir_all(&wheels).map_err(|e| format!("{}: {e}", io_error(&wheels)))?;
    let python = "3.12";
    let download = [
        "-m",
        "pip",
        "download",
        "--no-deps",
        "--only-binary=:all:",
        "--python-version",
        python,
        "--implementation",
        "cp",
    ];
    let platforms = ["manylinux_2_28_x86_64", "manylinux_2_25_x86_64", "manylinux_2_17_x86_64", "manylinux2014_x86_64"];
    let platforms = platforms.iter().flat_map(|platform| ["--platform", platform]);
    run(Command::new("python3").args(download).args(platforms).arg("--dest").arg(&wheels).args(WHEELS)).map_err(|e| {
        format!("{e}\nlibtorch could not be fetched; install PyTorch {VERSION} for your python3, or set LIBTORCH to an unpacked libtorch")
    })?;
    let entries = fs::read_dir(&wheels).map_err(|e| format!("{}: {e}", wheels.display()))?;
    for wheel in entries.flatten() {
        eprintln!("unpacking {}", wheel.file_name().display());
        run(Command::new("python3").args(["-m", "zipfile", "-e"]).arg(wheel.path()).arg(&partial))?;
    }
    let _ = fs::remove_dir_all(&wheels);
    fs::rename(&partial, folder).map_err(|e| format!("{}: {e}", io_error(folder)))
}

//! The Python wheel: building it, and trying it in an environment that has nothing else.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::SystemTime;

use crate::python::{maturin, script};
use crate::{cargo, root, run};

/// What is built how.
#[derive(Debug, Clone, Copy, Default)]
struct Options {
    /// Built as tests are, in a folder of its own.
    dev: bool,
    /// Which of its tests are run.
    tests: Tests,
}

/// Which tests are run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
enum Tests {
    #[default]
    None,
    /// All but those with a local Ray.
    Plain,
    /// A few of these and one with Ray: those that CI runs.
    Slice,
    /// All those with Ray.
    Ray,
}

impl Tests {
    /// What they need beside the wheel.
    fn requirements(self) -> &'static [&'static str] {
        match self {
            Self::None => &[],
            Self::Plain => &["requirements.txt"],
            Self::Slice => &["requirements.txt", "requirements-ray.txt"],
            Self::Ray => &["requirements-ray.txt"],
        }
    }

    /// Engines that are tried where they can be had.
    fn engines(self) -> &'static [&'static str] {
        match self {
            Self::None | Self::Slice | Self::Ray => &[],
            Self::Plain => &["onnxruntime", "openvino"],
        }
    }

    /// The marks of those that are chosen, for pytest.
    fn marks(self) -> &'static str {
        match self {
            Self::None | Self::Plain => "not ray",
            Self::Slice => "slice",
            Self::Ray => "ray",
        }
    }
}

impl Options {
    fn from_words(words: &[&str]) -> Result<Self, String> {
        let mut options = Self::default();
        for word in words {
            match *word {
                "--dev" => options.dev = true,
                "--test" => options.tests = Tests::Plain,
                "--test=slice" => options.tests = Tests::Slice,
                "--test=ray" => options.tests = Tests::Ray,
                other => {
                    return Err(format!("unexpected argument {other:?}; expected --dev, --test[=slice|=ray] or none"));
                }
            }
        }
        Ok(options)
    }

    /// Where the wheel goes.
    fn folder(self) -> PathBuf {
        root().join(if self.dev { "target/wheels/dev" } else { "target/wheels" })
    }

    /// Cargo's words for it.
    fn profile(self) -> &'static [&'static str] {
        if self.dev { &[] } else { &["--release"] }
    }

    fn program(self) -> PathBuf {
        let name = format!("farsight{}", env::consts::EXE_SUFFIX);
        root().join("target").join(if self.dev { "debug" } else { "release" }).join(name)
    }
}

/// Builds the wheel, and runs its tests where they are asked for.
pub(crate) fn wheel(words: &[&str]) -> Result<(), String> {
    let options = Options::from_words(words)?;
    let wheel = build(options)?;
    eprintln!("{}", wheel.display());
    if options.tests == Tests::None { Ok(()) } else { test(options, &package(), &wheel) }
}

/// The wheel of a release.
pub(crate) fn build_release() -> Result<PathBuf, String> {
    build(Options::default())
}

fn package() -> PathBuf {
    root().join("crates/farsight-py")
}

fn build(options: Options) -> Result<PathBuf, String> {
    let maturin = maturin()?;
    let folder = options.folder();
    let mut build = Command::new(maturin);
    build.args(["build", "--locked"]).args(options.profile()).arg("--out").arg(&folder).current_dir(package());
    run(&mut build)?;
    newest_wheel(&folder)
}

/// Installs the wheel into a fresh environment, sees that it needs nothing else, and runs its tests there beside the
/// program of the same build.
fn test(options: Options, package: &Path, wheel: &Path) -> Result<(), String> {
    // A program that is there already, with whatever features, need not be built again.
    let built = env::var_os("FARSIGHT_PROGRAM").map(PathBuf::from);
    if built.is_none() {
        run(cargo(None).args(["build", "--quiet", "--package", "farsight"]).args(options.profile()))?;
    }
    let environment = root().join("target/wheel-environment");
    run(Command::new("python3").args(["-m", "venv", "--clear"]).arg(&environment))?;
    let python = script(&environment, "python");
    let pip = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check"];
    run(Command::new(&python).args(pip).arg(wheel))?;
    run(Command::new(&python).args(["-I", "-W", "error", "-c", "import farsight; farsight.Model()"]))?;
    let mut install = Command::new(&python);
    install.args(pip);
    for file in options.tests.requirements() {
        install.arg("-r").arg(package.join("tests").join(file));
    }
    run(&mut install)?;
    for package in options.tests.engines() {
        if let Err(error) = run(Command::new(&python).args(pip).arg(package)) {
            eprintln!("{error}; the tests with {package} are skipped");
        }
    }
    let mut pytest = Command::new(&python);
    pytest
        .args(["-m", "pytest", "--quiet", "-m", options.tests.marks()])
        .env("FARSIGHT_PROGRAM", built.unwrap_or_else(|| options.program()))
        .current_dir(package);
    run(&mut pytest)
}

/// The wheel that was built last.
fn newest_wheel(folder: &Path) -> Result<PathBuf, String> {
    let entries = fs::read_dir(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let wheels = entries.flatten().map(|entry| entry.path()).filter(|path| path.extension() == Some("whl".as_ref()));
    let written = |path: &PathBuf| path.metadata().and_then(|it| it.modified()).unwrap_or(SystemTime::UNIX_EPOCH);
    wheels.max_by_key(written).ok_or_else(|| format!("{}: maturin left no wheel", folder.display()))
}

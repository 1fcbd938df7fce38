//! The Python wheel: building it, and trying it in an environment that has nothing else.
//!
//! CI tries the module of the tested tree instead: a wheel has other features, and nearly every crate would be built
//! once more for it.

use std::env;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::SystemTime;

use crate::python::{maturin, script};
use crate::{Libtorch, TESTED_FEATURES, cargo, root, run};

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
    /// A few of these and one with Ray, with the module of the tested tree: what CI runs.
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
    if options.tests == Tests::Slice {
        return test_tree(&package());
    }
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
    let environment = Environment::fresh()?;
    environment.install(wheel.as_os_str())?;
    run(environment.python().args(["-I", "-W", "error", "-c", "import farsight; farsight.Model()"]))?;
    environment.install_requirements(options.tests, package)?;
    for package in options.tests.engines() {
        if let Err(error) = environment.install(package.as_ref()) {
            eprintln!("{error}; the tests with {package} are skipped");
        }
    }
    let program = built.unwrap_or_else(|| options.program());
    environment.pytest(options.tests, package, &program, None)
}

/// Puts the module that the tested tree makes where a wheel would, and runs a few tests.
fn test_tree(package: &Path) -> Result<(), String> {
    let libtorch = Libtorch::find_or_fetch()?;
    // With the features that tests bring along, or nothing of what they built would be of use.
    let build = ["build", "--workspace", "--features", TESTED_FEATURES, "--example", "quickstart"];
    run(cargo(Some(&libtorch)).args(build).args(["--lib", "--bin", "farsight"]))?;
    let environment = Environment::fresh()?;
    environment.install_requirements(Tests::Slice, package)?;
    let installed = environment.packages()?.join("farsight");
    fs::create_dir_all(&installed).map_err(|error| format!("{}: {error}", installed.display()))?;
    let sources = package.join("python/farsight");
    let entries = fs::read_dir(&sources).map_err(|error| format!("{}: {error}", sources.display()))?;
    let files = entries.flatten().map(|entry| entry.path()).filter(|path| path.is_file());
    let module = format!("{}_farsight{}", env::consts::DLL_PREFIX, env::consts::DLL_SUFFIX);
    let module = (root().join("target/debug").join(module), "_farsight.abi3.so".into());
    let named = files.filter_map(|path| Some((path.clone(), path.file_name()?.to_owned())));
    for (from, name) in named.chain([module]) {
        fs::copy(&from, installed.join(name)).map_err(|error| format!("{}: {error}", from.display()))?;
    }
    environment.pytest(Tests::Slice, package, &Options { dev: true, ..Options::default() }.program(), Some(&libtorch))
}

/// A Python environment that has what was put there, and nothing else.
struct Environment(PathBuf);

impl Environment {
    fn fresh() -> Result<Self, String> {
        let folder = root().join("target/wheel-environment");
        run(Command::new("python3").args(["-m", "venv", "--clear"]).arg(&folder))?;
        Ok(Self(folder))
    }

    fn python(&self) -> Command {
        Command::new(script(&self.0, "python"))
    }

    fn pip(&self) -> Command {
        let mut pip = self.python();
        pip.args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check"]);
        pip
    }

    fn install(&self, package: &OsStr) -> Result<(), String> {
        run(self.pip().arg(package))
    }

    /// What these tests need beside the module.
    fn install_requirements(&self, tests: Tests, package: &Path) -> Result<(), String> {
        let mut pip = self.pip();
        for file in tests.requirements() {
            pip.arg("-r").arg(package.join("tests").join(file));
        }
        run(&mut pip)
    }

    /// Where its packages lie.
    fn packages(&self) -> Result<PathBuf, String> {
        let asked = self.python().args(["-c", "import sysconfig; print(sysconfig.get_path('purelib'))"]).output();
        let output = asked.map_err(|error| format!("{}: {error}", self.0.display()))?;
        let folder = String::from_utf8_lossy(&output.stdout).trim().to_owned();
        if folder.is_empty() { Err(format!("{}: no packages", self.0.display())) } else { Ok(folder.into()) }
    }

    fn pytest(&self, tests: Tests, package: &Path, program: &Path, libtorch: Option<&Libtorch>) -> Result<(), String> {
        let mut pytest = self.python();
        pytest
            .args(["-m", "pytest", "--quiet", "-m", tests.marks()])
            .env("FARSIGHT_PROGRAM", program)
            .current_dir(package);
        if let Some(libtorch) = libtorch {
            libtorch.apply(&mut pytest);
        }
        run(&mut pytest)
    }
}

/// The wheel that was built last.
fn newest_wheel(folder: &Path) -> Result<PathBuf, String> {
    let entries = fs::read_dir(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let wheels = entries.flatten().map(|entry| entry.path()).filter(|path| path.extension() == Some("whl".as_ref()));
    let written = |path: &PathBuf| path.metadata().and_then(|it| it.modified()).unwrap_or(SystemTime::UNIX_EPOCH);
    wheels.max_by_key(written).ok_or_else(|| format!("{}: maturin left no wheel", folder.display()))
}

//! Chores of the workspace. They need cargo and, for libtorch and the wheel, a Python that has pip.

mod dist;
mod libtorch;
mod python;
mod quickstart;
mod sbom;
mod wheel;

use std::env;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use libtorch::Libtorch;

const USAGE: &str = "\
cargo xtask COMMAND

  quickstart [--data DIR]  fetch libtorch, train the compact network on eight KITTI frames, range them, draw them
  test [--all | ARGS]      all tests, libtorch included; --all with those that take long, rerun and Ray, and with the Python packages
                           that single tests want, which pip fetches; --no-run builds them; ARGS go to `cargo test`
  check                    formatting, clippy with warnings denied, docs
  run ARGS                 farsight with training: `cargo xtask run train --config configs/smoke.toml --data DIR`
  exec COMMAND [ARGS]      any command with libtorch where it will look for it
  fuzz [--minutes N] [--table FILE] [TARGET...]
                           every fuzz target, or these, for N minutes of processor time each (default 1), training's too; what breaks a law goes to fuzz/artifacts, what was tried to FILE
  wheel [--dev] [--test]   the Python wheel into target/wheels; --dev builds it quickly, --test tries it in a clean environment,
                           --test=ray with those on a local Ray alone; --test=slice makes no wheel and tries the module of the tested
                           tree with a few tests and one on a local Ray, as CI does
  dist [--no-wheel]        the archives of a release into target/dist: program, wheel, SBOM, checksums, crates for the registry
  libtorch                 find PyTorch 2.11 or fetch its library into .libtorch, and say where it is

DIR is a folder in KITTI's layout; default: frames in $FARSIGHT_KITTI, else ../shared/kitti/frames";

/// Features that the tests are built with.
const TESTED_FEATURES: &str = "farsight/train,farsight-laws/train";

fn main() -> ExitCode {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let rest: Vec<&str> = arguments.iter().skip(1).map(String::as_str).collect();
    let done = match arguments.first().map(String::as_str) {
        Some("quickstart") => data_folder(&rest).and_then(|data| quickstart::quickstart(&data)),
        Some("test") => test(&rest),
        Some("check") => check(),
        Some("run") => Libtorch::find_or_fetch().and_then(|libtorch| farsight(&libtorch, &rest)),
        Some("exec") => exec(&rest),
        Some("fuzz") => fuzz(&rest),
        Some("wheel") => wheel::wheel(&rest),
        Some("dist") => dist::dist(&rest),
        Some("libtorch") => Libtorch::find_or_fetch().map(|libtorch| eprintln!("{libtorch}")),
        Some("help" | "--help" | "-h") => {
            eprintln!("{USAGE}");
            Ok(())
        }
        Some(other) => Err(format!("no command \"{other}\"\n\n{USAGE}")),
        None => Err(USAGE.to_owned()),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("{message}");
            ExitCode::from(2)
        }
    }
}

/// The top of the workspace.
fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().map_or_else(PathBuf::new, Path::to_path_buf)
}

/// The cargo that runs this, in the top of the workspace, with libtorch where it will look for it.
fn cargo(libtorch: Option<&Libtorch>) -> Command {
    let mut command = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.current_dir(root());
    if let Some(libtorch) = libtorch {
        libtorch.apply(&mut command);
    }
    command
}

/// Runs `command`; an error that names it when it fails.
fn run(command: &mut Command) -> Result<(), String> {
    let status = command.status().map_err(|e| format!("{}: {e}", command.get_program().display()))?;
    if status.success() {
        return Ok(());
    }
    let words: Vec<_> = command.get_args().map(|a| a.to_string_lossy().into_owned()).collect();
    Err(format!("`{} {}` failed ({status})", command.get_program().display(), words.join(" ")))
}

/// Runs farsight, built with training.
fn farsight(libtorch: &Libtorch, arguments: &[&str]) -> Result<(), String> {
    let cargo_arguments = ["run", "--quiet", "--package", "farsight", "--features", "train", "--"];
    run(cargo(Some(libtorch)).args(cargo_arguments).args(arguments).current_dir(env::current_dir().unwrap_or_default()))
}

fn exec(words: &[&str]) -> Result<(), String> {
    let Some((program, arguments)) = words.split_first() else { return Err(format!("no command to run\n\n{USAGE}")) };
    let mut command = Command::new(program);
    Libtorch::find_or_fetch()?.apply(&mut command);
    run(command.args(arguments))
}

fn test(arguments: &[&str]) -> Result<(), String> {
    let libtorch = Libtorch::find_or_fetch()?;
    let everything = ["test", "--workspace", "--features", TESTED_FEATURES];
    // The examples, which `check` compiles, would take a minute to build and have no tests.
    let targets = ["--lib", "--bins", "--tests"];
    // All but one, which a test runs. With the features of all, or most crates would be built once more.
    let example = || {
        let build = ["build", "--workspace", "--features", TESTED_FEATURES, "--example", "quickstart"];
        run(cargo(Some(&libtorch)).args(build))
    };
    if arguments.is_empty() {
        example()?;
        run(cargo(Some(&libtorch)).args(everything).args(targets))?;
        return run(cargo(Some(&libtorch)).args(everything).arg("--doc"));
    }
    if arguments == ["--no-run"] {
        run(cargo(Some(&libtorch)).args(everything).args(targets).arg("--no-run"))?;
        return example();
    }
    if arguments != ["--all"] {
        return run(cargo(Some(&libtorch)).args(everything).args(arguments));
    }
    let features = "farsight/train,farsight/rerun,farsight-laws/train";
    let path = python::path_with_everything()?;
    let all = ["test", "--workspace", "--features", features, "--", "--include-ignored"];
    // Commands are killed that take long, and each more often.
    let tries = env::var_os("FARSIGHT_FAULTS").unwrap_or_else(|| "3".into());
    run(cargo(Some(&libtorch)).args(all).env("PATH", path).env("FARSIGHT_FAULTS", tries))?;
    wheel::wheel(&["--dev", "--test"])?;
    wheel::wheel(&["--dev", "--test=ray"])
}

/// Feeds every target on any compiler; libFuzzer, which needs a nightly one, is `cargo +nightly fuzz run TARGET`.
fn fuzz(arguments: &[&str]) -> Result<(), String> {
    let minutes = arguments.iter().position(|word| *word == "--minutes").map(|place| arguments.get(place + 1));
    let is_number = |text: &&str| text.parse::<f64>().is_ok_and(|minutes| minutes > 0.0);
    if minutes.is_some_and(|minutes| !minutes.is_some_and(is_number)) {
        return Err("--minutes: expected a number of minutes, such as 5".to_owned());
    }
    let libtorch = Libtorch::find_or_fetch()?;
    let program = ["run", "--quiet", "--package", "farsight-laws", "--features", "train", "--bin", "fuzz", "--"];
    run(cargo(Some(&libtorch)).args(program).args(arguments))
}

fn check() -> Result<(), String> {
    let libtorch = Libtorch::find_or_fetch()?;
    let everything = ["--workspace", "--all-targets", "--features", TESTED_FEATURES];
    run(cargo(None).args(["fmt", "--all", "--check"]))?;
    // `cargo fmt` does not see modules that a macro makes.
    run(Command::new("rustfmt").args(["--check", "--edition", "2024"]).args(method_folders()?))?;
    run(cargo(Some(&libtorch)).arg("clippy").args(everything).args(["--", "-D", "warnings"]))?;
    // Without training, as the everyday build is; of all crates, so that those of others are not checked once more with
    // fewer features.
    run(cargo(Some(&libtorch)).args(["clippy", "--workspace", "--", "-D", "warnings"]))?;
    run(cargo(Some(&libtorch)).args(["doc", "--workspace", "--no-deps"]).env("RUSTDOCFLAGS", "-D warnings"))
}

/// The modules of the methods, which a table makes.
fn method_folders() -> Result<Vec<PathBuf>, String> {
    let folder = root().join("crates/farsight-methods/src");
    let entries = std::fs::read_dir(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let modules = entries.filter_map(|entry| Some(entry.ok()?.path().join("mod.rs")));
    Ok(modules.filter(|module| module.is_file()).collect())
}

/// The folder of KITTI frames that the arguments or the environment name.
fn data_folder(arguments: &[&str]) -> Result<PathBuf, String> {
    let named = match arguments {
        [] => None,
        ["--data", folder] => Some(PathBuf::from(folder)),
        other => return Err(format!("unexpected arguments {other:?}; expected --data DIR or none")),
    };
    let kitti = || env::var_os("FARSIGHT_KITTI").map_or_else(|| root().join("../shared/kitti"), PathBuf::from);
    let folder = named.unwrap_or_else(|| kitti().join("frames"));
    if folder.join("training/image_2").is_dir() {
        return Ok(folder);
    }
    Err(format!(
        "{0}: no KITTI frames here; expected {0}/training/image_2, calib and label_2, and {0}/ImageSets/train.txt and val.txt.\n\
         Farsight ships no KITTI images (their licence). Download the KITTI object benchmark and say\n\
         --data DIR, or set FARSIGHT_KITTI to the folder that holds `frames`.",
        folder.display()
    ))
}

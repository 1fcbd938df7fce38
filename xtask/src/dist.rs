//! The archives of a release: the program with its manual, the wheel, the crates, what they are made of, checksums.

use std::env;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::Command;

use sha2::{Digest, Sha256};

use crate::sbom;
use crate::wheel;
use crate::{cargo, root, run};

/// What lies beside the program.
const PAPERS: [&str; 5] = ["README.md", "CHANGELOG.md", "LICENSE-MIT", "LICENSE-APACHE", "NOTICE"];

/// Shells whose completions come along.
const SHELLS: [&str; 4] = ["bash", "fish", "powershell", "zsh"];

/// The registry takes no larger crates, bytes.
const MAX_CRATE: u64 = 10 << 20;

/// Version of all crates.
const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Makes all of it in target/dist, which is emptied before.
pub(crate) fn dist(words: &[&str]) -> Result<(), String> {
    let with_wheel = match words {
        [] => true,
        ["--no-wheel"] => false,
        other => return Err(format!("unexpected arguments {other:?}; expected --no-wheel or none")),
    };
    let changes = changes_of(&read(&root().join("CHANGELOG.md"))?, VERSION)?;
    let folder = root().join("target/dist");
    remove(&folder)?;
    make(&folder)?;
    program(&folder)?;
    if with_wheel {
        let built = wheel::build_release()?;
        copy(&built, &folder.join(built.file_name().unwrap_or_default()))?;
    }
    crates()?;
    write(&folder.join("CHANGES.md"), &changes)?;
    write(&folder.join(format!("farsight-{VERSION}.cdx.json")), &sbom::cyclone_dx(VERSION)?)?;
    let sums = checksums(&folder)?;
    write(&folder.join("SHA256SUMS"), &sums)?;
    eprint!("{sums}");
    eprintln!("in {}; crates in target/package", folder.display());
    Ok(())
}

/// The program, its manual pages and completions as one archive.
fn program(folder: &Path) -> Result<(), String> {
    run(cargo(None).args(["build", "--release", "--locked", "--package", "farsight"]))?;
    let built = root().join("target/release").join(format!("farsight{}", env::consts::EXE_SUFFIX));
    let name = format!("farsight-{VERSION}-{}-{}", env::consts::ARCH, env::consts::OS);
    let inside = folder.join(&name);
    ["man", "completions"].iter().try_for_each(|part| make(&inside.join(part)))?;
    copy(&built, &inside.join(built.file_name().unwrap_or_default()))?;
    PAPERS.iter().try_for_each(|paper| copy(&root().join(paper), &inside.join(paper)))?;
    write(&inside.join("man/farsight.1"), &printed(&built, &["man"])?)?;
    for shell in SHELLS {
        write(&inside.join(format!("completions/farsight.{shell}")), &printed(&built, &["completions", shell])?)?;
    }
    let archive = format!("{name}.tar.gz");
    // Windows, macOS and Linux all have a tar.
    run(Command::new("tar").current_dir(folder).args(["-czf", &archive, &name]))?;
    remove(&inside)
}

/// The crates as the registry takes them, each small enough.
fn crates() -> Result<(), String> {
    let folder = root().join("target/package");
    remove(&folder)?;
    // Without building them: that needs libtorch, and everything was built before.
    run(cargo(None).args(["publish", "--workspace", "--dry-run", "--no-verify", "--locked", "--quiet"]))?;
    let crates = crates_below(&folder)?;
    if crates.is_empty() {
        return Err(format!("{}: cargo left no crates here to be weighed", folder.display()));
    }
    for path in crates {
        let bytes = path.metadata().map_err(|error| format!("{}: {error}", path.display()))?.len();
        if bytes > MAX_CRATE {
            return Err(format!("{}: {bytes} bytes; the registry takes at most {MAX_CRATE}", path.display()));
        }
    }
    Ok(())
}

/// The crates in a folder and in those within it: where cargo keeps them depends on its version.
fn crates_below(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let entries = fs::read_dir(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let mut found = Vec::new();
    for path in entries.flatten().map(|entry| entry.path()) {
        if path.is_dir() {
            found.extend(crates_below(&path)?);
        } else if path.extension() == Some("crate".as_ref()) {
            found.push(path);
        }
    }
    Ok(found)
}

/// The part of the changelog about a version.
fn changes_of(changelog: &str, version: &str) -> Result<String, String> {
    let heading = format!("## {version}");
    let lines = changelog.lines().skip_while(|line| !line.starts_with(&heading));
    let about: Vec<&str> = lines.take_while(|line| !line.starts_with("## ") || line.starts_with(&heading)).collect();
    if about.len() < 2 {
        return Err(format!(
            "CHANGELOG.md: nothing about this version; expected a heading \"{heading}\" and what changed"
        ));
    }
    Ok(about.join("\n") + "\n")
}

/// A line for each file, as `sha256sum --check` reads them.
fn checksums(folder: &Path) -> Result<String, String> {
    let line = |path: PathBuf| {
        let bytes = fs::read(&path).map_err(|error| format!("{}: {error}", path.display()))?;
        let digest = Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect::<Vec<_>>().concat();
        Ok(format!("{digest}  {}\n", path.file_name().unwrap_or_default().display()))
    };
    files(folder)?.into_iter().map(line).collect()
}

/// The files in a folder, sorted.
fn files(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let entries = fs::read_dir(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).filter(|path| path.is_file()).collect();
    files.sort();
    Ok(files)
}

fn printed(program: &Path, arguments: &[&str]) -> Result<String, String> {
    let output = Command::new(program).args(arguments).output();
    let output = output.map_err(|error| format!("{}: {error}", program.display()))?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    if output.status.success() { Ok(text) } else { Err(format!("{} {arguments:?} failed", program.display())) }
}

fn remove(folder: &Path) -> Result<(), String> {
    match fs::remove_dir_all(folder) {
        Err(error) if error.kind() != ErrorKind::NotFound => Err(format!("{}: {error}", folder.display())),
        _ => Ok(()),
    }
}

fn make(folder: &Path) -> Result<(), String> {
    fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))
}

fn copy(from: &Path, to: &Path) -> Result<(), String> {
    fs::copy(from, to).map(drop).map_err(|error| format!("{} to {}: {error}", from.display(), to.display()))
}

fn read(path: &Path) -> Result<String, String> {
    fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display()))
}

fn write(path: &Path, text: &str) -> Result<(), String> {
    fs::write(path, text).map_err(|error| format!("{}: {error}", path.display()))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::{changes_of, crates_below};

    #[test]
    fn crates_are_found_wherever_cargo_keeps_them() {
        let folder = std::env::temp_dir().join(format!("farsight-crates-{}", std::process::id()));
        fs::create_dir_all(folder.join("tmp-registry")).unwrap();
        for name in ["a-0.1.0.crate", "tmp-registry/b-0.1.0.crate", "tmp-registry/notes.txt"] {
            fs::write(folder.join(name), "").unwrap();
        }
        let mut found = crates_below(&folder).unwrap();
        found.sort();
        assert_eq!(found, ["a-0.1.0.crate", "tmp-registry/b-0.1.0.crate"].map(|name| folder.join(name)));
        fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn changes_are_those_of_the_version() {
        let text = "# Changes\n\n## 0.2.0\n\n- New.\n\n## 0.1.0\n\n- First.\n";
        assert_eq!(changes_of(text, "0.2.0").unwrap(), "## 0.2.0\n\n- New.\n\n");
        assert_eq!(changes_of(text, "0.1.0").unwrap(), "## 0.1.0\n\n- First.\n");
        assert!(changes_of(text, "0.3.0").unwrap_err().contains("expected a heading \"## 0.3.0\""));
    }
}

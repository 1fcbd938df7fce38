//! Where results go, checked before the work that makes them: nothing that somebody still needs is replaced, and no
//! work is lost for want of a folder.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use farsight::file_kind::start_of;
use farsight_data::kitti::{RowKind, row_from_fields};
use farsight_files::{check_writable, remove_stale_scratch};

use crate::inputs::identity;

/// Whether a file can be written to `path`.
pub(crate) fn check_file(path: &Path) -> Result<()> {
    ensure!(!path.is_dir(), "{}: a folder; expected the name of a file to write", path.display());
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    ensure!(folder.is_dir(), "{}: no folder {}; expected one that is there", path.display(), folder.display());
    Ok(check_writable(path)?)
}

/// As [`check_file`]; JSON replaces JSON, but nothing else and none of the `inputs`.
pub(crate) fn check_json<P: AsRef<Path>>(path: &Path, inputs: impl IntoIterator<Item = P>) -> Result<()> {
    let shown = path.display();
    ensure!(path != Path::new("-"), "-: no name of a file; expected one, or /dev/stdout");
    let replaced = identity(path);
    let is_input = path.exists() && inputs.into_iter().any(|input| identity(input.as_ref()) == replaced);
    ensure!(!is_input, "{shown}: an input; expected another file for the JSON");
    let start = start_of(path).with_context(|| format!("{shown}: cannot be read"))?;
    let first = start.iter().find(|byte| !byte.is_ascii_whitespace());
    ensure!(first.is_none_or(|byte| b"[{".contains(byte)), "{shown}: there already and no JSON; expected another file");
    check_file(path)
}

/// As [`check_file`] for a file of this kind, whose name must not end as those of the `other` kind do.
pub(crate) fn check_kind(path: &Path, other: &str, expected: &str) -> Result<()> {
    let is_other = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(other));
    ensure!(!is_other, "{}: expected {expected}", path.display());
    check_file(path)
}

/// Makes a folder, and sees whether files can be written there.
pub(crate) fn make_folder(folder: &Path) -> Result<()> {
    fs::create_dir_all(folder).with_context(|| format!("{}: cannot be made", folder.display()))?;
    remove_stale_scratch(folder).with_context(|| format!("{}: cannot be written to", folder.display()))?;
    check_writable(&folder.join("results")).with_context(|| format!("{}: cannot be written to", folder.display()))
}

/// Result files have a folder of their own: `inputs` do not come from it, and what is there under the names of the
/// files to write are result files.
pub(crate) fn check_results<'a>(
    folder: &Path,
    names: impl IntoIterator<Item = &'a String>,
    inputs: &[PathBuf],
) -> Result<()> {
    check_no_input(folder, inputs)?;
    for name in names {
        let path = folder.join(format!("{name}.txt"));
        let start = start_of(&path).with_context(|| format!("{}: cannot be read", path.display()))?;
        ensure!(
            are_results(&String::from_utf8_lossy(&start)),
            "{}: there already and no result file; expected another folder for results",
            path.display()
        );
    }
    Ok(())
}

/// Nothing is written into a folder that `inputs` come from.
pub(crate) fn check_no_input(folder: &Path, inputs: &[PathBuf]) -> Result<()> {
    let there = identity(folder);
    let is_input = inputs.iter().any(|input| identity(input) == there);
    ensure!(!is_input, "{}: inputs come from this folder; expected another one for results", folder.display());
    Ok(())
}

/// The folders of a data set in KITTI's layout, of which `folder` is one.
pub(crate) fn layout_folders(folder: &Path) -> [PathBuf; 3] {
    ["image_2", "calib", "label_2"].map(|name| folder.with_file_name(name))
}

/// Whether text begins with a row of a result file, or has none.
fn are_results(text: &str) -> bool {
    let first = text.lines().map(|line| line.split_ascii_whitespace().collect::<Vec<_>>()).find(|row| !row.is_empty());
    // More than the 16 columns is our error bar.
    first.is_none_or(|row| {
        row.get(..RowKind::Result.columns()).is_some_and(|fields| row_from_fields(fields, RowKind::Result).is_ok())
    })
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use super::{are_results, check_file, check_json, check_kind, check_results};

    const LABEL: &str = "Car 0.00 0 1.50 600.00 170.00 700.00 230.00 1.50 1.60 4.00 1.00 1.70 20.00 1.60";

    #[test]
    fn results_are_told_from_labels_and_calibrations() {
        let result = format!("{} 0.9", LABEL.replace("0.00 0", "-1 -1"));
        for text in ["", "\n\n", &result, &format!("\n{result} 0.5\nwhatever")] {
            assert!(are_results(text), "{text}");
        }
        let calibration = format!("P2: {}", "1.0 ".repeat(12));
        for text in [LABEL, &calibration, "notes", &format!("0 1 {LABEL}"), &format!("{LABEL}\n{result}")] {
            assert!(!are_results(text), "{text}");
        }
    }

    #[test]
    fn what_must_not_be_replaced_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for (name, text) in [("label.txt", LABEL), ("photo.png", "\u{89}PNG"), ("a.json", " \n[1]"), ("empty", "")] {
            fs::write(at(name), text).unwrap();
        }
        let none: [&Path; 0] = [];
        for name in ["a.json", "empty", "new.json"] {
            check_json(&at(name), none).unwrap();
        }
        let told = |result: anyhow::Result<()>| result.unwrap_err().to_string();
        for name in ["label.txt", "photo.png"] {
            assert!(told(check_json(&at(name), none)).ends_with("there already and no JSON; expected another file"));
        }
        let input = at("./a.json");
        assert!(told(check_json(&at("a.json"), [input.as_path()])).contains("a.json: an input; expected another file"));
        assert_eq!(told(check_json(Path::new("-"), none)), "-: no name of a file; expected one, or /dev/stdout");
        assert!(told(check_file(&at("nowhere/new.json"))).contains("nowhere; expected one that is there"));
        assert!(told(check_file(folder.path())).ends_with("a folder; expected the name of a file to write"));
        assert!(
            told(check_kind(&at("m.ONNX"), "onnx", "a name in .safetensors"))
                .ends_with("m.ONNX: expected a name in .safetensors")
        );

        let names = ["label".to_owned(), "new".to_owned()];
        assert!(
            told(check_results(folder.path(), &names, &[])).contains("label.txt: there already and no result file")
        );
        check_results(folder.path(), &names[1..], &[]).unwrap();
        let inputs = [at(".")];
        assert!(told(check_results(folder.path(), &names[1..], &inputs)).contains("inputs come from this folder"));
    }
}

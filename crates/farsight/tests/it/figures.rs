//! Figures stand in one place: documents quote the files that `farsight measure` writes.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use crate::program::{farsight, root};
use farsight_files::MeasuredTable;
use serde_json::Value;

fn json(path: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

fn errors(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Names of the files in a folder of the project that end so.
fn files(folder: &str, extension: &str) -> Vec<String> {
    let files = fs::read_dir(root().join(folder)).unwrap().map(|file| file.unwrap().path());
    let files = files.filter(|path| path.extension().is_some_and(|end| end == extension));
    files.map(|path| Path::new(folder).join(path.file_name().unwrap()).to_str().unwrap().to_owned()).collect()
}

#[test]
fn documents_say_what_was_measured() {
    let copy = tempfile::tempdir().unwrap();
    let documents = ["", "docs", "models"].map(|folder| files(folder, "md")).concat();
    let made_of = [files("docs/results", "json"), files("configs/experiments", "toml")].concat();
    for file in documents.iter().chain(&made_of) {
        let to = copy.path().join(file);
        fs::create_dir_all(to.parent().unwrap()).unwrap();
        fs::copy(root().join(file), to).unwrap();
    }
    let words: Vec<&str> = ["measure", "--docs"].into_iter().chain(documents.iter().map(String::as_str)).collect();
    let output = farsight(copy.path(), &words);
    assert!(output.status.success(), "{}", errors(&output));
    let text = |root: &Path, file: &str| fs::read_to_string(root.join(file)).unwrap();
    for file in &documents {
        let renew = format!("farsight measure --docs {file}");
        assert!(text(&root(), file) == text(copy.path(), file), "{file} is old; `{renew}` renews it");
    }
    let blocks: usize = documents.iter().map(|file| text(&root(), file).matches("<!-- figures: ").count()).sum();
    assert!(blocks >= 6, "{blocks}");

    // The test can fail: another number in the file is another number in the document.
    let results = copy.path().join("docs/results/farsight-w.json");
    let mut figures = json(&results);
    for point in figures["sets"][0]["classes"]["car"]["operating"].as_array_mut().unwrap() {
        point["found"] = 7.into();
    }
    fs::write(&results, figures.to_string()).unwrap();
    assert!(farsight(copy.path(), &["measure", "--docs", "README.md"]).status.success());
    assert!(text(copy.path(), "README.md").contains("| 7 of 123 (6%) |"));
}

#[test]
fn the_picture_of_the_shipped_network_is_what_info_draws() {
    let folder = tempfile::tempdir().unwrap();
    let drawn = folder.path().join("drawn.svg");
    let output = farsight(&root(), &["info", "models/farsight-s.safetensors", "--svg", drawn.to_str().unwrap()]);
    assert!(output.status.success(), "{}", errors(&output));
    let kept = fs::read_to_string(root().join("docs/farsight-s.svg")).unwrap();
    assert!(
        fs::read_to_string(drawn).unwrap() == kept,
        "docs/farsight-s.svg is old; docs/training.md says what draws it"
    );
}

#[test]
fn the_table_of_networks_is_what_info_counts() {
    let folder = tempfile::tempdir().unwrap();
    let (made, kept) = (folder.path().join("networks.json"), json(&root().join("docs/results/networks.json")));
    let rows = kept["rows"].as_array().unwrap();
    for row in rows {
        let words = ["info", row[0].as_str().unwrap(), "--table", made.to_str().unwrap()];
        let output = farsight(&root(), &words);
        assert!(output.status.success(), "{}", errors(&output));
    }
    assert!(rows.len() > 10, "{kept}");
    assert_eq!(
        json(&made)["rows"],
        kept["rows"],
        "docs/results/networks.json is old; docs/training.md says what writes it"
    );

    let others = folder.path().join("others.json");
    fs::copy(root().join("docs/results/bench.json"), &others).unwrap();
    let output = farsight(&root(), &["info", "configs/smoke.toml", "--table", others.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(2));
    assert!(
        errors(&output).contains("others.json: a table of other columns; expected network, "),
        "{}",
        errors(&output)
    );
}

/// A Python script puts the same row into a table as [`MeasuredTable`] would, to the byte of the file.
#[test]
fn scripts_write_tables_as_programs_do() {
    const SCRIPT: &str = "\
import sys
from measured_table import MeasuredTable
for value in (\"1\", \"2 \\u00b1 \\\"3\\\"\"):
    table = MeasuredTable.opened(sys.argv[1], \"a command\", [\"what\", \"figure\"])
    table.put(\"speed\", value)
    table.put(\"size\", \"\")
    table.write(sys.argv[1])
";
    let folder = tempfile::tempdir().unwrap();
    let [ours, theirs] = ["ours.json", "theirs.json"].map(|name| folder.path().join(name));
    let python = std::env::var_os("FARSIGHT_PYTHON").unwrap_or_else(|| "python3".into());
    let ran = Command::new(python).args(["-c", SCRIPT]).arg(&theirs).env("PYTHONPATH", root().join("scripts")).output();
    let Ok(ran) = ran else { return println!("skipped: no python3 (set FARSIGHT_PYTHON)") };
    assert!(ran.status.success(), "{}", errors(&ran));
    let mut table = MeasuredTable::new("a command", ["what", "figure"]);
    table.put(["speed".into(), "2 \u{b1} \"3\"".into()]);
    table.put(["size".into(), String::new()]);
    // Midnight may pass between the two, and Python does not know how much of a machine a container may use.
    let MeasuredTable { date, machine, .. } = MeasuredTable::read(&theirs).unwrap();
    (table.date, table.machine) = (date, machine);
    table.write(&ours).unwrap();
    assert_eq!(fs::read_to_string(theirs).unwrap(), fs::read_to_string(ours).unwrap());
}

/// Two data sets in two folders, of which one is measured anew.
const SETS: &str = "\
[[sets]]
name = \"one\"
title = \"rendered\"
folder = \"here\"
options = [\"--refiner\", \"none\", \"--plates\", \"none\", \"--above-road\", \"none\"]

[[sets]]
name = \"two\"
title = \"elsewhere\"
folder = \"there\"
";

#[test]
#[ignore = "takes long: `cargo xtask test --all`"]
fn figures_are_those_of_eval_and_others_stay() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let synth = farsight(folder, &["synth", "--out", "data", "--frames", "3", "--seed", "6"]);
    assert!(synth.status.success(), "{}", errors(&synth));
    fs::write(folder.join("sets.toml"), SETS).unwrap();
    let measure = |pairs: &[&str], out: &str| {
        let folders = pairs.iter().flat_map(|pair| ["--folder", pair]);
        let words: Vec<&str> = ["measure", "--config", "sets.toml", "--out", out].into_iter().chain(folders).collect();
        farsight(folder, &words)
    };
    let output = measure(&["here=data", "there=data"], "figures.json");
    assert!(output.status.success(), "{}", errors(&output));
    let first = json(&folder.join("figures.json"));

    let same = ["--refiner", "none", "--plates", "none", "--above-road", "none", "--resamples", "0"];
    let eval = [&["eval", "--data", "data", "--json", "eval.json"], &same[..]].concat();
    assert!(farsight(folder, &eval).status.success());
    let eval = json(&folder.join("eval.json"));
    let (kept, told) = (&first["sets"][0]["classes"]["car"], &eval["ranging"]["car"]["moderate"]);
    assert_eq!(first["sets"][0]["frames"], 3);
    assert_eq!(kept["all_scores"]["objects"], told["objects"]);
    assert_eq!(kept["all_scores"]["found"], told["found"]);
    assert!(told["found"].as_u64().unwrap() > 0, "{told}");
    let is_near = |a: &Value, b: &Value| (a.as_f64().unwrap() - b.as_f64().unwrap()).abs() < 1e-4;
    assert!(is_near(&kept["all_scores"]["mae_m"], &told["mae_z"]), "{kept} {told}");
    assert!(is_near(&kept["ap"]["image"][1], &eval["ap"]["car"]["2d"]["r40"][1]), "{kept}");
    let command = first["sets"][0]["source"]["command"].as_str().unwrap();
    assert_eq!(command, "farsight eval --data HERE --refiner none --plates none --above-road none");

    // What is not measured stays as it is, to the byte of its figures.
    let mut marked = first.clone();
    marked["sets"][1]["frames"] = 77.into();
    fs::write(folder.join("figures.json"), marked.to_string()).unwrap();
    assert!(measure(&["here=data"], "figures.json").status.success());
    let second = json(&folder.join("figures.json"));
    assert_eq!(second["sets"][1], marked["sets"][1]);
    assert_eq!(second["sets"][0]["classes"], first["sets"][0]["classes"]);

    let output = measure(&["nowhere=data"], "figures.json");
    assert_eq!(output.status.code(), Some(2));
    assert!(errors(&output).contains("sets.toml: no data set is in a folder \"nowhere\""), "{}", errors(&output));
    let output = measure(&["here=data"], "sets.toml");
    assert!(errors(&output).contains("sets.toml: not what `farsight measure` writes"), "{}", errors(&output));
}

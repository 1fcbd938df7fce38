//! What the README promises a newcomer is there.

use std::fs;
use std::path::PathBuf;

use crate::program::{farsight, root};

fn document(name: &str) -> String {
    fs::read_to_string(root().join(name)).unwrap()
}

/// The arguments, where `line` calls the program.
fn command(line: &str) -> Option<&str> {
    ["farsight ", "cargo xtask run "].iter().find_map(|start| line.strip_prefix(start))
}

#[test]
fn every_command_is_one_that_the_program_understands() {
    // Elsewhere, because some of them do write something.
    let folder = tempfile::tempdir().unwrap();
    let readme = document("README.md");
    let commands = readme.lines().filter_map(command);
    let mut seen = 0;
    for command in commands {
        let words = command.split('#').next().unwrap().split_whitespace();
        // One scene shows as much as two hundred.
        let words: Vec<&str> = words.map(|word| if word == "200" { "1" } else { word }).collect();
        let output = farsight(folder.path(), &words);
        let errors = String::from_utf8(output.stderr).unwrap();
        // The files of the examples are not there; that is an answer. A usage message is not.
        assert!(!errors.contains("Usage:"), "{command}\n{errors}");
        seen += 1;
    }
    assert!(seen >= 10, "{seen}");
}

/// Lines of the first block of Rust in a text.
fn first_code(text: &str) -> Vec<&str> {
    let lines = text.lines().skip_while(|line| !matches!(line.trim_end(), "```rust" | "```")).skip(1);
    lines.take_while(|line| line.trim_end() != "```").collect()
}

#[test]
fn the_first_code_is_what_the_documentation_runs() {
    let library = fs::read_to_string(root().join("crates/farsight/src/lib.rs")).unwrap();
    let docs: Vec<&str> = library.lines().map_while(|line| line.strip_prefix("//!")).collect();
    let docs = docs.iter().map(|line| line.strip_prefix(' ').unwrap_or(line)).collect::<Vec<_>>().join("\n");
    // Hidden lines put a photo.jpg there.
    let run: Vec<&str> = first_code(&docs).into_iter().filter(|line| !line.starts_with("# ")).collect();
    let readme = document("README.md");
    let start = readme.find("```rust").unwrap();
    assert_eq!(first_code(&readme[start..]), run);
    assert_eq!(run.len(), 6);
}

#[test]
fn every_config_is_there_and_has_the_parameters_that_are_claimed() {
    let page = document("docs/training.md");
    let rows: Vec<&str> = page.lines().filter(|line| line.starts_with("| `configs/")).collect();
    assert!(!rows.is_empty());
    for row in rows {
        let config = row.split('`').nth(1).unwrap();
        let output = farsight(&root(), &["info", config]);
        assert!(output.status.success(), "{config}: {}", String::from_utf8_lossy(&output.stderr));
        let answer = String::from_utf8(output.stdout).unwrap();
        let is_count = |word: &&str| word.contains(',') && word.chars().all(|c| c == ',' || c.is_ascii_digit());
        if let Some(parameters) = row.split_whitespace().find(is_count) {
            assert!(answer.contains(parameters), "{config} has not {parameters} parameters:\n{answer}");
        }
    }
}

#[test]
fn every_config_is_named_in_a_document() {
    let texts: Vec<String> = documents().iter().map(|path| fs::read_to_string(path).unwrap()).collect();
    let configs = fs::read_dir(root().join("configs")).unwrap().map(|entry| entry.unwrap().file_name());
    let names = configs.filter_map(|name| Some(name.to_str()?.strip_suffix(".toml")?.to_owned()));
    let unnamed: Vec<String> = names.filter(|name| !texts.iter().any(|text| text.contains(name))).collect();
    assert!(unnamed.is_empty(), "{unnamed:?}");
}

/// A stranger reads these to the end.
#[test]
fn the_first_pages_are_short() {
    let pages = [
        ("README.md", 100),
        ("models/farsight-s.md", 150),
        ("models/farsight-n.md", 150),
        ("models/farsight-w.md", 150),
        ("crates/farsight/examples/quickstart.rs", 24),
    ];
    for (name, most) in pages {
        let lines = document(name).lines().count();
        assert!(lines <= most, "{name} has {lines} lines; expected at most {most}");
    }
}

/// The documents: Markdown at the top, in `docs` and in `models`.
fn documents() -> Vec<PathBuf> {
    let folders = ["", "docs", "models"].map(|folder| root().join(folder));
    let files = folders.into_iter().flat_map(|folder| fs::read_dir(folder).unwrap());
    files.map(|file| file.unwrap().path()).filter(|path| path.extension().is_some_and(|end| end == "md")).collect()
}

#[test]
fn every_file_that_the_documents_point_to_is_there() {
    let documents = documents();
    assert!(documents.len() > 10, "{documents:?}");
    for path in documents {
        let text = fs::read_to_string(&path).unwrap();
        for link in text.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
            let target = path.parent().unwrap().join(link);
            assert!(link.starts_with("https://") || target.exists(), "{} points to {link}", path.display());
        }
    }
}

/// What one touches for an addition, as CONTRIBUTING says: every file that it names is there.
#[test]
fn every_file_that_contributors_are_sent_to_is_there() {
    let text = document("CONTRIBUTING.md");
    let quoted = text.split('`').skip(1).step_by(2);
    let starts = ["crates/", "fuzz/", "configs/", "docs/"];
    let named: Vec<&str> = quoted.filter(|name| starts.iter().any(|start| name.starts_with(start))).collect();
    assert!(named.len() > 15, "{named:?}");
    for name in named {
        // What is to be added is not there.
        let path = name.split("NAME").next().unwrap();
        assert!(root().join(path).exists(), "CONTRIBUTING.md names {name}");
    }
}

/// The whole way in small: train on real frames, range one, and look at what came out.
#[cfg(feature = "train")]
#[test]
fn from_real_frames_to_metres() {
    let kitti = std::env::var_os("FARSIGHT_KITTI").map_or_else(|| root().join("../shared/kitti"), PathBuf::from);
    let frames = kitti.join("frames");
    if !frames.is_dir() {
        println!("skipped: no {} (set FARSIGHT_KITTI)", frames.display());
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let text = |path: &std::path::Path| path.to_str().unwrap().to_owned();
    let [config, run, pictures, rows] =
        ["config.toml", "run", "pictures", "rows"].map(|name| text(&folder.path().join(name)));
    let json = text(&folder.path().join("answer.json"));
    let small = "method = \"smoke\"\n[model]\ninput = [320, 96]\nwidth = 0.25\nnorm = \"batch\"\nneck = \"plain\"\n\
                 [data]\nlimit = 2\n[train]\nepochs = 2\nbatch_size = 2\n";
    fs::write(&config, small).unwrap();
    let train = farsight(&root(), &["train", "--config", &config, "--data", &text(&frames), "--out", &run]);
    assert!(train.status.success(), "{}", String::from_utf8_lossy(&train.stderr));

    let image = text(&frames.join("training/image_2/000003.png"));
    let model = format!("{run}/model.safetensors");
    let outputs = ["--out", &pictures, "--json", &json, "--kitti", &rows, "--min-score", "0.01"];
    let range = farsight(&root(), &[&["range", &image, "--model", &model], &outputs[..]].concat());
    assert!(range.status.success(), "{}", String::from_utf8_lossy(&range.stderr));
    let answer: serde_json::Value = serde_json::from_str(&fs::read_to_string(&json).unwrap()).unwrap();
    assert_eq!((answer[0]["width"].as_u64(), answer[0]["height"].as_u64()), (Some(1242), Some(375)));
    assert!(fs::metadata(format!("{pictures}/000003.png")).unwrap().len() > 100_000);
    let lines = fs::read_to_string(format!("{rows}/000003.txt")).unwrap().lines().count();
    assert_eq!(lines, answer[0]["detections"].as_array().unwrap().len());
}

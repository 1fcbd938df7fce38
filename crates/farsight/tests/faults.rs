//! Faults: every command that writes is killed at random moments and has its disk full at many a byte. Nothing that it
//! leaves is half written, what could not be written is told by the exit status, and the next run ends as if nothing
//! had happened.
//!
//! `FARSIGHT_FAULTS=100` tries each so often; docs/reliability.md says what was found.

#![cfg(unix)]
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "the helpers of a test may panic and print")]

mod program;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use farsight_graph::init::initial_weights;
use farsight_graph::layers::{NeckKind, NormKind};
use farsight_graph::model::NetworkConfig;
use farsight_methods::smoke::{SmokeConfig, SmokeModel};
use program::{done, root};

/// How often each command is killed, where nothing else is said.
const KILLS: usize = 3;

/// Sizes in blocks of 512 bytes beyond which no file grows: what a full disk is to a program.
const FULL_AT: [usize; 8] = [0, 1, 2, 8, 40, 200, 700, 2000];

fn tries() -> usize {
    std::env::var("FARSIGHT_FAULTS").ok().and_then(|count| count.parse().ok()).unwrap_or(KILLS)
}

/// A command that writes, and the files and folders that it writes.
struct Case {
    arguments: Vec<&'static str>,
    outputs: &'static [&'static str],
    /// What lets a run go on with what the killed one left.
    resume: Option<&'static str>,
}

const RANGE: &str = "range in --hfov 81 --model in/m.safetensors --out out --json all.json --kitti kitti";
const EVAL: &str =
    "eval --data in/k --model in/m.safetensors --resamples 0 --results kept --json eval.json --report page";

const TRACK: &str = "track in --fps 10 --hfov 81 --model in/m.safetensors --json tracks.jsonl --events events.jsonl \
                     --tracks tracks.csv --kitti-tracking tracks.txt --out film";

fn cases() -> Vec<Case> {
    let case = |line: &'static str, outputs, resume| Case { arguments: line.split(' ').collect(), outputs, resume };
    vec![
        case(RANGE, &["out", "all.json", "kitti"], Some("--resume")),
        case(
            "range in --hfov 81 --model in/m.safetensors --json all.jsonl --format jsonl",
            &["all.jsonl"],
            Some("--resume"),
        ),
        case(EVAL, &["kept", "eval.json", "page"], None),
        case("synth --out set --frames 6 --seed 5 --jpeg 90", &["set"], Some("--resume")),
        case("export --model in/m.safetensors --out m.onnx", &["m.onnx"], None),
        case("prune --model in/m.safetensors --keep 0.5 --out p.safetensors", &["p.safetensors"], None),
        case("import in/c.pth --out c.safetensors", &["c.safetensors"], None),
        case("info in/m.safetensors --svg m.svg", &["m.svg"], None),
        case("demo --out demo", &["demo"], None),
        case(TRACK, &["film", "tracks.jsonl", "events.jsonl", "tracks.csv", "tracks.txt"], None),
    ]
}

/// Images, a small model, a checkpoint and a small data set in the folder `in`.
fn inputs(folder: &Path) {
    fs::create_dir(folder.join("in")).unwrap();
    for id in ["000000", "000001", "000002"] {
        fs::copy(root().join(format!("assets/scenes/image_2/{id}.jpg")), folder.join(format!("in/{id}.jpg"))).unwrap();
    }
    let (norm, neck) = (NormKind::Batch, NeckKind::Plain);
    let config = SmokeConfig { input: [96, 64], width: 0.25, norm, neck, ..SmokeConfig::default() };
    let weights = initial_weights(&config.graph(), 1);
    SmokeModel::new(config, weights).unwrap().write(&folder.join("in/m.safetensors")).unwrap();
    let fixture = root().join("crates/farsight-methods/tests/fixtures/official_zip.pth");
    fs::copy(fixture, folder.join("in/c.pth")).unwrap();
    done(folder, &["synth", "--out", "in/k", "--frames", "2", "--seed", "3"]);
}

/// The files of `outputs` by their paths; those that grow or are scratch files are apart.
fn tree(folder: &Path, outputs: &[&str]) -> (BTreeMap<PathBuf, Vec<u8>>, Vec<PathBuf>) {
    let (mut files, mut unfinished) = (BTreeMap::new(), Vec::new());
    let mut todo: Vec<PathBuf> = outputs.iter().map(|name| folder.join(name)).collect();
    // Scratch files of single files lie beside them.
    todo.extend(fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).filter(|path| is_partial(path)));
    while let Some(path) = todo.pop() {
        if path.is_dir() {
            todo.extend(fs::read_dir(path).unwrap().map(|entry| entry.unwrap().path()));
        } else if is_partial(&path) {
            unfinished.push(path);
        } else if path.is_file() {
            files.insert(path.strip_prefix(folder).unwrap().to_owned(), fs::read(&path).unwrap());
        }
    }
    (files, unfinished)
}

fn is_partial(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "partial")
}

fn remove(folder: &Path, outputs: &[&str]) {
    for path in outputs.iter().map(|name| folder.join(name)) {
        if path.is_dir() { fs::remove_dir_all(path).unwrap() } else { drop(fs::remove_file(path)) }
    }
    for entry in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).filter(|path| is_partial(path)) {
        fs::remove_file(entry).unwrap();
    }
}

/// The files of a run that nobody disturbs, and how long it takes.
fn undisturbed(folder: &Path, case: &Case) -> (BTreeMap<PathBuf, Vec<u8>>, Duration) {
    let start = Instant::now();
    done(folder, &case.arguments);
    let (files, unfinished) = tree(folder, case.outputs);
    assert!(!files.is_empty() && unfinished.is_empty(), "{:?}: {unfinished:?}", case.arguments);
    (files, start.elapsed())
}

/// Whether a file of a JSON Lines output is whole lines of `whole`, or its last one cut off.
fn grows_to(path: &Path, found: &[u8], whole: &[u8]) -> bool {
    path.extension().is_some_and(|extension| extension == "jsonl") && whole.starts_with(found)
}

/// Answers that stay when a run goes on keep every digit, but not the lines of an array that is made at the end.
fn says_the_same(path: &Path, found: &[u8], whole: &[u8]) -> bool {
    let is_json = path.extension().is_some_and(|extension| extension == "json");
    let value = |bytes| serde_json::from_slice::<serde_json::Value>(bytes).unwrap();
    found == whole || (is_json && value(found) == value(whole))
}

#[test]
fn killed_commands_leave_nothing_half_written_and_can_be_run_again() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    inputs(folder);
    let mut random = 0x9e37_79b9_7f4a_7c15_u64;
    for case in cases() {
        let (expected, duration) = undisturbed(folder, &case);
        let mut killed = 0;
        for attempt in 0..tries() {
            remove(folder, case.outputs);
            // Half of them over the outputs of an earlier run.
            if attempt % 2 == 1 && case.resume.is_none() {
                done(folder, &case.arguments);
            }
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let share = (random >> 40) as f64 / (1_u64 << 24) as f64;
            let mut command = Command::new(env!("CARGO_BIN_EXE_farsight"));
            command.args(&case.arguments).current_dir(folder).stdout(Stdio::null()).stderr(Stdio::null());
            let mut child = command.spawn().unwrap();
            sleep(duration.mul_f64(share));
            child.kill().unwrap();
            killed += usize::from(!child.wait().unwrap().success());
            let (files, _) = tree(folder, case.outputs);
            for (path, bytes) in files {
                // A plan of what is to come is there before anything else.
                let whole = expected.get(&path).is_some_and(|whole| *whole == bytes || grows_to(&path, &bytes, whole));
                assert!(whole, "{:?}: {} is half written", case.arguments, path.display());
            }
            let arguments: Vec<&str> = case.arguments.iter().copied().chain(case.resume).collect();
            done(folder, &arguments);
            let (files, unfinished) = tree(folder, case.outputs);
            for (path, bytes) in &files {
                let same = expected.get(path).is_some_and(|whole| says_the_same(path, bytes, whole));
                assert!(same, "{arguments:?}: {}: not as undisturbed", path.display());
            }
            assert_eq!(files.len(), expected.len(), "{arguments:?}");
            assert!(unfinished.is_empty(), "{arguments:?}: left behind: {unfinished:?}");
        }
        println!("{}: killed {killed} times of {}", case.arguments.join(" "), tries());
        remove(folder, case.outputs);
    }
}

/// Runs the program where no file grows beyond so many blocks: writing more fails, as on a full disk.
fn on_small_disk(folder: &Path, arguments: &[&str], blocks: usize) -> Output {
    let script = format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$0\" \"$@\"");
    let mut command = Command::new("sh");
    command.args(["-c", &script, env!("CARGO_BIN_EXE_farsight")]).args(arguments).current_dir(folder);
    command.output().unwrap()
}

#[test]
fn a_full_disk_is_told_by_the_exit_status_after_all_else_was_tried() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    inputs(folder);
    for case in cases() {
        let (expected, _) = undisturbed(folder, &case);
        let mut full = 0;
        for blocks in FULL_AT {
            remove(folder, case.outputs);
            let output = on_small_disk(folder, &case.arguments, blocks);
            let told = String::from_utf8_lossy(&output.stderr).into_owned();
            let (files, unfinished) = tree(folder, case.outputs);
            for (path, bytes) in &files {
                let whole = expected.get(path).is_some_and(|whole| whole == bytes || grows_to(path, bytes, whole));
                assert!(whole, "{:?} at {blocks} blocks: {} is half written", case.arguments, path.display());
            }
            let scratch = |path: &PathBuf| path.file_name().unwrap().to_string_lossy().starts_with('.');
            assert!(!unfinished.iter().any(scratch), "{:?} at {blocks} blocks: {unfinished:?}", case.arguments);
            let status = output.status.code();
            let expected_status = if files == expected { Some(0) } else { Some(2) };
            assert_eq!(status, expected_status, "{:?} at {blocks} blocks: {told}", case.arguments);
            assert!(!told.contains("panicked"), "{told}");
            full += usize::from(status == Some(2));
        }
        println!("{}: the disk was full {full} times of {}", case.arguments.join(" "), FULL_AT.len());
        remove(folder, case.outputs);
    }
}

#[test]
fn of_several_pictures_those_that_fit_are_written() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    inputs(folder);
    done(folder, &["range", "in", "--hfov", "81", "--model", "in/m.safetensors", "--out", "whole"]);
    let sizes: BTreeMap<_, _> =
        tree(folder, &["whole"]).0.into_iter().map(|(path, bytes)| (path, bytes.len())).collect();
    let between = (sizes.values().min().unwrap() + sizes.values().max().unwrap()) / 2;
    let fits = sizes.values().filter(|size| **size <= between / 512 * 512).count();
    assert!(fits > 0 && fits < sizes.len(), "{sizes:?}");
    let range = ["range", "in", "--hfov", "81", "--model", "in/m.safetensors", "--out", "out"];
    let output = on_small_disk(folder, &range, between / 512);
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!((output.status.code(), tree(folder, &["out"]).0.len()), (Some(2), fits), "{told}");
    assert!(
        told.ends_with(&format!(
            "{} could not be written\n",
            if sizes.len() - fits == 1 { "1 output" } else { "2 outputs" }
        )),
        "{told}"
    );
}

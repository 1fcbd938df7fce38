//! Faults: every command that writes is killed at random moments and has its disk full at many a byte. Nothing that it
//! leaves is half written, what could not be written is told by the exit status, and the next run ends as if nothing
//! had happened.
//!
//! `FARSIGHT_FAULTS=100` tries each so often; docs/reliability.md says what was found.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::program::{self, done, root};
use farsight_graph::init::initial_weights;
use farsight_graph::layers::{NeckKind, NormKind};
use farsight_graph::model::NetworkConfig;
use farsight_graph::weights::{WeightTensor, Weights};
use farsight_methods::smoke::{SmokeConfig, SmokeModel};

/// How often each command is killed, where nothing else is said: those that are quick, and the others.
const KILLS: usize = 2;
const KILLS_OF_OTHERS: usize = 1;

/// Sizes in blocks of 512 bytes beyond which no file grows: what a full disk is to a program.
const FULL_AT: [usize; 8] = [0, 1, 2, 8, 40, 200, 700, 2000];
const FULL_AT_UNASKED: [usize; 5] = [0, 1, 8, 200, 2000];
const FULL_AT_OF_OTHERS: [usize; 3] = [0, 2, 40];

/// How often each is tried, where it is said.
fn asked_tries() -> Option<usize> {
    std::env::var("FARSIGHT_FAULTS").ok().and_then(|count| count.parse().ok())
}

/// A command that writes: what it writes is all that is in its folder but the inputs.
#[derive(Default)]
struct Case {
    arguments: Vec<&'static str>,
    /// What lets a run go on with what the killed one left.
    resume: Option<&'static str>,
    /// Its exit status: 1 where it tells of differences.
    status: i32,
    /// A file of times, which are others each time: it is only to be whole.
    varies: Option<&'static str>,
    is_quick: bool,
}

impl Case {
    fn new(line: &'static str) -> Self {
        Self { arguments: line.split(' ').collect(), ..Self::default() }
    }

    fn quick(line: &'static str) -> Self {
        Self { is_quick: true, ..Self::new(line) }
    }

    fn resumed(self, option: &'static str) -> Self {
        Self { resume: Some(option), ..self }
    }

    fn tries(&self) -> usize {
        asked_tries().unwrap_or(if self.is_quick { KILLS } else { KILLS_OF_OTHERS })
    }

    fn full_at(&self) -> &'static [usize] {
        match (asked_tries(), self.is_quick) {
            (Some(_), _) => &FULL_AT,
            (None, true) => &FULL_AT_UNASKED,
            (None, false) => &FULL_AT_OF_OTHERS,
        }
    }

    /// Runs the command, which must come to its end.
    fn run(&self, folder: &Path, more: Option<&str>) {
        let arguments: Vec<&str> = self.arguments.iter().copied().chain(more).collect();
        let output = program::farsight(folder, &arguments);
        let told = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(self.status), "{arguments:?}: {told}");
    }
}

const RANGE: &str = "range in --hfov 81 --model in/m.safetensors --out out --json all.json --kitti kitti";
const EVAL: &str =
    "eval --data in/k --model in/m.safetensors --resamples 0 --results kept --json eval.json --report page";

const TRACK: &str = "track in --fps 10 --hfov 81 --model in/m.safetensors --json tracks.jsonl --events events.jsonl \
                     --tracks tracks.csv --kitti-tracking tracks.txt --mcap tracks.mcap --out film";

fn cases() -> Vec<Case> {
    let mut cases = vec![
        Case::quick(RANGE).resumed("--resume"),
        Case::quick("range in --hfov 81 --model in/m.safetensors --json all.jsonl --format jsonl").resumed("--resume"),
        Case::quick(EVAL),
        Case::quick("synth --out set --frames 6 --seed 5 --jpeg 90").resumed("--resume"),
        Case::quick("export --model in/m.safetensors --out m.onnx"),
        Case::quick("prune --model in/m.safetensors --keep 0.5 --out p.safetensors"),
        Case::quick("import in/c.pth --out c.safetensors"),
        Case::quick("info in/m.safetensors --svg m.svg"),
        Case::quick(TRACK),
        Case::new(
            "range in --hfov 81 --model in/m.safetensors --json all.json --kitti kitti --shard 1/2 --parts parts",
        ),
        Case::new("merge in/parts --out merged"),
        Case::new("eval-tracks --labels in/tracks.txt --tracks in/tracks.jsonl --json judged.json --report page.html"),
        Case {
            status: 1,
            ..Case::new("parity --model in/m.safetensors --golden in/golden.safetensors --json parity.json")
        },
    ];
    // Ten seconds and more each, and minutes.
    if asked_tries().is_none() {
        return cases;
    }
    cases.extend([
        Case::quick("demo --out demo"),
        Case::new("synth --sequence 1 --frames 3 --fps 20 --world in/world.toml --out set --seed 5")
            .resumed("--resume"),
        Case::new("range in --hfov 81 --model in/m.safetensors --mcap all.mcap"),
        Case::new("calibrate in/000000.jpg --hfov 81 --model farsight-s --refiner none --plates none --out pole.txt"),
        Case { varies: Some("bench.json"), ..Case::new(BENCH) },
        Case { varies: Some("figures.json"), ..Case::new(MEASURE) },
        Case::new(ROBUSTNESS),
    ]);
    if has_ffmpeg() {
        cases.push(Case::new("track in --fps 10 --hfov 81 --model in/m.safetensors --out film.mp4"));
    } else {
        println!("skipped: there is no ffmpeg, so no film was broken off");
    }
    if cfg!(feature = "train") {
        cases.push(Case::new(FINE_TUNE).resumed("--resume"));
    }
    cases
}

const MEASURE: &str = "measure --config in/measure.toml --folder kitti=in/k --model farsight-s --out figures.json";
const ROBUSTNESS: &str = "robustness --data in/k --model farsight-s --refiner none --plates none --corruptions contrast --severities 1 \
                          --json worse.json --plot worse.png";
const BENCH: &str = "bench --model in/m.safetensors --image in/000000.jpg --runs 1 --images 0 --json bench.json";
const FINE_TUNE: &str = "fine-tune --data in/scenes --model in/half.safetensors --epochs 1 --fit-on in/held-out --out \
                         mine.safetensors";

fn has_ffmpeg() -> bool {
    Command::new("ffmpeg").arg("-version").output().is_ok_and(|output| output.status.success())
}

const WORLD: &str = "
[[cameras]]
image_sizes = [[416, 128]]
focal_widths = [0.58, 0.58]
[weather]
clear = 1
cloudy = 0
overcast = 0
dusk = 0
night = 0
rain = 0
fog = 0
";

const SETS: &str = "[[sets]]\nname = \"a\"\ntitle = \"A\"\nfolder = \"kitti\"\n";

/// A frame of tracks, and a row of labels of it.
const FRAME: &str = r#"{"frame":0,"time_s":0.0,"tracks":[{"id":1,"class":"Car","score":0.9,"age":3,"box2d":[600.0,170.0,700.0,230.0],"dimensions_hwl":[1.5,1.6,4.0],"location":[1.0,1.7,20.0],"rotation_y":-1.57,"range_m":20.0,"range_sigma_m":1.0,"range_interval_m":[18.4,21.6],"velocity_mps":[0.0,0.0,-3.0],"velocity_sigma_mps":[0.1,0.1,0.5],"closing_mps":3.0,"closing_sigma_mps":0.5,"ttc_s":6.0,"ttc_interval_s":[5.0,8.0],"coasting":false}]}"#;
const TRACK_LABEL: &str = "0 7 Car 0 0 -1.5 600 170 700 230 1.5 1.6 4.0 1.0 1.7 20.0 -1.57";

/// Images, a small model, a checkpoint, small data sets and what else is read, in the folder `in`.
fn inputs(folder: &Path) {
    fs::create_dir(folder.join("in")).unwrap();
    for id in ["000000", "000001", "000002"] {
        fs::copy(root().join(format!("assets/scenes/image_2/{id}.jpg")), folder.join(format!("in/{id}.jpg"))).unwrap();
    }
    let (norm, neck) = (NormKind::Batch, NeckKind::Plain);
    let config = SmokeConfig { input: [96, 64], width: 0.25, norm, neck, ..SmokeConfig::default() };
    let weights = initial_weights(&config.graph(), 1);
    SmokeModel::new(config, weights).unwrap().write(&folder.join("in/m.safetensors")).unwrap();
    let mut golden = Weights::default();
    for (name, shape) in [("input", [1, 3, 64, 96]), ("cls_logits", [1, 3, 16, 24]), ("reg_raw", [1, 8, 16, 24])] {
        let values = vec![0.5; shape.iter().product()];
        golden.tensors.insert(name.to_owned(), WeightTensor { shape: shape.to_vec(), values });
    }
    golden.write(&folder.join("in/golden.safetensors")).unwrap();
    let fixture = root().join("crates/farsight-methods/tests/fixtures/official_zip.pth");
    fs::copy(fixture, folder.join("in/c.pth")).unwrap();
    for (name, text) in
        [("world.toml", WORLD), ("measure.toml", SETS), ("tracks.jsonl", FRAME), ("tracks.txt", TRACK_LABEL)]
    {
        fs::write(folder.join("in").join(name), text.to_owned() + "\n").unwrap();
    }
    done(folder, &["synth", "--out", "in/k", "--frames", "2", "--seed", "4"]);
    for shard in ["1/2", "2/2"] {
        let part = "range in --hfov 81 --model in/m.safetensors --json all.json --kitti kitti --parts in/parts --shard";
        done(folder, &part.split(' ').chain([shard]).collect::<Vec<_>>());
    }
    if cfg!(feature = "train") && asked_tries().is_some() {
        done(folder, &["synth", "--out", "in/scenes", "--frames", "10", "--seed", "5"]);
        done(folder, &["synth", "--out", "in/held-out", "--frames", "48", "--seed", "6"]);
        let half = "export --half --model farsight-s --input 480x160 --out in/half.safetensors";
        done(folder, &half.split(' ').collect::<Vec<_>>());
    }
}

/// All files of the folder that are no inputs by their paths; those that grow, and scratch files and folders, are
/// apart.
fn tree(folder: &Path) -> (BTreeMap<PathBuf, Vec<u8>>, Vec<PathBuf>) {
    let (mut files, mut unfinished) = (BTreeMap::new(), Vec::new());
    let mut todo = outputs(folder);
    while let Some(path) = todo.pop() {
        if is_partial(&path) {
            unfinished.push(path);
        } else if path.is_dir() {
            todo.extend(fs::read_dir(path).unwrap().map(|entry| entry.unwrap().path()));
        } else {
            files.insert(path.strip_prefix(folder).unwrap().to_owned(), fs::read(&path).unwrap());
        }
    }
    (files, unfinished)
}

/// All that is in the folder but the inputs.
fn outputs(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries.filter(|path| !path.ends_with("in")).collect()
}

fn is_partial(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "partial")
}

/// Whether it is the scratch of a part, which the next run of the same part goes on with.
fn is_of_part(path: &Path) -> bool {
    path.parent().is_some_and(|folder| folder.ends_with("parts"))
}

fn remove(folder: &Path) {
    for path in outputs(folder) {
        if path.is_dir() { fs::remove_dir_all(path).unwrap() } else { fs::remove_file(path).unwrap() }
    }
}

/// The files of a run that nobody disturbs, and how long it takes.
fn undisturbed(folder: &Path, case: &Case) -> (BTreeMap<PathBuf, Vec<u8>>, Duration) {
    let start = Instant::now();
    case.run(folder, None);
    let taken = start.elapsed();
    let (files, unfinished) = tree(folder);
    assert!(!files.is_empty() && unfinished.is_empty(), "{:?}: {unfinished:?}", case.arguments);
    (files, taken)
}

/// Waits until what a killed program started has ended: ffmpeg does when nobody sends it pictures any more.
fn wait_for_ffmpeg(folder: &Path) {
    let name = folder.as_os_str().as_encoded_bytes();
    let is_here = |process: &Path| {
        let is_ffmpeg = fs::read(process.join("cmdline")).is_ok_and(|words| words.starts_with(b"ffmpeg\0"));
        is_ffmpeg && fs::read_link(process.join("cwd")).is_ok_and(|cwd| cwd.as_os_str().as_encoded_bytes() == name)
    };
    let runs = || {
        let processes = fs::read_dir("/proc").into_iter().flatten().flatten();
        processes.map(|process| process.path()).any(|process| is_here(&process))
    };
    while runs() {
        sleep(Duration::from_millis(10));
    }
}

/// Whether a file of a JSON Lines output is whole lines of `whole`, or its last one cut off.
fn grows_to(path: &Path, found: &[u8], whole: &[u8]) -> bool {
    path.extension().is_some_and(|extension| extension == "jsonl") && whole.starts_with(found)
}

/// Whether a file is as in a run that nobody disturbed, or one of times that is whole.
fn is_whole(case: &Case, path: &Path, found: &[u8], whole: Option<&Vec<u8>>) -> bool {
    if case.varies.is_some_and(|name| path == Path::new(name)) {
        return serde_json::from_slice::<serde_json::Value>(found).is_ok();
    }
    whole.is_some_and(|whole| says_the_same(path, found, whole))
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
    let folder = &folder.path().canonicalize().unwrap();
    inputs(folder);
    let mut random = 0x9e37_79b9_7f4a_7c15_u64;
    for case in cases() {
        let (expected, duration) = undisturbed(folder, &case);
        let mut killed = 0;
        for attempt in 0..case.tries() {
            remove(folder);
            // Half of them over the outputs of an earlier run, which some commands refuse.
            if attempt % 2 == 1 && case.resume.is_none() && case.arguments[0] != "merge" {
                case.run(folder, None);
            }
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let share = (random >> 40) as f64 / (1_u64 << 24) as f64;
            let mut command = Command::new(env!("CARGO_BIN_EXE_farsight"));
            command.args(&case.arguments).current_dir(folder).stdout(Stdio::null()).stderr(Stdio::null());
            let mut child = command.spawn().unwrap();
            sleep(duration.mul_f64(share));
            child.kill().unwrap();
            let status = child.wait().unwrap();
            killed += usize::from(status.code().is_none());
            wait_for_ffmpeg(folder);
            let (files, _) = tree(folder);
            for (path, bytes) in &files {
                // A plan of what is to come is there before anything else.
                let whole = expected.get(path);
                let grows = whole.is_some_and(|whole| grows_to(path, bytes, whole));
                let is_whole = grows || is_whole(&case, path, bytes, whole) || is_of_run(&case, path);
                assert!(is_whole, "{:?}: {} is half written", case.arguments, path.display());
            }
            // What came to its end is there.
            let is_there = case.arguments[0] == "merge" && !files.is_empty();
            if !is_there {
                case.run(folder, case.resume);
            }
            let (files, unfinished) = tree(folder);
            for (path, bytes) in &files {
                let same = is_whole(&case, path, bytes, expected.get(path)) || is_of_run(&case, path);
                assert!(same, "{:?}: {}: not as undisturbed", case.arguments, path.display());
            }
            // Event files of TensorBoard have the time in their names, and one more after each start.
            let named = |path: &&PathBuf| !path.to_string_lossy().contains(".tfevents.");
            let is_all = files.keys().filter(named).eq(expected.keys().filter(named));
            assert!(is_all, "{:?}: {:?}", case.arguments, files.keys());
            assert!(unfinished.is_empty(), "{:?}: left behind: {unfinished:?}", case.arguments);
        }
        println!("{}: killed {killed} times of {}", case.arguments.join(" "), case.tries());
        remove(folder);
    }
}

/// Whether it is the record of a training: it has times in it, and its own tests.
fn is_of_run(case: &Case, path: &Path) -> bool {
    case.arguments[0] == "fine-tune" && path.starts_with("mine-run")
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
    let folder = &folder.path().canonicalize().unwrap();
    inputs(folder);
    // What a training leaves when its disk is full is the checkpoint before.
    for case in cases().iter().filter(|case| case.arguments[0] != "fine-tune") {
        let (expected, _) = undisturbed(folder, case);
        let mut full = 0;
        for &blocks in case.full_at() {
            remove(folder);
            let output = on_small_disk(folder, &case.arguments, blocks);
            let told = String::from_utf8_lossy(&output.stderr).into_owned();
            let (files, unfinished) = tree(folder);
            for (path, bytes) in &files {
                let whole = expected.get(path);
                let grows = whole.is_some_and(|whole| grows_to(path, bytes, whole));
                let whole = grows || is_whole(case, path, bytes, whole);
                assert!(whole, "{:?} at {blocks} blocks: {} is half written", case.arguments, path.display());
            }
            let scratch = |path: &PathBuf| path.file_name().unwrap().to_string_lossy().starts_with('.');
            let left = unfinished.iter().any(|path| scratch(path) && !is_of_part(path));
            assert!(!left, "{:?} at {blocks} blocks: {unfinished:?}", case.arguments);
            let status = output.status.code();
            let is_all = files.len() == expected.len()
                && files.iter().all(|(path, bytes)| is_whole(case, path, bytes, expected.get(path)));
            let expected_status = Some(if is_all { case.status } else { 2 });
            assert_eq!(status, expected_status, "{:?} at {blocks} blocks: {told}", case.arguments);
            assert!(!told.contains("panicked"), "{told}");
            full += usize::from(status == Some(2));
        }
        println!("{}: the disk was full {full} times of {}", case.arguments.join(" "), case.full_at().len());
        remove(folder);
    }
}

#[test]
fn of_several_pictures_those_that_fit_are_written() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    inputs(folder);
    done(folder, &["range", "in", "--hfov", "81", "--model", "in/m.safetensors", "--out", "whole"]);
    let sizes: BTreeMap<_, _> = tree(folder).0.into_iter().map(|(path, bytes)| (path, bytes.len())).collect();
    let between = (sizes.values().min().unwrap() + sizes.values().max().unwrap()) / 2;
    let fits = sizes.values().filter(|size| **size <= between / 512 * 512).count();
    assert!(fits > 0 && fits < sizes.len(), "{sizes:?}");
    let range = ["range", "in", "--hfov", "81", "--model", "in/m.safetensors", "--out", "out"];
    remove(folder);
    let output = on_small_disk(folder, &range, between / 512);
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!((output.status.code(), tree(folder).0.len()), (Some(2), fits), "{told}");
    assert!(
        told.ends_with(&format!(
            "{} could not be written\n",
            if sizes.len() - fits == 1 { "1 output" } else { "2 outputs" }
        )),
        "{told}"
    );
}

#[test]
fn a_reader_of_the_table_that_goes_away_stops_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let folder = &folder.path().canonicalize().unwrap();
    inputs(folder);
    for case in cases().iter().filter(|case| ["range", "track", "eval", "synth"].contains(&case.arguments[0])) {
        let (expected, _) = undisturbed(folder, case);
        remove(folder);
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let mut command = Command::new(env!("CARGO_BIN_EXE_farsight"));
        command.args(&case.arguments).current_dir(folder).stdout(writer).stderr(Stdio::piped());
        let output = command.spawn().unwrap().wait_with_output().unwrap();
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success() && !told.contains("panicked"), "{:?}: {told}", case.arguments);
        let (files, unfinished) = tree(folder);
        assert!(files == expected && unfinished.is_empty(), "{:?}: {:?}, {unfinished:?}", case.arguments, files.keys());
        remove(folder);
    }
}

/// How many cameras are tried, where nothing else is said: twice as many as `FARSIGHT_FAULTS` then.
const CAMERAS: usize = 200;

#[test]
fn odd_cameras_give_numbers_or_errors() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::create_dir(folder.join("in")).unwrap();
    fs::create_dir(folder.join("calib")).unwrap();
    let (norm, neck) = (NormKind::Batch, NeckKind::Plain);
    let config = SmokeConfig { input: [96, 64], width: 0.25, norm, neck, ..SmokeConfig::default() };
    let mut model = SmokeModel::new(config.clone(), initial_weights(&config.graph(), 1)).unwrap();
    // Something is found everywhere.
    model.weights.tensors.get_mut("heads.predictor.class_head.3.bias").unwrap().values.fill(5.0);
    model.write(&folder.join("m.safetensors")).unwrap();
    let scene = farsight::read_image(root().join("assets/scenes/image_2/000000.jpg")).unwrap();
    let count = asked_tries().map_or(CAMERAS, |tries| 2 * tries);
    let mut random = 0x2545_f491_4f6c_dd1d_u64;
    let mut number = |below: usize| {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (random >> 33) as usize % below
    };
    let odd = ["0", "-0", "1", "-1", "1e-300", "1e300", "-1e300", "1e6", "0.001", "721.5", "-721.5", "5000", "1e-6"];
    for place in 0..count {
        let image = image::imageops::crop_imm(&scene, 8 * (place as u32 % 100), 100, 96, 64).to_image();
        image.save(folder.join(format!("in/{place:04}.png"))).unwrap();
        let mut row = ["60", "0", "48", "0", "0", "60", "32", "0", "0", "0", "1", "0"];
        for _ in 0..=number(3) {
            row[number(row.len())] = odd[number(odd.len())];
        }
        fs::write(folder.join(format!("calib/{place:04}.txt")), format!("P2: {}\n", row.join(" "))).unwrap();
    }
    let range = ["range", "in", "--calib", "calib", "--model", "m.safetensors", "--json", "a.jsonl", "--kitti", "rows"];
    let output = program::farsight(folder, &range);
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!told.contains("panicked"), "{told}");
    let lines = fs::read_to_string(folder.join("a.jsonl")).unwrap();
    let answered = lines.lines().count();
    for line in lines.lines() {
        let record: serde_json::Value = serde_json::from_str(line).unwrap();
        for found in record["detections"].as_array().unwrap() {
            for key in ["range_m", "range_sigma_m", "location", "dimensions_hwl", "box2d", "rotation_y"] {
                let text = found[key].to_string();
                // What is no number is null in JSON.
                assert!(key == "range_sigma_m" || !text.contains("null"), "{line}");
            }
        }
    }
    let failures = told.lines().filter(|line| line.starts_with("error: ")).count();
    println!("{count} cameras: {answered} answered, {} refused", count - answered);
    let expected = Some(i32::from(answered < count));
    assert_eq!((output.status.code(), answered == count || failures > 0), (expected, true), "{told}");
    assert!(answered > count / 10, "{told}");
    for row in fs::read_dir(folder.join("rows")).unwrap() {
        let text = fs::read_to_string(row.unwrap().path()).unwrap();
        assert!(!text.contains("nan") && !text.contains("NaN") && !text.contains("inf"), "{text}");
    }
}

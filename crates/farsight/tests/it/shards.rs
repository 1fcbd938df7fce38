//! Jobs divided by `--shard`: whatever happens to the workers, the merged parts are the undivided result, byte for
//! byte.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::program::{done, farsight, root};
use farsight_graph::init::initial_weights;
use farsight_graph::layers::{NeckKind, NormKind};
use farsight_graph::model::NetworkConfig;
use farsight_methods::smoke::{SmokeConfig, SmokeModel};

/// How many parts, and how many workers are killed on the way.
const PARTS: usize = 16;
const KILLS: usize = 10;

/// Images of more than one size, one of them broken, and a small model.
fn inputs(folder: &Path) {
    fs::create_dir(folder.join("in")).unwrap();
    let scene = farsight::read_image(root().join("assets/scenes/image_2/000000.jpg")).unwrap();
    for place in 0..37_u32 {
        let piece = image::imageops::crop_imm(&scene, 20 * place, 100, 200 + 8 * place, 96).to_image();
        piece.save(folder.join(format!("in/{place:02}.png"))).unwrap();
    }
    fs::write(folder.join("in/11-broken.png"), "no image").unwrap();
    let (norm, neck) = (NormKind::Batch, NeckKind::Plain);
    let config = SmokeConfig { input: [96, 64], width: 0.25, norm, neck, ..SmokeConfig::default() };
    let weights = initial_weights(&config.graph(), 1);
    SmokeModel::new(config, weights).unwrap().write(&folder.join("m.safetensors")).unwrap();
}

/// All files below `folder` by their paths from there.
fn tree(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let (mut files, mut todo) = (BTreeMap::new(), vec![folder.to_owned()]);
    while let Some(place) = todo.pop() {
        for path in fs::read_dir(place).unwrap().map(|entry| entry.unwrap().path()) {
            if path.is_dir() {
                todo.push(path);
            } else {
                files.insert(path.strip_prefix(folder).unwrap().to_owned(), fs::read(&path).unwrap());
            }
        }
    }
    files
}

/// That two folders have the same files, told by name.
fn assert_same(found: &Path, expected: &Path) {
    let (found, expected) = (tree(found), tree(expected));
    assert!(found.keys().eq(expected.keys()), "{:?}\n{:?}", found.keys(), expected.keys());
    for (path, bytes) in found {
        assert!(bytes == expected[&path], "{}: other bytes", path.display());
    }
}

/// The words of `line`, and those that ask for a part.
fn part_of<'a>(line: &'a str, shard: &'a str) -> Vec<&'a str> {
    line.split(' ').chain(["--shard", shard, "--parts", "parts"]).collect()
}

const RANGE: &str =
    "range in --hfov 81 --model m.safetensors --min-score 0.01 --json all.json --out drawn --kitti rows/mine";

#[test]
fn workers_that_are_killed_change_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    inputs(folder);
    let shards: Vec<String> = (1..=PARTS).map(|number| format!("{number}/{PARTS}")).collect();
    let spawn = |shard: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_farsight"));
        command.args(part_of(RANGE, shard)).current_dir(folder).stdout(Stdio::null()).stderr(Stdio::null());
        command.spawn().unwrap()
    };
    let start = Instant::now();
    assert!(spawn(&shards[0]).wait().unwrap().success());
    let duration = start.elapsed();

    let mut random = 0x9e37_79b9_7f4a_7c15_u64;
    let mut below = |limit: usize| {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((random >> 33) as usize) % limit
    };
    let mut todo: Vec<&String> = shards.iter().collect();
    let mut killed = 0;
    while !todo.is_empty() {
        let place = below(todo.len());
        let mut worker = spawn(todo[place]);
        if killed < KILLS {
            // Ever shorter, so that the last parts are not done before enough workers were killed.
            let longest = duration.as_micros() as usize * todo.len() / PARTS;
            sleep(Duration::from_micros(below(longest + 1) as u64));
            worker.kill().unwrap();
        }
        // The part with the broken image says so by its status.
        match worker.wait().unwrap().code() {
            Some(0 | 1) => drop(todo.swap_remove(place)),
            Some(status) => panic!("{}: status {status}", todo[place]),
            None => killed += 1,
        }
    }
    assert_eq!(killed, KILLS);
    let left: Vec<_> = fs::read_dir(folder.join("parts")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert!(left.len() == PARTS && left.iter().all(|name| !name.to_string_lossy().starts_with('.')), "{left:?}");

    // What is there is left as it is.
    let before = fs::metadata(folder.join("parts/002-of-016/manifest.json")).unwrap().modified().unwrap();
    let again = farsight(folder, &part_of(RANGE, "2/16"));
    assert!(String::from_utf8_lossy(&again.stderr).contains("part 2/16 is there already"));
    assert_eq!(fs::metadata(folder.join("parts/002-of-016/manifest.json")).unwrap().modified().unwrap(), before);

    fs::create_dir(folder.join("whole")).unwrap();
    for name in ["in", "m.safetensors"] {
        std::os::unix::fs::symlink(folder.join(name), folder.join("whole").join(name)).unwrap();
    }
    let whole = farsight(&folder.join("whole"), &RANGE.split(' ').collect::<Vec<_>>());
    assert_eq!(whole.status.code(), Some(1));
    for name in ["in", "m.safetensors"] {
        fs::remove_file(folder.join("whole").join(name)).unwrap();
    }
    let merged = farsight(folder, &["merge", "parts", "--out", "merged"]);
    assert_eq!(merged.status.code(), Some(1));
    let told = String::from_utf8(merged.stderr).unwrap();
    let expected = "error: in/11-broken.png: failed when its part was made\n37 items of 16 parts in merged; 1 failed\n";
    assert_eq!(told, expected);
    assert_same(&folder.join("merged"), &folder.join("whole"));
}

/// Runs `line` in two parts, the second one first, and merges them; the folder of what it writes undivided, and merged.
fn divided(folder: &Path, line: &str) -> [PathBuf; 2] {
    for shard in ["2/2", "1/2"] {
        done(folder, &part_of(line, shard));
    }
    let merged = done(folder, &["merge", "parts", "--out", "merged"]);
    fs::create_dir(folder.join("whole")).unwrap();
    let printed = done(&folder.join("whole"), &line.split(' ').collect::<Vec<_>>());
    // What the undivided command prints, the merge does.
    assert_eq!(merged, printed);
    ["whole", "merged"].map(|name| folder.join(name))
}

#[test]
fn rendered_parts_are_the_whole_data_set() {
    let folder = tempfile::tempdir().unwrap();
    let world = root().join("configs/worlds/world.toml");
    let line = format!("synth --out set --frames 5 --seed 3 --jpeg 80 --world {}", world.display());
    let [whole, merged] = divided(folder.path(), &line);
    assert!(tree(&whole).len() > 5 * 3);
    assert_same(&merged, &whole);
}

#[test]
fn merged_parts_are_judged_as_one() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    inputs(folder);
    done(folder, &["synth", "--out", "k", "--frames", "3", "--seed", "3"]);
    let [data, model] = ["k", "m.safetensors"].map(|name| folder.join(name).display().to_string());
    let line = format!("eval --data {data} --model {model} --resamples 20 --results rows --json figures.json");
    let [whole, merged] = divided(folder, &line);
    assert_eq!(tree(&whole).len(), 4);
    assert_same(&merged, &whole);
}

#[test]
fn films_are_followed_one_by_one() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    inputs(folder);
    for (name, images) in [("a", ["01", "02"]), ("b", ["03", "04"]), ("c", ["05", "06"])] {
        fs::create_dir(folder.join(name)).unwrap();
        for image in images {
            fs::copy(folder.join(format!("in/{image}.png")), folder.join(format!("{name}/{image}.png"))).unwrap();
        }
    }
    let options = "--fps 10 --hfov 81 --model m.safetensors --min-score 0.05 --json t.jsonl --mcap film/t.mcap";
    let line = format!("track a b c {options}");
    for shard in ["2/2", "1/2"] {
        done(folder, &part_of(&line, shard));
    }
    done(folder, &["merge", "parts", "--out", "merged"]);
    for name in ["a", "b", "c"] {
        fs::create_dir(folder.join("film")).unwrap();
        done(folder, &format!("track {name} {options}").split(' ').collect::<Vec<_>>());
        for file in ["t.jsonl", "film/t.mcap"] {
            let [merged, alone] =
                [folder.join("merged").join(name).join(file), folder.join(file)].map(|path| fs::read(path).unwrap());
            assert!(merged == alone && !alone.is_empty(), "{name}/{file}");
        }
        fs::remove_dir_all(folder.join("film")).unwrap();
    }
    let told = refusal(folder, &part_of(&format!("track a {options}"), "1/2"));
    assert!(told.contains("a: one video, and tracks go through all of it"), "{told}");
}

/// What is said where nothing can be done.
fn refusal(folder: &Path, arguments: &[&str]) -> String {
    let output = farsight(folder, arguments);
    let told = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {told}");
    told
}

#[test]
fn gaps_doubles_and_strangers_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("world.toml"), "").unwrap();
    let line = "synth --out set --frames 3 --jpeg 50 --world world.toml";
    let merge = |more: &[&str]| refusal(folder, &[&["merge", "parts", "--out", "merged"], more].concat());
    done(folder, &part_of(line, "1/3"));
    done(folder, &part_of(line, "3/3"));
    assert!(merge(&[]).contains("parts: of 3 parts there is no 2"));
    done(folder, &part_of(line, "2/3"));
    done(folder, &["synth", "--out", "set", "--frames", "3", "--shard", "2/3", "--parts", "others"]);
    assert!(merge(&["others"]).contains("others/002-of-003: parts/001-of-003 is of another command line: "));
    fs::create_dir(folder.join("twins")).unwrap();
    done(folder, &[&part_of(line, "2/3")[..9], &["--shard", "2/3", "--parts", "twins"]].concat());
    assert!(
        merge(&["twins"]).contains("twins/002-of-003: part 2 is in parts/002-of-003, too; expected each part once")
    );
    assert!(merge(&["nowhere"]).contains("nowhere: cannot be listed; expected a folder of parts"));

    // Inputs that have changed since.
    fs::write(folder.join("world.toml"), "# another\n").unwrap();
    let told = refusal(folder, &part_of(line, "2/3"));
    assert!(told.contains("parts/002-of-003: made with another files that all parts read: "), "{told}");
    fs::write(folder.join("world.toml"), "").unwrap();

    // Outputs that have.
    let label = folder.join("parts/003-of-003/set/training/label_2/000002.txt");
    let before = fs::read(&label).unwrap();
    fs::write(&label, "").unwrap();
    assert!(
        merge(&[]).contains("000002.txt: not the bytes that manifest.json names; expected the part as it was written")
    );
    assert!(!folder.join("merged").exists());
    fs::write(&label, before).unwrap();
    done(folder, &["merge", "parts", "--out", "merged"]);
    assert!(merge(&[]).contains("merged: there already and not empty; expected a new folder"));
}

#[test]
fn what_cannot_be_divided_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let told = |line: &str| refusal(folder, &line.split(' ').collect::<Vec<_>>());
    for (line, expected) in [
        ("synth --out /tmp/set --shard 1/2 --parts p", "expected a relative path, such as --out out"),
        ("synth --out set --shard 3/2 --parts p", "expected I/N with I from 1 to N, such as 3/16"),
        ("synth --out set --shard 1/2", "--parts <DIR>"),
        ("synth --out set --resume --shard 1/2 --parts p", "cannot be used with"),
        ("eval --labels l --results r --shard 1/2 --parts p", "expected --data DIR"),
        ("eval --data d --shard 1/2 --parts p", "expected --results DIR"),
        ("range . --hfov 80 --json - --shard 1/2 --parts p", "no image to look at"),
    ] {
        assert!(told(line).contains(expected), "{line}: {}", told(line));
    }
}

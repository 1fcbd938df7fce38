//! Replays what is saved of the fuzz targets, and a few hundred mutants of it, the same every time.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "the helpers of a test may panic and print")]

use std::fs;
use std::path::Path;

use farsight_laws::mutate::{Random, mutated};
use farsight_laws::{TARGETS, Target, named};

/// Mutants of each target.
const MUTANTS: usize = 300;

fn saved(target: &Target) -> Vec<Vec<u8>> {
    let fuzz = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz");
    let folders = ["corpus", "artifacts"].map(|kind| fuzz.join(kind).join(target.name));
    let mut paths: Vec<_> =
        folders.iter().flat_map(fs::read_dir).flatten().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    paths.iter().map(|path| fs::read(path).unwrap()).collect()
}

#[test]
fn laws_hold_of_saved_inputs_and_of_their_mutants() {
    for target in TARGETS {
        let mut inputs = saved(target);
        inputs.extend((target.seeds)());
        assert!(!inputs.is_empty(), "{}: nothing to begin with", target.name);
        println!("{}: {} inputs", target.name, inputs.len());
        for input in &inputs {
            (target.law)(input);
        }
        let mut random = Random::new(7);
        for _ in 0..MUTANTS {
            (target.law)(&mutated(&inputs, &mut random));
        }
    }
}

#[test]
fn seeds_are_good_files() {
    for name in ["detector", "refiner", "plate_reader"] {
        let seeds = (named(name).unwrap().seeds)();
        assert_eq!(seeds.len(), 2, "{name}");
    }
    assert!(TARGETS.len() >= 21);
    // Mutants of what is refused at once go nowhere.
    let mut refused = Vec::new();
    for target in TARGETS {
        let seeds = (target.seeds)();
        assert!(!seeds.is_empty(), "{}: no seeds", target.name);
        for (place, seed) in seeds.iter().enumerate().filter(|(_, seed)| !(target.law)(seed)) {
            refused.push(format!("{} {place}: {}", target.name, String::from_utf8_lossy(&seed[..seed.len().min(60)])));
        }
    }
    assert!(refused.is_empty(), "{refused:#?}");
    // Every target is known to libFuzzer, too.
    let fuzz = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz");
    let manifest = fs::read_to_string(fuzz.join("Cargo.toml")).unwrap();
    for target in TARGETS {
        assert!(manifest.contains(&format!("name = \"{}\"", target.name)), "{}", target.name);
        assert!(fuzz.join(format!("fuzz_targets/{}.rs", target.name)).is_file(), "{}", target.name);
    }
}

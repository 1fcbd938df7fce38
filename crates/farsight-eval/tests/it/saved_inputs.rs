//! Replays what the fuzz targets were fed: their corpus and every input that once broke a law.

use crate::laws;
use std::fs;
use std::path::Path;

fn replay(target: &str, law: fn(&[u8]) -> bool) {
    let project = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut replayed = 0;
    for folder in [project.join("fuzz/corpus").join(target), project.join("fuzz/artifacts").join(target)] {
        for entry in fs::read_dir(&folder).into_iter().flatten() {
            let path = entry.unwrap().path();
            eprintln!("{}", path.display());
            law(&fs::read(&path).unwrap());
            replayed += 1;
        }
    }
    if replayed == 0 {
        eprintln!("skipped: no saved inputs in fuzz/corpus/{target}");
    }
}

#[test]
fn label_files() {
    replay("labels", laws::labels);
}

#[test]
fn result_files() {
    replay("results", laws::results);
}

#[test]
fn calibration_files() {
    replay("calibration", laws::calibration);
}

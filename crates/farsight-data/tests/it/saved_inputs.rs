//! Replays what the fuzz target was fed: its corpus, every input that once broke a law, and damaged versions of the
//! corpus.

use std::fs;
use std::path::Path;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use crate::laws;

fn saved() -> Vec<Vec<u8>> {
    let fuzz = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz");
    let entries =
        ["corpus/image", "artifacts/image"].into_iter().filter_map(|folder| fs::read_dir(fuzz.join(folder)).ok());
    entries.flatten().map(|entry| fs::read(entry.unwrap().path()).unwrap()).collect()
}

#[test]
fn images() {
    let saved = saved();
    assert!(!saved.is_empty());
    for bytes in &saved {
        laws::image(bytes);
    }
}

#[test]
fn damaged_images() {
    const EACH: usize = 200;
    let mut random = Pcg64::seed_from_u64(1);
    for bytes in saved() {
        for _ in 0..EACH {
            let mut damaged = bytes.clone();
            for _ in 0..random.random_range(1..6) {
                let at = random.random_range(0..damaged.len());
                match random.random_range(0..4) {
                    0 => damaged[at] = random.random(),
                    1 => damaged[at] ^= 1 << random.random_range(0..8),
                    2 => damaged.truncate(at.max(1)),
                    _ => {
                        damaged.insert(at, 0xFF);
                    }
                }
            }
            laws::image(&damaged);
        }
    }
}

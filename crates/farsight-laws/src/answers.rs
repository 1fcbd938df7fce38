//! The law of JSON that the program reads back, through its own readers.

// They are the program's, not the library's.
#[path = "../../farsight/src/commands/range/answers.rs"]
#[allow(dead_code, reason = "the program uses the rest")]
mod range_answers;
#[path = "../../farsight/src/commands/eval_tracks/told.rs"]
pub(crate) mod told_tracks;

use std::path::Path;

use crate::experiment::results::Results;
use crate::shard::manifest::{FILE, Manifest};
use crate::text::{accepted, as_file};
use range_answers::AnswerFile;

/// Answers of `farsight range` and `farsight track`, the manifest of a part, the results of an experiment: what is
/// accepted says the same when it is written and read again.
pub(crate) fn answers(bytes: &[u8]) -> bool {
    let kinds = [ranged(bytes), tracked(bytes), manifest_law(bytes), results(bytes)];
    kinds.contains(&true)
}

fn ranged(bytes: &[u8]) -> bool {
    let mut is_accepted = false;
    // An array, and lines of which the last one may be cut off.
    for name in ["input.json", "input.jsonl"] {
        let (folder, path) = as_file(name, bytes);
        let Some(records) = accepted(range_answers::read(&path), &path) else { continue };
        is_accepted |= !records.is_empty();
        let copy = folder.path().join("copy.json");
        let mut file = AnswerFile::begin(&copy, Vec::new()).expect("a file for the answers");
        for (record, _) in &records {
            file.add(record.clone()).expect("a file for the answers");
        }
        file.finish(&[]).expect("a file for the answers");
        let again = range_answers::read(&copy).expect("what was written");
        assert_eq!(again.len(), records.len());
        for ((first, _), (second, _)) in records.iter().zip(&again) {
            let [first, second] = [first, second].map(|record| serde_json::to_value(record).expect("what was read"));
            assert_eq!(first, second);
        }
    }
    is_accepted
}

fn tracked(bytes: &[u8]) -> bool {
    let (_folder, path) = as_file("input.jsonl", bytes);
    accepted(told_tracks::told(&path), &path).is_some_and(|frames| !frames.is_empty())
}

/// Reads answers of `farsight range`.
pub(crate) fn answers_of(path: &Path) -> anyhow::Result<()> {
    range_answers::read(path).map(drop)
}

/// Reads the manifest in a folder.
pub(crate) fn manifest(folder: &Path) -> anyhow::Result<()> {
    Manifest::read(folder).map(drop)
}

fn manifest_law(bytes: &[u8]) -> bool {
    let (folder, path) = as_file(FILE, bytes);
    let Some(manifest) = accepted(Manifest::read(folder.path()), &path) else { return false };
    let text = serde_json::to_string(&manifest).expect("what was read");
    std::fs::write(&path, text).expect("a file for the text");
    assert_eq!(Manifest::read(folder.path()).expect("what was written"), manifest);
    true
}

fn results(bytes: &[u8]) -> bool {
    let (_folder, path) = as_file("results.json", bytes);
    let Some(results) = accepted(Results::read(&path), &path) else { return false };
    results.write(&path).expect("a file for the results");
    let again = Results::read(&path).expect("what was written");
    let [first, second] = [&results, &again].map(|results| serde_json::to_value(results).expect("what was read"));
    assert_eq!(first, second);
    true
}

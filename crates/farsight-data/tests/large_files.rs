//! Ten megabytes of anything: each reader of text takes a second and 256 MB at most, and refuses more by its limit.
//!
//! The times are printed (`-- --nocapture`) and stand in docs/reliability.md; what is asserted is the memory, and that
//! the test ends at all: one line of three million words once took a minute.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "the helpers of a test may panic and print")]

use std::fs;
use std::path::Path;
use std::sync::Mutex;
use std::time::Instant;

use farsight_data::annotations::{FileAnnotation, Plates};
use farsight_data::kitti::devkit::MAX_DIAGNOSTICS;
use farsight_data::kitti::rows::{rows_from_text, rows_from_text_lenient};
use farsight_data::kitti::split::split_from_text;
use farsight_data::kitti::{Calibration, RowKind, read_labels, read_split, rows_as_devkit};
use farsight_testing::{Counting, peak};

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// What is counted is counted for the whole process.
static ALONE: Mutex<()> = Mutex::new(());

/// Bytes of an input.
const SIZE: usize = 10_000_000;

/// Bytes that a reader may take for it.
const MOST: usize = 256_000_000;

fn repeated(text: &str) -> String {
    text.repeat(SIZE / text.len())
}

/// Texts that are hard on a reader.
fn inputs() -> Vec<(&'static str, String)> {
    let row = "Car 0.00 0 1.55 608.40 182.50 719.60 281.90 1.52 1.66 4.07 0.80 1.71 13.60 1.62";
    vec![
        ("one line of words", repeated("a b ")),
        ("one line of numbers", repeated("1 ")),
        ("one line of rows", repeated(&format!("{row} "))),
        ("a word a line", repeated("a\n")),
        ("rows", repeated(&format!("{row}\n"))),
        ("result rows", repeated(&format!("{row} 0.9\n"))),
        ("one word", repeated("a")),
        ("one number", repeated("1")),
        ("long words", repeated(&format!("{} ", "1".repeat(400)))),
        ("one line of blanks", repeated(" ")),
        ("empty lines", repeated("\n")),
        ("one calibration row", format!("P2: {}", repeated("1.0 "))),
        ("ids", (0..SIZE / 8).map(|id| format!("{id:07}")).collect::<Vec<_>>().join("\n")),
    ]
}

/// Reads a text; the path is what errors call it.
type Reader = fn(&str, &Path);

#[test]
fn ten_megabytes_of_anything_take_a_bounded_amount_of_memory() {
    let _alone = ALONE.lock();
    let path = Path::new("in.txt");
    let readers: [(&str, Reader); 8] = [
        ("labels as the devkit", |text, _| drop(rows_as_devkit(text, RowKind::Label))),
        ("results as the devkit", |text, _| drop(rows_as_devkit(text, RowKind::Result))),
        ("labels", |text, path| drop(rows_from_text(text, path, RowKind::Label))),
        ("results", |text, path| drop(rows_from_text(text, path, RowKind::Result))),
        ("labels, leniently", |text, path| drop(rows_from_text_lenient(text, path, RowKind::Label))),
        ("calibration", |text, path| drop(Calibration::from_text(text, path))),
        ("split", |text, path| drop(split_from_text(text, path))),
        ("plates", |text, _| drop(Plates::from_text(text))),
    ];
    for (name, text) in inputs() {
        for (reader, read) in readers {
            let start = Instant::now();
            let (taken, ()) = peak(|| read(&text, path));
            let seconds = start.elapsed().as_secs_f64();
            println!("{name:>20}  {reader:>22}  {seconds:6.2} s  {:4} MB", taken / 1_000_000);
            assert!(taken <= MOST, "{name}, {reader}: {taken} bytes");
        }
    }
}

#[test]
fn more_oddities_than_are_kept_are_counted() {
    let _alone = ALONE.lock();
    let rows = 3 * MAX_DIAGNOSTICS;
    let read = rows_as_devkit(&"a\n".repeat(rows), RowKind::Label);
    assert_eq!(read.diagnostics.len(), MAX_DIAGNOSTICS + 1);
    let (_, last) = read.diagnostics.last().unwrap();
    assert_eq!(last.to_string(), format!("{} more like those before", rows - MAX_DIAGNOSTICS));
    // What makes every figure wrong is told wherever it stands.
    let fatal = "\nCar 0.00 0.5 1.55 608.40 182.50 719.60 281.90 1.52 1.66 4.07 0.80 1.71 13.60 1.62\n";
    let read = rows_as_devkit(&("a\n".repeat(rows) + fatal), RowKind::Label);
    assert!(read.diagnostics.iter().any(|(_, diagnostic)| diagnostic.is_fatal()));
}

#[test]
fn larger_files_are_refused_by_their_limit() {
    let _alone = ALONE.lock();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("000000.txt");
    fs::write(&path, vec![b'\n'; 10 * 1024 * 1024 + 1]).unwrap();
    let told = [
        read_labels(&path).unwrap_err().to_string(),
        read_split(&path).unwrap_err().to_string(),
        Calibration::read(&path).unwrap_err().to_string(),
    ];
    for told in told {
        assert!(told.starts_with(&path.display().to_string()), "{told}");
        assert!(told.contains("10485761 bytes or more; expected at most 10485760"), "{told}");
    }
}

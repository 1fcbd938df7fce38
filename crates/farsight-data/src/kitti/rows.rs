//! Label and result files: reading row by row, strictly or leniently, and writing.

use std::fmt::Write as _;
use std::io;
use std::path::{Path, PathBuf};

use farsight_core::{Detection, Label, ObjectClass};
use farsight_files::write_quickly;
use thiserror::Error;

use super::fields::{Row, RowError, RowKind, row_from_fields, sigma_from_field};

/// What a result row says where a label has truncation and occlusion: KITTI's mark for "not given".
///
/// The devkit reads both as numbers and forgets them; Python tools read the occlusion as an integer, so `0.00` would
/// not do.
const NOT_GIVEN: i32 = -1;

/// A label or result file that could not be read or written.
#[derive(Debug, Error)]
pub enum RowsError {
    /// The file cannot be opened or is no text.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// The file cannot be written; the old one, if any, is still there.
    #[error("{}: cannot be written: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// A line is malformed.
    #[error(transparent)]
    Line(#[from] LineError),
}

/// A malformed line.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{}:{line}: {problem}", path.display())]
pub struct LineError {
    /// The file.
    pub path: PathBuf,
    /// Its line, from 1.
    pub line: usize,
    /// What is wrong.
    pub problem: RowError,
}

/// What a lenient reader left out.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Skipped {
    /// How many lines.
    pub count: usize,
    /// The first of them.
    pub first: Option<LineError>,
}

/// The rows of `text`; `path` is what errors call it. Empty lines are no rows; lines may end in CR LF.
///
/// # Errors
/// At the first malformed line.
pub fn rows_from_text(text: &str, path: &Path, kind: RowKind) -> Result<Vec<Row>, LineError> {
    lines(text, path, kind).map(|line| line.map(|(row, _)| row)).collect()
}

/// The well-formed rows of `text` and a report of the others.
pub fn rows_from_text_lenient(text: &str, path: &Path, kind: RowKind) -> (Vec<Row>, Skipped) {
    let mut skipped = Skipped::default();
    let mut rows = Vec::new();
    for line in lines(text, path, kind) {
        match line {
            Ok((row, _)) => rows.push(row),
            Err(error) => {
                skipped.count += 1;
                skipped.first.get_or_insert(error);
            }
        }
    }
    (rows, skipped)
}

/// The rows of a label or result file.
///
/// # Errors
/// When the file cannot be read, or at its first malformed line.
pub fn read_rows(path: &Path, kind: RowKind) -> Result<Vec<Row>, RowsError> {
    Ok(rows_from_text(&read_text(path)?, path, kind)?)
}

/// The well-formed rows of a label or result file and a report of the others.
///
/// # Errors
/// When the file cannot be read.
pub fn read_rows_lenient(path: &Path, kind: RowKind) -> Result<(Vec<Row>, Skipped), RowsError> {
    Ok(rows_from_text_lenient(&read_text(path)?, path, kind))
}

/// The objects of a label file.
///
/// # Errors
/// As [`read_rows`].
pub fn read_labels(path: &Path) -> Result<Vec<Label>, RowsError> {
    Ok(read_rows(path, RowKind::Label)?.into_iter().map(|row| row.label).collect())
}

/// The detections of a result file, with their error bars when there is a 17th column.
///
/// Their alpha is computed from the box; [`read_rows`] keeps the written one.
///
/// # Errors
/// As [`read_rows`].
pub fn read_results(path: &Path) -> Result<Vec<Detection>, RowsError> {
    let text = read_text(path)?;
    let detections = lines(&text, path, RowKind::Result).map(|line| {
        let (row, range_sigma_m) = line?;
        Ok(Detection { range_sigma_m, ..row.into_detection() })
    });
    detections.collect()
}

/// A label file, as KITTI writes it: two decimals, and none for the numbers that `DontCare` rows have only for form.
///
/// Reading KITTI's own files and writing them again gives the same bytes.
pub fn text_from_labels(labels: &[Label]) -> String {
    let mut text = String::new();
    for label in labels {
        let form = |value: f64| {
            let whole = label.class == ObjectClass::DontCare && value.fract() == 0.0;
            if whole { format!("{value:.0}") } else { format!("{value:.2}") }
        };
        let Label { class, truncation, occlusion, alpha, box2d, box3d } = label;
        push_words(&mut text, [class.name().to_owned(), form(*truncation), occlusion.to_string(), form(*alpha)]);
        push_words(&mut text, [box2d.x1, box2d.y1, box2d.x2, box2d.y2].map(|v| format!("{v:.2}")));
        let [x, y, z] = box3d.location;
        let d = box3d.dimensions;
        push_words(&mut text, [d.height, d.width, d.length, x, y, z, box3d.yaw].map(form));
        end_line(&mut text);
    }
    text
}

/// A result file, four decimals, truncation and occlusion `-1 -1` (not given).
///
/// A detection with an error bar has it in a 17th column, which the devkit and its copies read past.
/// Without detections the text is empty; the file must be written all the same, evaluators ask for one a frame.
pub fn text_from_results(detections: &[Detection]) -> String {
    let mut text = String::new();
    for detection in detections {
        let Detection { class, score, box2d, box3d, range_sigma_m } = detection;
        push_words(&mut text, [class.name().to_owned(), NOT_GIVEN.to_string(), NOT_GIVEN.to_string()]);
        let [x, y, z] = box3d.location;
        let d = box3d.dimensions;
        let image = [detection.alpha(), box2d.x1, box2d.y1, box2d.x2, box2d.y2];
        let scene = [d.height, d.width, d.length, x, y, z, box3d.yaw, *score];
        let numbers = image.iter().chain(&scene).chain(range_sigma_m);
        push_words(&mut text, numbers.map(|v| format!("{v:.4}")));
        end_line(&mut text);
    }
    text
}

/// Writes a label file; it is there whole or not at all.
///
/// # Errors
/// When the folder cannot be written to.
pub fn write_labels(path: &Path, labels: &[Label]) -> Result<(), RowsError> {
    write_text(path, &text_from_labels(labels))
}

/// Writes a result file; it is there whole or not at all.
///
/// # Errors
/// When the folder cannot be written to.
pub fn write_results(path: &Path, detections: &[Detection]) -> Result<(), RowsError> {
    write_text(path, &text_from_results(detections))
}

/// The rows of `text`, each with the error bar of a result's 17th column.
fn lines<'a>(
    text: &'a str,
    path: &'a Path,
    kind: RowKind,
) -> impl Iterator<Item = Result<(Row, Option<f64>), LineError>> + 'a {
    let words = text.lines().map(|line| line.split_ascii_whitespace().collect::<Vec<_>>());
    words.zip(1..).filter(|(words, _)| !words.is_empty()).map(move |(words, line)| {
        row_and_sigma(&words, kind).map_err(|problem| LineError { path: path.to_owned(), line, problem })
    })
}

fn row_and_sigma(words: &[&str], kind: RowKind) -> Result<(Row, Option<f64>), RowError> {
    let (words, sigma) = match (kind, words.split_at_checked(kind.columns())) {
        (RowKind::Result, Some((row, [sigma]))) => (row, Some(sigma_from_field(sigma)?)),
        _ => (words, None),
    };
    Ok((row_from_fields(words, kind)?, sigma))
}

fn read_text(path: &Path) -> Result<String, RowsError> {
    farsight_files::read_text(path).map_err(|source| RowsError::Read { path: path.to_owned(), source })
}

fn write_text(path: &Path, text: &str) -> Result<(), RowsError> {
    write_quickly(path, |file| file.write_all(text.as_bytes()))
        .map_err(|e| RowsError::Write { path: path.to_owned(), source: e.source })
}

fn push_words(text: &mut String, words: impl IntoIterator<Item = String>) {
    for word in words {
        // Writing to a string cannot fail.
        let _ = write!(text, "{word} ");
    }
}

/// Turns the blank after the last word into the end of the line.
fn end_line(text: &mut String) {
    text.pop();
    text.push('\n');
}

//! Reading label and result files as the official devkit does, and telling what it would have done silently.
//!
//! The devkit reads with `fscanf`: a stream of words in which line ends mean nothing (spec kitti-eval.md, section 2,
//! rules 1 to 3). Ordinary rows go through the parser that all readers share; from a row that is not ordinary to the
//! next one that starts a line, `stream` follows the devkit word by word.

mod diagnostic;
mod stream;
#[cfg(test)]
mod tests;

pub use diagnostic::Diagnostic;

use farsight_core::ObjectClass;

use super::fields::{Row, RowKind, row_and_problem, sigma_from_field};
use stream::Stream;

/// Larger numbers are read as they are, and told: no distance in metres or pixel of an image comes near.
const ABSURD: f64 = 1e5;

/// A row that the devkit takes.
#[derive(Debug, Clone, PartialEq)]
pub struct DevkitRow {
    /// The line it starts on, from 1.
    pub line: usize,
    /// Its values; numbers need not be finite.
    pub row: Row,
    /// Standard deviation of the distance, metres: a 17th column of results, which the devkit reads past.
    pub range_sigma_m: Option<f64>,
}

/// What a file holds for the devkit.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct DevkitRows {
    /// The rows that count, in file order.
    pub rows: Vec<DevkitRow>,
    /// What was odd, in file order: the line, from 1, and what is odd about it.
    pub diagnostics: Vec<(usize, Diagnostic)>,
}

/// Reads a label or result file as the devkit does.
///
/// One kind of diagnostic is no reading at all: see [`Diagnostic::is_fatal`].
pub fn rows_as_devkit(text: &str, kind: RowKind) -> DevkitRows {
    let mut read = DevkitRows::default();
    let (mut rest, mut number) = (text, 1);
    let mut words = Vec::with_capacity(kind.columns() + 1);
    while let Some(line) = rest.split_inclusive('\n').next() {
        words.clear();
        words.extend(line.split_ascii_whitespace());
        (rest, number) = if words.is_empty() || read.push_ordinary(&words, kind, number) {
            (&rest[line.len()..], number + 1)
        } else {
            Stream::new(rest, number).read(kind, &mut read)
        };
    }
    if let Some(position) = text.find('\r') {
        read.diagnostics.push((1 + text[..position].matches('\n').count(), Diagnostic::CarriageReturn));
    }
    read
}

impl DevkitRows {
    /// Takes a line that holds one whole row and nothing that two readers could read differently; false for any other
    /// line.
    fn push_ordinary(&mut self, words: &[&str], kind: RowKind, line: usize) -> bool {
        let (words, sigma) = match (kind, words.split_at_checked(kind.columns())) {
            (RowKind::Result, Some((row, [sigma]))) if sigma.parse::<f64>().is_ok() => (row, Some(sigma)),
            _ => (words, None),
        };
        let Ok((row, problem)) = row_and_problem(words, kind) else { return false };
        // The devkit reads past the 17th column whatever number it holds.
        let (range_sigma_m, no_error_bar) = match sigma.map(|sigma| sigma_from_field(sigma)).transpose() {
            Ok(sigma) => (sigma, None),
            Err(problem) => (None, Some(problem)),
        };
        let problems = problem.into_iter().chain(no_error_bar);
        self.diagnostics.extend(problems.map(|problem| (line, Diagnostic::OutOfRange(problem))));
        self.push(DevkitRow { line, row, range_sigma_m });
        true
    }

    fn push(&mut self, row: DevkitRow) {
        self.diagnostics.extend(odd_class(&row.row.label.class).map(|diagnostic| (row.line, diagnostic)));
        self.diagnostics.extend(row.row.numbers().find_map(odd_number).map(|diagnostic| (row.line, diagnostic)));
        self.rows.push(row);
    }
}

/// Names that KITTI does not know. The devkit compares without regard to case; nothing else makes two names equal.
fn odd_class(class: &ObjectClass) -> Option<Diagnostic> {
    let ObjectClass::Other(name) = class else { return None };
    let known = ObjectClass::KITTI.into_iter().find(|known| known.name().eq_ignore_ascii_case(name));
    Some(match known {
        Some(known) => Diagnostic::ClassInOtherCase { found: name.to_string(), known },
        None => Diagnostic::UnknownClass { found: name.to_string() },
    })
}

fn odd_number((name, value): (&'static str, f64)) -> Option<Diagnostic> {
    if !value.is_finite() {
        Some(Diagnostic::NotFinite { name, value })
    } else if value.abs() > ABSURD {
        Some(Diagnostic::Absurd { name, value })
    } else {
        None
    }
}

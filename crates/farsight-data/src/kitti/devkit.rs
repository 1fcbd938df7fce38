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

/// More diagnostics of a file than this are counted, not kept: a file of a single endless line has millions.
pub const MAX_DIAGNOSTICS: usize = 10_000;

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
    /// Diagnostics beyond [`MAX_DIAGNOSTICS`].
    untold: usize,
}

/// Reads a label or result file as the devkit does.
///
/// One kind of diagnostic is no reading at all: see [`Diagnostic::is_fatal`].
pub fn rows_as_devkit(text: &str, kind: RowKind) -> DevkitRows {
    let mut read = DevkitRows::default();
    let (mut rest, mut number) = (text, 1);
    // No row has more words than this; a line may have millions.
    let most_words = kind.columns() + 2;
    let mut words = Vec::with_capacity(most_words);
    while let Some(line) = rest.split_inclusive('\n').next() {
        words.clear();
        words.extend(line.split_ascii_whitespace().take(most_words));
        (rest, number) = if words.is_empty() || read.push_ordinary(&words, kind, number) {
            (&rest[line.len()..], number + 1)
        } else {
            Stream::new(rest, number).read(kind, &mut read)
        };
    }
    if let Some(position) = text.find('\r') {
        read.tell(1 + text[..position].matches('\n').count(), Diagnostic::CarriageReturn);
    }
    if read.untold > 0 {
        read.diagnostics.push((number, Diagnostic::Untold { count: read.untold }));
    }
    read
}

impl DevkitRows {
    /// Keeps what is odd about a line, or counts it when there is too much of that. What makes all figures wrong is
    /// always kept.
    fn tell(&mut self, line: usize, diagnostic: Diagnostic) {
        let has_fatal = || self.diagnostics.iter().any(|(_, told)| told.is_fatal());
        if self.diagnostics.len() < MAX_DIAGNOSTICS || (diagnostic.is_fatal() && !has_fatal()) {
            self.diagnostics.push((line, diagnostic));
        } else {
            self.untold += 1;
        }
    }

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
        problems.for_each(|problem| self.tell(line, Diagnostic::OutOfRange(problem)));
        self.push(DevkitRow { line, row, range_sigma_m });
        true
    }

    fn push(&mut self, row: DevkitRow) {
        let odd = odd_class(&row.row.label.class).into_iter().chain(row.row.numbers().find_map(odd_number));
        odd.for_each(|diagnostic| self.tell(row.line, diagnostic));
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

//! The file as `fscanf` sees it: words and numbers one after another, whatever the lines.

use farsight_core::ObjectClass;

use super::{DevkitRow, DevkitRows, Diagnostic};
use crate::kitti::fields::{COLUMNS, Row, RowKind};

/// Column of the occlusion, the only whole number.
const OCCLUSION: usize = 2;

/// No number is written with more letters; keeps a file of one endless word from taking endless time.
const MAX_NUMBER_LENGTH: usize = 400;

/// The part of a file that is not read yet.
pub(super) struct Stream<'a> {
    text: &'a str,
    rest: &'a str,
    line: usize,
}

/// How reading one row ended.
enum Outcome {
    /// All fields were there.
    Row(DevkitRow),
    /// The row broke off; what was read is lost.
    Broken(Diagnostic),
    /// Nothing was left to read.
    End,
}

/// The fields of a row that is being read.
struct Partial {
    class: String,
    numbers: [f64; COLUMNS.len()],
}

impl<'a> Stream<'a> {
    /// The stream of `text`, which starts on line number `line`.
    pub(super) fn new(text: &'a str, line: usize) -> Self {
        Self { text, rest: text, line }
    }

    /// Reads rows, at least one, until the next starts a line: there the devkit is where it is at the start of a file.
    /// Returns what is left, and the number of that line.
    pub(super) fn read(mut self, kind: RowKind, read: &mut DevkitRows) -> (&'a str, usize) {
        // Whether the last row read was whole, and the line where it ended.
        let mut whole_row_end = None;
        self.skip_blanks();
        loop {
            let line = self.line;
            match self.row(kind, &mut read.diagnostics) {
                Outcome::End => return ("", self.line),
                Outcome::Row(row) => {
                    if self.line != line {
                        read.diagnostics.push((line, Diagnostic::SplitRow));
                    }
                    read.push(row);
                    whole_row_end = Some(self.line);
                }
                Outcome::Broken(Diagnostic::DroppedRow { fields, .. }) if whole_row_end == Some(line) => {
                    // The devkit takes what follows a whole row for a new one and gives it up at the next class name.
                    read.diagnostics.push((line, Diagnostic::ExtraFields { extra: fields, expected: kind.columns() }));
                    whole_row_end = None;
                }
                Outcome::Broken(diagnostic) => {
                    read.diagnostics.push((line, diagnostic));
                    whole_row_end = None;
                }
            }
            self.skip_blanks();
            if self.starts_line() {
                return (self.rest, self.line);
            }
        }
    }

    /// Whether nothing but blanks stands before the rest on its line.
    fn starts_line(&self) -> bool {
        let before = &self.text[..self.text.len() - self.rest.len()];
        before.rsplit('\n').next().unwrap_or_default().chars().all(is_blank)
    }

    fn row(&mut self, kind: RowKind, diagnostics: &mut Vec<(usize, Diagnostic)>) -> Outcome {
        let (start, class) = (self.line, self.word());
        if class.is_empty() {
            return Outcome::End;
        }
        let mut partial = Partial { class: class.to_owned(), numbers: [0.0; COLUMNS.len()] };
        for (column, &name) in COLUMNS.iter().enumerate().take(kind.columns()).skip(1) {
            self.skip_blanks();
            let word = self.peek();
            let length = number_length(word);
            if kind == RowKind::Label && column == OCCLUSION && whole_number_length(word) < length {
                let found = word.to_owned();
                self.skip_line();
                return Outcome::Broken(Diagnostic::FractionalOcclusion { found });
            }
            let Ok(number) = word[..length].parse() else {
                let dropped =
                    Diagnostic::DroppedRow { fields: column, name, found: word.to_owned(), expected: kind.columns() };
                return Outcome::Broken(dropped);
            };
            if length < word.len() {
                diagnostics.push((
                    self.line,
                    Diagnostic::PartialNumber { number: column + 1, name, rest: word[length..].to_owned() },
                ));
            }
            partial.numbers[column] = number;
            self.rest = &self.rest[length..];
        }
        Outcome::Row(DevkitRow { line: start, row: partial.row(kind), range_sigma_m: None })
    }

    fn skip_blanks(&mut self) {
        let blanks = self.rest.len() - self.rest.trim_start_matches(is_blank).len();
        self.line += self.rest[..blanks].matches('\n').count();
        self.rest = &self.rest[blanks..];
    }

    /// Not what the devkit does, but after a fatal row its reading means nothing; the next line may.
    fn skip_line(&mut self) {
        self.rest = self.rest.split_once('\n').map_or("", |(_, rest)| rest);
        self.line += 1;
    }

    /// The next word, without taking it.
    fn peek(&self) -> &'a str {
        self.rest.split(is_blank).next().unwrap_or_default()
    }

    fn word(&mut self) -> &'a str {
        self.skip_blanks();
        let word = self.peek();
        self.rest = &self.rest[word.len()..];
        word
    }
}

impl Partial {
    fn row(self, kind: RowKind) -> Row {
        Row::from_numbers(ObjectClass::from_name(&self.class), &self.numbers, kind)
    }
}

/// White space as C counts it.
fn is_blank(c: char) -> bool {
    matches!(c, ' ' | '\t'..='\r')
}

/// Length of the longest beginning of `word` that is a number. Hexadecimal ones, which C would take too, are read up to
/// the `x`.
fn number_length(word: &str) -> usize {
    let ends = (1..=word.len().min(MAX_NUMBER_LENGTH)).rev();
    let is_number = |end: &usize| word.get(..*end).is_some_and(|start| start.parse::<f64>().is_ok());
    ends.into_iter().find(is_number).unwrap_or(0)
}

/// Length of the longest beginning of `word` that is a whole number.
fn whole_number_length(word: &str) -> usize {
    let sign = usize::from(word.starts_with(['+', '-']));
    let digits = word[sign..].bytes().take_while(u8::is_ascii_digit).count();
    if digits == 0 { 0 } else { sign + digits }
}

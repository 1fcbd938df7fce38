//! The file as `fscanf` sees it: words and numbers one after another, whatever the lines.

use farsight_core::ObjectClass;

use super::{DevkitRow, DevkitRows, Diagnostic};
use crate::kitti::fields::{COLUMNS, Row, RowKind};

/// Column of the occlusion, the only whole number.
const OCCLUSION: usize = 2;

/// No number is written with more letters; keeps a file of one endless word from taking endless time.
const MAX_NUMBER_LENGTH: usize = 400;

/// Letters of a word that go into a message.
const SHOWN: usize = 60;

/// The part of a file that is not read yet.
pub(super) struct Stream<'a> {
    rest: &'a str,
    line: usize,
    /// Whether nothing but blanks stands before the rest on its line. Looking back for that would take endless time on
    /// one endless line.
    starts_line: bool,
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
        Self { rest: text, line, starts_line: true }
    }

    /// Reads rows, at least one, until the next starts a line: there the devkit is where it is at the start of a file.
    /// Returns what is left, and the number of that line.
    pub(super) fn read(mut self, kind: RowKind, read: &mut DevkitRows) -> (&'a str, usize) {
        // Whether the last row read was whole, and the line where it ended.
        let mut whole_row_end = None;
        self.skip_blanks();
        loop {
            let line = self.line;
            match self.row(kind, read) {
                Outcome::End => return ("", self.line),
                Outcome::Row(row) => {
                    if self.line != line {
                        read.tell(line, Diagnostic::SplitRow);
                    }
                    read.push(row);
                    whole_row_end = Some(self.line);
                }
                Outcome::Broken(Diagnostic::DroppedRow { fields, .. }) if whole_row_end == Some(line) => {
                    // The devkit takes what follows a whole row for a new one and gives it up at the next class name.
                    read.tell(line, Diagnostic::ExtraFields { extra: fields, expected: kind.columns() });
                    whole_row_end = None;
                }
                Outcome::Broken(diagnostic) => {
                    read.tell(line, diagnostic);
                    whole_row_end = None;
                }
            }
            self.skip_blanks();
            if self.starts_line {
                return (self.rest, self.line);
            }
        }
    }

    fn row(&mut self, kind: RowKind, read: &mut DevkitRows) -> Outcome {
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
                let found = shortened(word);
                self.skip_line();
                return Outcome::Broken(Diagnostic::FractionalOcclusion { found });
            }
            let Ok(number) = word[..length].parse() else {
                let dropped =
                    Diagnostic::DroppedRow { fields: column, name, found: shortened(word), expected: kind.columns() };
                return Outcome::Broken(dropped);
            };
            if length < word.len() {
                let rest = shortened(&word[length..]);
                read.tell(self.line, Diagnostic::PartialNumber { number: column + 1, name, rest });
            }
            partial.numbers[column] = number;
            self.take(length);
        }
        Outcome::Row(DevkitRow { line: start, row: partial.row(kind), range_sigma_m: None })
    }

    fn skip_blanks(&mut self) {
        let blanks = self.rest.len() - self.rest.trim_start_matches(is_blank).len();
        let lines = self.rest[..blanks].matches('\n').count();
        self.line += lines;
        self.starts_line |= lines > 0;
        self.rest = &self.rest[blanks..];
    }

    /// Not what the devkit does, but after a fatal row its reading means nothing; the next line may.
    fn skip_line(&mut self) {
        self.rest = self.rest.split_once('\n').map_or("", |(_, rest)| rest);
        self.line += 1;
        self.starts_line = true;
    }

    /// Takes so many bytes of the next word.
    fn take(&mut self, length: usize) {
        self.rest = &self.rest[length..];
        self.starts_line = false;
    }

    /// The next word, without taking it.
    fn peek(&self) -> &'a str {
        self.rest.split(is_blank).next().unwrap_or_default()
    }

    fn word(&mut self) -> &'a str {
        self.skip_blanks();
        let word = self.peek();
        self.take(word.len());
        word
    }
}

impl Partial {
    fn row(self, kind: RowKind) -> Row {
        Row::from_numbers(ObjectClass::from_name(&self.class), &self.numbers, kind)
    }
}

/// A stranger's word as far as it goes into a message.
fn shortened(word: &str) -> String {
    word.chars().take(SHOWN).collect()
}

/// White space as C counts it.
fn is_blank(c: char) -> bool {
    matches!(c, ' ' | '\t'..='\r')
}

/// Length of the longest beginning of `word` that is a number. Hexadecimal ones, which C would take too, are read up to
/// the `x`.
fn number_length(word: &str) -> usize {
    let sign = usize::from(word.starts_with(['+', '-']));
    let unsigned = &word.as_bytes()[sign..word.len().min(MAX_NUMBER_LENGTH).max(sign)];
    let length = WORDS
        .iter()
        .find(|name| starts_with(unsigned, name))
        .map_or_else(|| decimal_length(unsigned), |name| name.len());
    if length == 0 { 0 } else { sign + length }
}

/// Numbers that are written as words; the longer ones first.
const WORDS: [&str; 3] = ["infinity", "inf", "nan"];

/// Whether `bytes` begin with `name`, in whatever case.
fn starts_with(bytes: &[u8], name: &str) -> bool {
    bytes.get(..name.len()).is_some_and(|start| start.eq_ignore_ascii_case(name.as_bytes()))
}

/// Length of the longest beginning of `bytes` that is a number without sign: digits with or without a point among or
/// beside them, and an exponent.
fn decimal_length(bytes: &[u8]) -> usize {
    let digits = |from: usize| bytes[from..].iter().take_while(|byte| byte.is_ascii_digit()).count();
    let whole = digits(0);
    let has_point = bytes.get(whole) == Some(&b'.');
    let fraction = if has_point { digits(whole + 1) } else { 0 };
    if whole + fraction == 0 {
        return 0;
    }
    let mantissa = whole + usize::from(has_point) + fraction;
    if !bytes.get(mantissa).is_some_and(|byte| byte.eq_ignore_ascii_case(&b'e')) {
        return mantissa;
    }
    let sign = usize::from(bytes.get(mantissa + 1).is_some_and(|byte| b"+-".contains(byte)));
    match bytes.get(mantissa + 1 + sign..).map_or(0, |_| digits(mantissa + 1 + sign)) {
        0 => mantissa,
        exponent => mantissa + 1 + sign + exponent,
    }
}

/// Length of the longest beginning of `word` that is a whole number.
fn whole_number_length(word: &str) -> usize {
    let sign = usize::from(word.starts_with(['+', '-']));
    let digits = word[sign..].bytes().take_while(u8::is_ascii_digit).count();
    if digits == 0 { 0 } else { sign + digits }
}

#[cfg(test)]
mod tests {
    use super::{MAX_NUMBER_LENGTH, number_length};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_longest_beginning_that_is_a_number(word in "[-+.0-9eEinfatyx]{0,12}|[-+]?[0-9]{0,4}[.]?[0-9]{0,4}[eE]?[-+]?[0-9]{0,3}[a-z\u{e9}]{0,2}") {
            let ends = (1..=word.len().min(MAX_NUMBER_LENGTH)).rev();
            let is_number = |end: &usize| word.get(..*end).is_some_and(|start| start.parse::<f64>().is_ok());
            prop_assert_eq!(number_length(&word), ends.into_iter().find(is_number).unwrap_or(0), "{}", word);
        }
    }
}

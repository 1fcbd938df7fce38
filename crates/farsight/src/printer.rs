//! The only place that prints: results to standard output, everything about them to standard error.

use std::env;
use std::io::{self, ErrorKind, IsTerminal, Write};
use std::sync::atomic::{AtomicU8, Ordering};

use anyhow::{Context, Result};
use clap::ValueEnum;
use indicatif::ProgressBar;

/// What of all that is about the results is printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, ValueEnum)]
pub(crate) enum LogLevel {
    /// What failed
    Error,
    /// And what is probably not as wanted
    Warn,
    /// And what is worth knowing: notes, progress, a summary
    #[default]
    Info,
}

/// The level of this process, as its number; bars of progress know it without a printer.
static LEVEL: AtomicU8 = AtomicU8::new(LogLevel::Info as u8);

/// Sets the level of this process.
pub(crate) fn set_log_level(level: LogLevel) {
    LEVEL.store(level as u8, Ordering::Relaxed);
}

fn is_printed(level: LogLevel) -> bool {
    level as u8 <= LEVEL.load(Ordering::Relaxed)
}

/// A bar on the terminal, where progress is told at all.
pub(crate) fn progress_bar(length: usize) -> ProgressBar {
    if is_printed(LogLevel::Info) { ProgressBar::new(length as u64) } else { ProgressBar::hidden() }
}

/// Writes lines; styled on a terminal, plain elsewhere.
pub(crate) struct Printer {
    out: Stream,
    err: Stream,
}

struct Stream {
    writer: Box<dyn Write>,
    styled: bool,
    /// Why there are no more lines.
    failure: Option<io::Error>,
}

/// How a piece of text stands out: the parameters of an ANSI escape sequence.
#[derive(Debug, Clone, Copy)]
enum Style {
    Bold,
    Red,
    Yellow,
    Cyan,
}

impl Printer {
    /// Prints to this process's own streams.
    pub(crate) fn new() -> Self {
        // https://no-color.org
        let colors = env::var_os("NO_COLOR").is_none_or(|value| value.is_empty());
        Self {
            out: Stream::new(Box::new(io::stdout()), colors && io::stdout().is_terminal()),
            err: Stream::new(Box::new(io::stderr()), colors && io::stderr().is_terminal()),
        }
    }

    /// Prints to these writers, plain.
    #[cfg(test)]
    pub(crate) fn to(out: Box<dyn Write>, err: Box<dyn Write>) -> Self {
        Self { out: Stream::new(out, false), err: Stream::new(err, false) }
    }

    /// Whether whoever read the results has gone away (`farsight range ... | head`) and wants no more of them.
    pub(crate) fn reader_is_gone(&self) -> bool {
        self.out.failure.as_ref().is_some_and(|failure| failure.kind() == ErrorKind::BrokenPipe)
    }

    /// Whether all results were printed, as far as somebody wanted them; what is about them may get lost.
    pub(crate) fn finish(&mut self) -> Result<()> {
        self.out.try_to(|writer| writer.flush());
        match self.out.failure.take() {
            Some(failure) if failure.kind() != ErrorKind::BrokenPipe => {
                Err(failure).context("standard output: cannot be written")
            }
            _ => Ok(()),
        }
    }

    /// A line of the result.
    pub(crate) fn line(&mut self, text: &str) {
        self.out.line(text);
    }

    /// A piece of the result, as it is.
    pub(crate) fn text(&mut self, text: &str) {
        self.out.try_to(|writer| writer.write_all(text.as_bytes()));
    }

    /// Hands on what was printed, so that whoever reads it can follow.
    pub(crate) fn flush(&mut self) {
        self.out.try_to(|writer| writer.flush());
    }

    /// The heading of a result.
    pub(crate) fn heading(&mut self, text: &str) {
        let heading = self.out.styled(text, Style::Bold);
        self.out.line(&heading);
    }

    /// Something worth knowing.
    pub(crate) fn note(&mut self, text: &str) {
        if is_printed(LogLevel::Info) {
            self.labelled("note", Style::Cyan, text);
        }
    }

    /// Something that is probably not as wanted.
    pub(crate) fn warning(&mut self, text: &str) {
        if is_printed(LogLevel::Warn) {
            self.labelled("warning", Style::Yellow, text);
        }
    }

    /// Something that failed.
    pub(crate) fn error(&mut self, text: &str) {
        self.labelled("error", Style::Red, text);
    }

    /// An error with its causes.
    pub(crate) fn failure(&mut self, error: &anyhow::Error) {
        self.error(&with_causes(error));
    }

    /// What was done.
    pub(crate) fn status(&mut self, text: &str) {
        if is_printed(LogLevel::Info) {
            self.err.line(text);
        }
    }

    fn labelled(&mut self, label: &str, style: Style, text: &str) {
        let label = self.err.styled(&format!("{label}:"), style);
        self.err.line(&format!("{label} {}", shortened(text)));
    }
}

impl Stream {
    fn new(writer: Box<dyn Write>, styled: bool) -> Self {
        Self { writer, styled, failure: None }
    }

    fn line(&mut self, text: &str) {
        self.try_to(|writer| writeln!(writer, "{text}"));
    }

    /// Nothing more is tried after a failure: a line that came through behind a lost one would hide it.
    fn try_to(&mut self, step: impl FnOnce(&mut dyn Write) -> io::Result<()>) {
        if self.failure.is_none() {
            self.failure = step(&mut *self.writer).err();
        }
    }

    fn styled(&self, text: &str, style: Style) -> String {
        let code = match style {
            Style::Bold => "1",
            Style::Red => "1;31",
            Style::Yellow => "1;33",
            Style::Cyan => "1;36",
        };
        if self.styled { format!("\x1b[{code}m{text}\x1b[0m") } else { text.to_owned() }
    }
}

/// No line of a message is longer, characters, whatever word of a stranger's file it tells; where it is cut it keeps so
/// many at its end.
const MAX_LINE: usize = 1000;
const KEPT_AT_END: usize = 300;

/// A message whose long lines are cut in the middle.
fn shortened(text: &str) -> String {
    let short = |line: &str| {
        let count = line.chars().count();
        if count <= MAX_LINE {
            return line.to_owned();
        }
        let start: String = line.chars().take(MAX_LINE - KEPT_AT_END).collect();
        let end: String = line.chars().skip(count - KEPT_AT_END).collect();
        format!("{start} [{} characters] {end}", count - MAX_LINE)
    };
    text.split('\n').map(short).collect::<Vec<_>>().join("\n")
}

/// `1 image`, `2 images`.
pub(crate) fn counted(count: usize, what: &str) -> String {
    if count == 1 { format!("1 {what}") } else { format!("{count} {what}s") }
}

/// The error and its causes in one line; a cause that the text before it tells already is not told again.
fn with_causes(error: &anyhow::Error) -> String {
    error.chain().map(ToString::to_string).fold(String::new(), |text, cause| match text.as_str() {
        "" => cause,
        told if told.contains(&cause) => text,
        told => format!("{told}: {cause}"),
    })
}

/// `19510976` as `19,510,976`.
pub(crate) fn grouped(number: usize) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use std::io::{self, ErrorKind, Write};

    use anyhow::{Context, Error};

    use super::{Printer, grouped, shortened, with_causes};

    /// Takes the first so many writes.
    struct Full(usize, ErrorKind);

    impl Write for Full {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0 = self.0.checked_sub(1).ok_or(self.1)?;
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn results_that_cannot_be_printed_are_an_error_unless_nobody_reads_them() {
        let ended = |room, kind| {
            let mut printer = Printer::to(Box::new(Full(room, kind)), Box::new(Full(0, ErrorKind::Other)));
            printer.note("lost, and no matter");
            (0..3).for_each(|_| printer.line("a result"));
            (printer.reader_is_gone(), printer.finish().map_err(|error| with_causes(&error)))
        };
        assert_eq!(ended(99, ErrorKind::Other), (false, Ok(())));
        assert_eq!(ended(1, ErrorKind::BrokenPipe), (true, Ok(())));
        let told = "standard output: cannot be written: no storage space".to_owned();
        assert_eq!(ended(1, ErrorKind::StorageFull), (false, Err(told)));
    }

    #[test]
    fn a_message_is_no_longer_than_anybody_reads() {
        let usual = "a.txt:3: \"ä\"; expected a number\n  of metres";
        assert_eq!(shortened(usual), usual);
        let told = shortened(&format!("a.txt:3: \"{}\"; expected a number\nhint", "ä".repeat(10_000_000)));
        assert_eq!(told.lines().count(), 2);
        assert!(told.starts_with("a.txt:3: \"ä") && told.ends_with("ä\"; expected a number\nhint"), "{told}");
        assert!(told.contains(" [9999030 characters] ") && told.chars().count() < 1100, "{told}");
    }

    #[test]
    fn causes_are_told_once() {
        let cause = || Error::from(io::Error::other("disk on fire"));
        assert_eq!(with_causes(&cause()), "disk on fire");
        assert_eq!(with_causes(&cause().context("a.txt")), "a.txt: disk on fire");
        let embedded: anyhow::Result<()> = Err(cause()).context("a.txt: disk on fire").context("while cleaning");
        assert_eq!(with_causes(&embedded.unwrap_err()), "while cleaning: a.txt: disk on fire");
    }

    #[test]
    fn digits_are_grouped() {
        let table = [(0, "0"), (999, "999"), (1000, "1,000"), (19_510_976, "19,510,976")];
        for (number, expected) in table {
            assert_eq!(grouped(number), expected);
        }
    }
}

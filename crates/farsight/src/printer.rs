//! The only place that prints: results to standard output, everything about them to standard error.

use std::env;
use std::io::{self, IsTerminal, Write};

/// Writes lines; styled on a terminal, plain elsewhere.
pub(crate) struct Printer {
    out: Stream,
    err: Stream,
}

struct Stream {
    writer: Box<dyn Write>,
    styled: bool,
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
            out: Stream { styled: colors && io::stdout().is_terminal(), writer: Box::new(io::stdout()) },
            err: Stream { styled: colors && io::stderr().is_terminal(), writer: Box::new(io::stderr()) },
        }
    }

    /// Prints to these writers, plain.
    #[cfg(test)]
    pub(crate) fn to(out: Box<dyn Write>, err: Box<dyn Write>) -> Self {
        Self { out: Stream { writer: out, styled: false }, err: Stream { writer: err, styled: false } }
    }

    /// A line of the result.
    pub(crate) fn line(&mut self, text: &str) {
        self.out.line(text);
    }

    /// The heading of a result.
    pub(crate) fn heading(&mut self, text: &str) {
        let heading = self.out.styled(text, Style::Bold);
        self.out.line(&heading);
    }

    /// Something worth knowing.
    pub(crate) fn note(&mut self, text: &str) {
        self.labelled("note", Style::Cyan, text);
    }

    /// Something that is probably not as wanted.
    pub(crate) fn warning(&mut self, text: &str) {
        self.labelled("warning", Style::Yellow, text);
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
        self.err.line(text);
    }

    fn labelled(&mut self, label: &str, style: Style, text: &str) {
        let label = self.err.styled(&format!("{label}:"), style);
        self.err.line(&format!("{label} {text}"));
    }
}

impl Stream {
    fn line(&mut self, text: &str) {
        // A reader that has gone away (`farsight range ... | head`) wants no more lines, and needs no message.
        let _ = writeln!(self.writer, "{text}");
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

/// The error and its causes in one line; a cause that the text before it tells already is not told again.
fn with_causes(error: &anyhow::Error) -> String {
    error.chain().map(ToString::to_string).fold(String::new(), |text, cause| match text.as_str() {
        "" => cause,
        told if told.contains(&cause) => text,
        told => format!("{told}: {cause}"),
    })
}

#[cfg(test)]
mod tests {
    use std::io;

    use anyhow::{Context, Error};

    use super::with_causes;

    #[test]
    fn causes_are_told_once() {
        let cause = || Error::from(io::Error::other("disk on fire"));
        assert_eq!(with_causes(&cause()), "disk on fire");
        assert_eq!(with_causes(&cause().context("a.txt")), "a.txt: disk on fire");
        let embedded: anyhow::Result<()> = Err(cause()).context("a.txt: disk on fire").context("while cleaning");
        assert_eq!(with_causes(&embedded.unwrap_err()), "while cleaning: a.txt: disk on fire");
    }
}

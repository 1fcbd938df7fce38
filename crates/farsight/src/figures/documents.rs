//! Figures in documents: blocks between marks, made of the JSON file that the opening mark names.
//!
//! ```text
//! <!-- figures: results/farsight-s.json table=operating sets=photographs64 scores=0.5 -->
//! (rows of a Markdown table)
//! <!-- /figures -->
//! ```
//!
//! The file's path is relative to the document, as that of a link is. A table of an experiment also names its plan,
//! `experiment=../configs/experiments/claim.toml`, and its file is what `farsight experiment run` wrote. `table=whole`
//! is all of a table that was measured (`--table FILE` of several commands), or the `columns=` of it, separated by `|`,
//! with `_` for spaces.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result, anyhow, bail, ensure};
use farsight_files::{MeasuredTable, read_text, write_atomically};

use super::{Figures, tables};
use crate::experiment::{self, tables::PLAN_OPTION};

const OPENING: &str = "<!-- figures: ";
const END_OF_MARK: &str = " -->";
const CLOSING: &str = "<!-- /figures -->";

/// Renews the blocks of the document at `path`; whether it has changed.
pub(crate) fn renew(path: &Path) -> Result<bool> {
    let text = read_text(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    let renewed = renewed(&text, path)?;
    if renewed == text {
        return Ok(false);
    }
    write_atomically(path, |file| file.write_all(renewed.as_bytes()))?;
    Ok(true)
}

/// `text` of the document at `path` with what its figures are now.
fn renewed(text: &str, path: &Path) -> Result<String> {
    let mut out = String::with_capacity(text.len());
    let mut lines = text.split_inclusive('\n').enumerate();
    while let Some((number, line)) = lines.next() {
        let place = || format!("{}:{}", path.display(), number + 1);
        out.push_str(line);
        ensure!(line.trim_end() != CLOSING, "{}: {CLOSING} without a mark that opens it", place());
        let Some(mark) = line.trim_end().strip_prefix(OPENING) else { continue };
        let mark = mark.strip_suffix(END_OF_MARK);
        let mark = mark.with_context(|| format!("{}: expected {END_OF_MARK} at the end of the line", place()))?;
        for row in rows(mark, path).with_context(place)? {
            out.push_str(&row);
            out.push('\n');
        }
        let closing = lines.find(|(_, line)| line.trim_end() == CLOSING || line.starts_with(OPENING));
        match closing {
            Some((_, line)) if line.trim_end() == CLOSING => out.push_str(line),
            _ => bail!("{}: expected {CLOSING} after it", place()),
        }
    }
    Ok(out)
}

/// The rows that a mark asks for.
fn rows(mark: &str, document: &Path) -> Result<Vec<String>> {
    let mut words = mark.split_whitespace();
    let file = words.next().context("expected a JSON file that `farsight measure` wrote")?;
    let mut options = BTreeMap::new();
    for word in words {
        let (name, value) = word.split_once('=').with_context(|| format!("\"{word}\"; expected NAME=VALUE"))?;
        ensure!(options.insert(name, value).is_none(), "{name} is there twice");
    }
    let folder = document.parent().unwrap_or(Path::new(""));
    if options.contains_key(PLAN_OPTION) {
        return experiment::tables::rows(&folder.join(file), folder, options);
    }
    if options.get("table") == Some(&"whole") {
        return whole(&MeasuredTable::read(&folder.join(file))?, options);
    }
    tables::rows(&Figures::read(&folder.join(file))?, options)
}

/// The rows of a table that was measured.
fn whole(measured: &MeasuredTable, mut options: BTreeMap<&str, &str>) -> Result<Vec<String>> {
    options.remove("table");
    let columns: Vec<String> = match options.remove("columns") {
        Some(names) => names.split('|').map(|name| name.replace('_', " ")).collect(),
        None => measured.columns.clone(),
    };
    ensure!(options.is_empty(), "unknown {:?}; expected columns", options.keys());
    let columns: Vec<&str> = columns.iter().map(String::as_str).collect();
    let known = || measured.columns.join(", ");
    measured.markdown(&columns).map_err(|name| anyhow!("no column \"{name}\"; expected of {}", known()))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use farsight_files::MeasuredTable;

    use super::renewed;

    fn problem(text: &str) -> String {
        format!("{:#}", renewed(text, Path::new("page.md")).unwrap_err())
    }

    #[test]
    fn text_without_marks_stays() {
        for text in ["", "one\n", "no line end", "a <!-- comment -->\r\n\n"] {
            assert_eq!(renewed(text, Path::new("page.md")).unwrap(), text);
        }
    }

    #[test]
    fn tables_that_were_measured_are_quoted_whole_or_in_part() {
        let folder = tempfile::tempdir().unwrap();
        let mut table = MeasuredTable::new("farsight bench", ["engine", "one image, ms"]);
        table.put(["rten".into(), "12".into()]);
        table.write(&folder.path().join("bench.json")).unwrap();
        let quoted = |options: &str| {
            let text = format!("<!-- figures: bench.json table=whole{options} -->\nold\n<!-- /figures -->\n");
            renewed(&text, &folder.path().join("page.md"))
        };
        assert!(quoted("").unwrap().contains("-->\n| engine | one image, ms |\n|---|---:|\n| rten | 12 |\n<!--"));
        assert!(quoted(" columns=one_image,_ms|engine").unwrap().contains("\n| 12 | rten |\n"));
        let told = format!("{:#}", quoted(" columns=none").unwrap_err());
        assert!(told.ends_with("no column \"none\"; expected of engine, one image, ms"), "{told}");
    }

    #[test]
    fn marks_that_are_wrong_are_told_with_their_line() {
        let table = [
            ("a\n<!-- /figures -->\n", "page.md:2: <!-- /figures --> without a mark that opens it"),
            ("<!-- figures: a.json table=ap\n", "page.md:1: expected  --> at the end of the line"),
            ("<!-- figures: a.json ap -->\n", "page.md:1: \"ap\"; expected NAME=VALUE"),
            ("<!-- figures: a.json sets=a sets=b -->\n", "page.md:1: sets is there twice"),
        ];
        for (text, expected) in table {
            assert_eq!(problem(text), expected);
        }
        assert!(problem("<!-- figures: none.json table=ap -->\n").starts_with("page.md:1: none.json: cannot be read"));
    }
}

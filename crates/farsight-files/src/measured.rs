//! Tables that programs measure, kept in files that documents quote.

use std::io;
use std::path::{Path, PathBuf};
use std::thread::available_parallelism;
use std::time::{SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::{WriteError, read_text, write_atomically};

/// A table as its file has it (JSON): cells of text, and what is needed to measure them anew.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeasuredTable {
    /// The command that measures it.
    pub command: String,
    /// The CPU that did, as [`machine`] says it.
    pub machine: String,
    /// Year, month and day, UTC.
    pub date: String,
    /// Headings.
    pub columns: Vec<String>,
    /// As many cells each as there are columns.
    pub rows: Vec<Vec<String>>,
}

/// A file of a table that cannot be used.
#[derive(Debug, Error)]
pub enum TableError {
    /// It cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// It is something else.
    #[error("{}: not a table that was measured: {source}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: serde_json::Error,
    },
    /// A row is shorter or longer than the heading.
    #[error("{}: row {row} has {found} cells; expected {expected}", path.display())]
    Row {
        /// The file.
        path: PathBuf,
        /// Its number, from 1.
        row: usize,
        /// Its cells.
        found: usize,
        /// Those of the heading.
        expected: usize,
    },
    /// Rows were to be put into another table.
    #[error("{}: a table of other columns; expected {expected}", path.display())]
    Columns {
        /// The file.
        path: PathBuf,
        /// The columns that the rows have.
        expected: String,
    },
}

impl MeasuredTable {
    /// A table of today and of this machine, without rows.
    pub fn new<const N: usize>(command: &str, columns: [&str; N]) -> Self {
        let columns = columns.map(str::to_owned).to_vec();
        Self { command: command.to_owned(), machine: machine(), date: today(), columns, rows: Vec::new() }
    }

    /// Adds a row, in place of one whose first cell is the same.
    pub fn put<const N: usize>(&mut self, row: [String; N]) {
        let row = Vec::from(row);
        match self.rows.iter_mut().find(|other| other.first() == row.first()) {
            Some(other) => *other = row,
            None => self.rows.push(row),
        }
    }

    /// The table in the file at `path`, to put rows into; one without rows where there is no file.
    ///
    /// # Errors
    /// When the file cannot be read, or has no such table or one with other columns.
    pub fn read_or_new<const N: usize>(path: &Path, command: &str, columns: [&str; N]) -> Result<Self, TableError> {
        if !path.exists() {
            return Ok(Self::new(command, columns));
        }
        let table = Self::read(path)?;
        if table.columns == columns {
            Ok(table)
        } else {
            Err(TableError::Columns { path: path.to_owned(), expected: columns.join(", ") })
        }
    }

    /// The table in the file at `path`.
    ///
    /// # Errors
    /// When the file cannot be read or has no such table.
    pub fn read(path: &Path) -> Result<Self, TableError> {
        let text = read_text(path).map_err(|source| TableError::Unreadable { path: path.to_owned(), source })?;
        let malformed = |source| TableError::Malformed { path: path.to_owned(), source };
        let table: Self = serde_json::from_str(&text).map_err(malformed)?;
        let expected = table.columns.len();
        match table.rows.iter().position(|row| row.len() != expected) {
            None => Ok(table),
            Some(row) => {
                let found = table.rows[row].len();
                Err(TableError::Row { path: path.to_owned(), row: row + 1, found, expected })
            }
        }
    }

    /// Writes it to `path`, whole or not at all, a row a line.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), WriteError> {
        write_atomically(path, |file| {
            let text = |value: &str| serde_json::to_string(value);
            let Self { command, machine, date, columns, rows } = self;
            writeln!(file, "{{\n  \"command\": {},\n  \"machine\": {},", text(command)?, text(machine)?)?;
            writeln!(file, "  \"date\": {},\n  \"columns\": {},", text(date)?, serde_json::to_string(columns)?)?;
            write!(file, "  \"rows\": [")?;
            for (i, row) in rows.iter().enumerate() {
                write!(file, "{}    {}", if i == 0 { "\n" } else { ",\n" }, serde_json::to_string(row)?)?;
            }
            writeln!(file, "\n  ]\n}}")
        })
    }

    /// The lines of the table in Markdown, with these columns. What looks like figures stands on the right.
    ///
    /// # Errors
    /// The name of a column that is not there.
    pub fn markdown<'a>(&self, columns: &[&'a str]) -> Result<Vec<String>, &'a str> {
        let place = |name: &&'a str| self.columns.iter().position(|column| column == name).ok_or(*name);
        let places: Vec<usize> = columns.iter().map(place).collect::<Result<_, _>>()?;
        let chosen = |cells: &Vec<String>| places.iter().map(|&place| cells[place].clone()).collect();
        let rows: Vec<Vec<String>> = self.rows.iter().map(chosen).collect();
        let is_figure =
            |cell: &String| cell.is_empty() || cell.starts_with(|c: char| c.is_ascii_digit() || "+-<".contains(c));
        Ok(markdown_table(columns, &rows, |column| rows.iter().all(|row| is_figure(&row[column]))))
    }
}

/// The lines of a table in Markdown. `is_right` tells which columns stand on the right.
pub fn markdown_table<T: AsRef<str>>(
    heading: &[T],
    rows: &[Vec<String>],
    is_right: impl Fn(usize) -> bool,
) -> Vec<String> {
    let line = |cells: Vec<&str>| format!("| {} |", cells.join(" | "));
    let rule: String = (0..heading.len()).map(|column| if is_right(column) { "---:|" } else { "---|" }).collect();
    let heading = line(heading.iter().map(AsRef::as_ref).collect());
    let rows = rows.iter().map(|row| line(row.iter().map(String::as_str).collect()));
    [heading, format!("|{rule}")].into_iter().chain(rows).collect()
}

/// This machine's CPU, as Linux calls it, and how many of its threads may be used.
pub fn machine() -> String {
    let threads = available_parallelism().map_or(1, usize::from);
    let known = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = known.lines().find_map(|line| Some(line.strip_prefix("model name")?.split_once(':')?.1.trim()));
    format!("{}, {threads} threads", name.unwrap_or(std::env::consts::ARCH))
}

/// Today's year, month and day, UTC.
pub fn today() -> String {
    let seconds = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    let [year, month, day] = date_of((seconds / 86_400) as i64);
    format!("{year:04}-{month:02}-{day:02}")
}

/// Year, month and day of the Gregorian calendar, so many days after 1 January 1970 (Hinnant's `civil_from_days`).
fn date_of(days: i64) -> [i64; 3] {
    // Years here begin in March, so that the leap day is the last.
    let days = days + 719_468;
    let (era, day_of_era) = (days.div_euclid(146_097), days.rem_euclid(146_097));
    let year_of_era = (day_of_era - day_of_era / 1_460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month + 2) / 5 + 1;
    let month = if month < 10 { month + 3 } else { month - 9 };
    [era * 400 + year_of_era + i64::from(month <= 2), month, day]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_become_dates() {
        let table = [
            (0, [1970, 1, 1]),
            (58, [1970, 2, 28]),
            (59, [1970, 3, 1]),
            (11_016, [2000, 2, 29]),
            (11_017, [2000, 3, 1]),
            (20_453, [2025, 12, 31]),
            (20_454, [2026, 1, 1]),
        ];
        for (days, expected) in table {
            assert_eq!(date_of(days), expected, "{days}");
        }
    }

    #[test]
    fn tables_are_kept_and_become_markdown() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.json");
        let mut table = MeasuredTable::new("farsight bench", ["engine", "one image, ms", "note"]);
        table.put(["rten".into(), "12.5".into(), "a \"b\"".into()]);
        table.put(["openvino".into(), "3".into(), String::new()]);
        table.put(["rten".into(), "12.4".into(), "a".into()]);
        table.write(&path).unwrap();
        assert_eq!(MeasuredTable::read(&path).unwrap(), table);
        let lines = table.markdown(&["engine", "one image, ms"]).unwrap();
        assert_eq!(lines, ["| engine | one image, ms |", "|---|---:|", "| rten | 12.4 |", "| openvino | 3 |"]);
        assert_eq!(table.markdown(&["engine", "none"]), Err("none"));
        let lines = markdown_table(&["a", "b"], &[vec!["1".to_owned(), "x".to_owned()]], |column| column == 1);
        assert_eq!(lines, ["| a | b |", "|---|---:|", "| 1 | x |"]);
    }

    #[test]
    fn rows_are_put_into_a_table_that_is_there() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.json");
        for (name, value) in [("a", "1"), ("b", "2"), ("a", "3")] {
            let mut table = MeasuredTable::read_or_new(&path, "farsight info", ["network", "GMAC"]).unwrap();
            table.put([name.into(), value.into()]);
            table.write(&path).unwrap();
        }
        assert_eq!(MeasuredTable::read(&path).unwrap().rows, [["a", "3"], ["b", "2"]]);
        let other = MeasuredTable::read_or_new(&path, "", ["network"]).unwrap_err().to_string();
        assert!(other.ends_with("table.json: a table of other columns; expected network"), "{other}");
    }

    #[test]
    fn files_that_are_no_tables_are_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.json");
        let told = |text: &str| {
            std::fs::write(&path, text).unwrap();
            MeasuredTable::read(&path).unwrap_err().to_string()
        };
        assert!(told("{}").contains("table.json: not a table that was measured"));
        let short = r#"{"command": "", "machine": "", "date": "", "columns": ["a", "b"], "rows": [["1", "2"], ["3"]]}"#;
        assert!(told(short).ends_with("row 2 has 1 cells; expected 2"));
        assert!(
            MeasuredTable::read(&folder.path().join("none.json")).unwrap_err().to_string().contains("cannot be read")
        );
    }
}

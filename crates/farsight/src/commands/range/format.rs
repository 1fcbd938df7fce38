//! What `farsight range` prints: a table, or JSON for other programs.

use anyhow::Result;
use clap::ValueEnum;
use farsight::DetectedObject;
use farsight::json::ImageRecord;

use crate::json_array::indented;
use crate::printer::Printer;
use crate::range_table::RangeTable;

/// How answers are printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub(super) enum Format {
    /// One row an object, for people
    #[default]
    Table,
    /// One array with an object for each image
    Json,
    /// One line for each image, as soon as it is done
    Jsonl,
}

/// Prints the answers, image by image.
pub(super) struct Answers {
    format: Format,
    table: RangeTable,
    begun: bool,
}

impl Answers {
    /// For images with these names.
    pub(super) fn new(format: Format, names: &[String]) -> Self {
        Self { format, table: RangeTable::new(names), begun: false }
    }

    /// Prints one image.
    pub(super) fn print(
        &mut self,
        name: &str,
        objects: &[DetectedObject],
        record: &ImageRecord,
        printer: &mut Printer,
    ) -> Result<()> {
        match self.format {
            // Where nothing can be done there is no table.
            Format::Table if !self.begun => printer.heading(&self.table.heading()),
            Format::Json => printer.text(if self.begun { ",\n" } else { "[\n" }),
            Format::Table | Format::Jsonl => {}
        }
        match self.format {
            Format::Table => self.table.rows(name, objects).iter().for_each(|row| printer.line(row)),
            Format::Json => {
                let text = serde_json::to_string_pretty(record)?;
                printer.text(&indented(&text));
            }
            Format::Jsonl => printer.line(&serde_json::to_string(record)?),
        }
        self.begun = true;
        printer.flush();
        Ok(())
    }

    /// Prints what follows the last image.
    pub(super) fn finish(&self, printer: &mut Printer) {
        if self.format == Format::Json {
            printer.line(if self.begun { "\n]" } else { "[]" });
        }
    }
}

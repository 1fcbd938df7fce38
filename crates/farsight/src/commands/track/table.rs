//! The table of tracks that is written at the end, one row a track: CSV or Parquet.

use std::fmt::Write as _;
use std::io;
use std::path::Path;
use std::sync::Arc;

use anyhow::Result;
use farsight_files::write_atomically;
use parquet::basic::{LogicalType, Repetition, Type as Physical};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;

/// What a column holds, a row after the other.
pub(super) enum Column {
    Integers(Vec<i64>),
    /// None where it is not known: an empty cell, a null.
    Numbers(Vec<Option<f64>>),
    Words(Vec<String>),
}

/// Named columns of the same length.
pub(super) type Table = Vec<(&'static str, Column)>;

/// Writes Parquet to a file that is called so, and CSV to any other.
pub(super) fn write(path: &Path, table: &Table) -> Result<()> {
    let is_parquet = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("parquet"));
    let bytes = if is_parquet { parquet(table).map_err(io::Error::other)? } else { csv(table).into_bytes() };
    Ok(write_atomically(path, |out| out.write_all(&bytes))?)
}

/// Numbers have three decimals.
fn csv(table: &Table) -> String {
    let names: Vec<&str> = table.iter().map(|(name, _)| *name).collect();
    let mut text = names.join(",") + "\n";
    let rows = table.first().map_or(0, |(_, column)| column.len());
    for row in 0..rows {
        let cells: Vec<String> = table.iter().map(|(_, column)| column.cell(row)).collect();
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{}", cells.join(","));
    }
    text
}

impl Column {
    fn len(&self) -> usize {
        match self {
            Self::Integers(values) => values.len(),
            Self::Numbers(values) => values.len(),
            Self::Words(values) => values.len(),
        }
    }

    fn cell(&self, row: usize) -> String {
        match self {
            Self::Integers(values) => values[row].to_string(),
            Self::Numbers(values) => values[row].map_or_else(String::new, |value| format!("{value:.3}")),
            Self::Words(values) if values[row].contains([',', '"', '\n']) => {
                format!("\"{}\"", values[row].replace('"', "\"\""))
            }
            Self::Words(values) => values[row].clone(),
        }
    }

    fn schema(&self, name: &str) -> Result<Type, ParquetError> {
        let (physical, logical, repetition) = match self {
            Self::Integers(_) => (Physical::INT64, None, Repetition::REQUIRED),
            Self::Numbers(_) => (Physical::DOUBLE, None, Repetition::OPTIONAL),
            Self::Words(_) => (Physical::BYTE_ARRAY, Some(LogicalType::String), Repetition::REQUIRED),
        };
        let builder = Type::primitive_type_builder(name, physical).with_repetition(repetition);
        builder.with_logical_type(logical).build()
    }
}

fn parquet(table: &Table) -> Result<Vec<u8>, ParquetError> {
    let fields = table.iter().map(|(name, column)| Ok(Arc::new(column.schema(name)?)));
    let fields: Vec<Arc<Type>> = fields.collect::<Result<_, ParquetError>>()?;
    let schema = Arc::new(Type::group_type_builder("tracks").with_fields(fields).build()?);
    let mut bytes = Vec::new();
    let mut writer = SerializedFileWriter::new(&mut bytes, schema, Arc::default())?;
    let mut group = writer.next_row_group()?;
    let mut columns = table.iter();
    while let (Some(mut writer), Some((_, column))) = (group.next_column()?, columns.next()) {
        match column {
            Column::Integers(values) => writer.typed::<Int64Type>().write_batch(values, None, None)?,
            Column::Numbers(values) => {
                let known: Vec<f64> = values.iter().copied().flatten().collect();
                let is_known: Vec<i16> = values.iter().map(|value| i16::from(value.is_some())).collect();
                writer.typed::<DoubleType>().write_batch(&known, Some(&is_known), None)?
            }
            Column::Words(values) => {
                let words: Vec<ByteArray> = values.iter().map(|word| ByteArray::from(word.as_str())).collect();
                writer.typed::<ByteArrayType>().write_batch(&words, None, None)?
            }
        };
        writer.close()?;
    }
    group.close()?;
    writer.close()?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use bytes::Bytes;
    use parquet::file::reader::{FileReader, SerializedFileReader};
    use parquet::record::RowAccessor;

    use super::*;

    fn table() -> Table {
        vec![
            ("id", Column::Integers(vec![1, 7])),
            ("class", Column::Words(vec!["Car".to_owned(), "a, \"b\"".to_owned()])),
            ("least_ttc_s", Column::Numbers(vec![None, Some(2.5)])),
        ]
    }

    #[test]
    fn csv_quotes_what_it_must_and_leaves_out_what_is_not_known() {
        assert_eq!(csv(&table()), "id,class,least_ttc_s\n1,Car,\n7,\"a, \"\"b\"\"\",2.500\n");
    }

    #[test]
    fn parquet_says_the_same_again() {
        let reader = SerializedFileReader::new(Bytes::from(parquet(&table()).unwrap())).unwrap();
        let rows: Vec<_> = reader.get_row_iter(None).unwrap().map(Result::unwrap).collect();
        let found: Vec<_> = rows
            .iter()
            .map(|row| (row.get_long(0).unwrap(), row.get_string(1).unwrap().clone(), row.get_double(2).ok()))
            .collect();
        assert_eq!(found, [(1, "Car".to_owned(), None), (7, "a, \"b\"".to_owned(), Some(2.5))]);
    }

    #[test]
    fn no_track_is_an_empty_table() {
        let empty: Table = vec![("id", Column::Integers(vec![])), ("least_ttc_s", Column::Numbers(vec![]))];
        assert_eq!(csv(&empty), "id,least_ttc_s\n");
        let reader = SerializedFileReader::new(Bytes::from(parquet(&empty).unwrap())).unwrap();
        assert_eq!(reader.get_row_iter(None).unwrap().count(), 0);
    }
}

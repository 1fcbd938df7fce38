//! Arrays of JSON, one element a line or several, whose elements stay as they are written.

use std::io::{self, Write};

use serde_json::value::RawValue;

/// The elements of a JSON array as they stand there, without the array's indentation.
pub(crate) fn elements_of(array: &[u8]) -> serde_json::Result<Vec<String>> {
    let elements: Vec<&RawValue> = serde_json::from_slice(array)?;
    Ok(elements.into_iter().map(|element| element.get().replace("\n  ", "\n")).collect())
}

/// JSON as it stands within an array.
pub(crate) fn indented(json: &str) -> String {
    format!("  {}", json.replace('\n', "\n  "))
}

/// Writes pieces of JSON as an array.
pub(crate) fn write_array<'a>(out: &mut dyn Write, elements: impl Iterator<Item = &'a str>) -> io::Result<()> {
    let mut before: &[u8] = b"[\n";
    for element in elements {
        out.write_all(before)?;
        out.write_all(indented(element).as_bytes())?;
        before = b",\n";
    }
    // An array of nothing.
    out.write_all(if before == b"[\n" { b"[]\n" } else { b"\n]\n" })
}

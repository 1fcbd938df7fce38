//! Arrays of JSON, one element a line or several, whose elements stay as they are written.

use std::fmt;
use std::io::{self, Write};

use serde::de::{Deserializer as _, Error as _, SeqAccess, Visitor};
use serde_json::value::RawValue;

/// Files of answers are shorter than this, bytes: those of half a million images of busy streets.
pub(crate) const MAX_ANSWERS: u64 = 1 << 30;

/// Hands the elements of a JSON array to `take` one by one, as they stand there, without the array's indentation. They
/// are kept nowhere: an array of nothing but numbers has as many elements as half its bytes.
///
/// # Errors
/// When it is no array, and where `take` gives up.
pub(crate) fn each_element<E>(array: &[u8], take: impl FnMut(String) -> Result<(), E>) -> serde_json::Result<()> {
    let mut reader = serde_json::Deserializer::from_slice(array);
    reader.deserialize_seq(Elements(take))?;
    reader.end()
}

struct Elements<F>(F);

impl<'de, E, F: FnMut(String) -> Result<(), E>> Visitor<'de> for Elements<F> {
    type Value = ();

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("an array")
    }

    fn visit_seq<A: SeqAccess<'de>>(mut self, mut elements: A) -> Result<(), A::Error> {
        while let Some(element) = elements.next_element::<&RawValue>()? {
            (self.0)(element.get().replace("\n  ", "\n")).map_err(|_| A::Error::custom("refused"))?;
        }
        Ok(())
    }
}

/// JSON as it stands within an array.
pub(crate) fn indented(json: &str) -> String {
    format!("  {}", json.replace('\n', "\n  "))
}

/// An array that is written element by element.
pub(crate) struct ArrayWriter<'a> {
    out: &'a mut dyn Write,
    before: &'static [u8],
}

impl<'a> ArrayWriter<'a> {
    pub(crate) fn new(out: &'a mut dyn Write) -> Self {
        Self { out, before: b"[\n" }
    }

    /// Adds a piece of JSON.
    pub(crate) fn add(&mut self, element: &str) -> io::Result<()> {
        self.out.write_all(self.before)?;
        self.before = b",\n";
        self.out.write_all(indented(element).as_bytes())
    }

    /// Ends the array.
    pub(crate) fn finish(self) -> io::Result<()> {
        // An array of nothing.
        self.out.write_all(if self.before == b"[\n" { b"[]\n" } else { b"\n]\n" })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn elements(text: &str) -> serde_json::Result<Vec<String>> {
        let mut found = Vec::new();
        each_element(text.as_bytes(), |element| {
            found.push(element);
            Ok::<_, ()>(())
        })?;
        Ok(found)
    }

    #[test]
    fn elements_stay_as_they_are_written() {
        let kept = ["1.0e5", "{\n  \"a\": 1.50\n}", "[]"];
        for count in 0..=kept.len() {
            let mut written = Vec::new();
            let mut array = ArrayWriter::new(&mut written);
            kept[..count].iter().for_each(|element| array.add(element).unwrap());
            array.finish().unwrap();
            assert_eq!(elements(std::str::from_utf8(&written).unwrap()).unwrap(), kept[..count]);
        }
        for text in ["", "{}", "[1", "[1] 2", "[1,]"] {
            assert!(elements(text).is_err(), "{text}");
        }
    }

    #[test]
    fn the_first_error_ends_the_reading() {
        let mut seen = 0;
        let told = each_element(b"[1, 2, 3]", |element| {
            seen += 1;
            if element == "2" { Err(()) } else { Ok(()) }
        });
        assert!(told.is_err());
        assert_eq!(seen, 2);
    }
}

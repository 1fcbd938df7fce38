//! Walking through a protobuf message without building it: nothing is copied and nothing grows with what a file claims.

use prost::encoding::{WireType, encode_key, encode_varint};
use thiserror::Error;

/// A protobuf message that is broken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("byte {at}: {problem}")]
pub struct WireError {
    /// Where in the file.
    pub at: usize,
    /// What is wrong there.
    pub problem: &'static str,
}

/// A message: a stretch of the file.
#[derive(Debug, Clone, Copy)]
pub(super) struct Message<'a> {
    bytes: &'a [u8],
    /// Where in the file it begins.
    start: usize,
}

/// One field of a message.
#[derive(Debug, Clone, Copy)]
pub(super) struct Field<'a> {
    pub(super) number: u64,
    /// The whole field as it stands in the file.
    pub(super) raw: &'a [u8],
    pub(super) value: Value<'a>,
}

/// What a field holds.
#[derive(Debug, Clone, Copy)]
pub(super) enum Value<'a> {
    Number(u64),
    Bytes(Message<'a>),
    Fixed,
}

impl<'a> Message<'a> {
    /// A whole file as a message.
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, start: 0 }
    }

    pub(super) fn bytes(self) -> &'a [u8] {
        self.bytes
    }

    /// Its text.
    pub(super) fn text(self) -> Result<&'a str, WireError> {
        std::str::from_utf8(self.bytes).map_err(|_| WireError { at: self.start, problem: "text that is not UTF-8" })
    }

    /// Its fields, one after the other, up to the first that is broken.
    pub(super) fn fields(self) -> Fields<'a> {
        Fields { rest: self.bytes, at: self.start, broken: false }
    }

    /// Packed numbers, up to the first that is broken.
    pub(super) fn varints(self) -> impl Iterator<Item = Result<u64, WireError>> {
        let mut rest = self.fields();
        std::iter::from_fn(move || {
            let number = (!rest.rest.is_empty() && !rest.broken).then(|| rest.varint())?;
            rest.broken = number.is_err();
            Some(number)
        })
    }

    /// The messages, texts or bytes of the fields with this number.
    pub(super) fn all(self, number: u64) -> impl Iterator<Item = Result<Message<'a>, WireError>> {
        self.fields().filter_map(move |field| match field {
            Ok(Field { number: found, value: Value::Bytes(message), .. }) if found == number => Some(Ok(message)),
            Ok(_) => None,
            Err(error) => Some(Err(error)),
        })
    }

    /// The last field with this number (protobuf's rule), when it holds bytes.
    pub(super) fn last(self, number: u64) -> Result<Option<Message<'a>>, WireError> {
        self.all(number).try_fold(None, |_, message| message.map(Some))
    }

    /// The last number in the fields with this number; 0 when there is none (protobuf's default).
    pub(super) fn number(self, number: u64) -> Result<u64, WireError> {
        self.fields().try_fold(0, |last, field| {
            Ok(match field? {
                Field { number: found, value: Value::Number(value), .. } if found == number => value,
                _ => last,
            })
        })
    }
}

/// See [`Message::fields`].
pub(super) struct Fields<'a> {
    rest: &'a [u8],
    at: usize,
    broken: bool,
}

impl<'a> Fields<'a> {
    fn field(&mut self) -> Result<Field<'a>, WireError> {
        let start = self.at;
        let from_here = self.rest;
        let key = self.varint()?;
        if key >> 3 == 0 {
            return Err(WireError { at: start, problem: "a field without a number" });
        }
        let value = match key & 7 {
            0 => Value::Number(self.varint()?),
            1 => self.take(8).map(|_| Value::Fixed)?,
            2 => {
                let length = usize::try_from(self.varint()?).unwrap_or(usize::MAX);
                Value::Bytes(self.take(length)?)
            }
            5 => self.take(4).map(|_| Value::Fixed)?,
            _ => return Err(WireError { at: start, problem: "a field of a kind that ONNX does not have" }),
        };
        Ok(Field { number: key >> 3, raw: &from_here[..self.at - start], value })
    }

    fn take(&mut self, count: usize) -> Result<Message<'a>, WireError> {
        let cut = WireError { at: self.at, problem: "the file ends before the field does" };
        let (taken, rest) = self.rest.split_at_checked(count).ok_or(cut)?;
        let message = Message { bytes: taken, start: self.at };
        self.rest = rest;
        self.at += count;
        Ok(message)
    }

    /// Seven bits a byte, lowest first, at most ten bytes.
    fn varint(&mut self) -> Result<u64, WireError> {
        let start = self.at;
        let mut value = 0;
        for shift in (0..64).step_by(7) {
            let byte = self.take(1)?.bytes[0];
            value |= u64::from(byte & 0x7f) << shift;
            if byte & 0x80 == 0 {
                return Ok(value);
            }
        }
        Err(WireError { at: start, problem: "a number longer than ten bytes" })
    }
}

impl<'a> Iterator for Fields<'a> {
    type Item = Result<Field<'a>, WireError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.rest.is_empty() || self.broken {
            return None;
        }
        let field = self.field();
        self.broken = field.is_err();
        Some(field)
    }
}

/// Appends a field that holds `message`.
pub(super) fn append(bytes: &mut Vec<u8>, number: u64, message: &[u8]) {
    encode_key(number as u32, WireType::LengthDelimited, bytes);
    encode_varint(message.len() as u64, bytes);
    bytes.extend(message);
}

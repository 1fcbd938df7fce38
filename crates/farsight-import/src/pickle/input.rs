//! The bytes of a pickle, read front to back.

use super::PickleError;

/// The stream and the place where the next read starts.
pub(super) struct Input<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Input<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0 }
    }

    /// Bytes read so far.
    pub(super) fn position(&self) -> usize {
        self.at
    }

    pub(super) fn take(&mut self, length: usize) -> Result<&'a [u8], PickleError> {
        let rest = &self.bytes[self.at..];
        let taken = rest.get(..length).ok_or(PickleError::Truncated { at: self.at })?;
        self.at += length;
        Ok(taken)
    }

    pub(super) fn array<const N: usize>(&mut self) -> Result<[u8; N], PickleError> {
        let at = self.at;
        self.take(N)?.try_into().map_err(|_| PickleError::Truncated { at })
    }

    /// An unsigned little-endian number of `N` bytes.
    pub(super) fn unsigned<const N: usize>(&mut self) -> Result<usize, PickleError> {
        let bytes = self.array::<N>()?;
        let number = bytes.iter().rev().fold(0_u64, |number, byte| number << 8 | u64::from(*byte));
        // A length beyond all memory is also beyond the end of the stream.
        Ok(usize::try_from(number).unwrap_or(usize::MAX))
    }

    /// A block whose length stands before it in `N` bytes.
    pub(super) fn block<const N: usize>(&mut self) -> Result<&'a [u8], PickleError> {
        let length = self.unsigned::<N>()?;
        self.take(length)
    }

    /// Text up to the end of the line.
    pub(super) fn line(&mut self) -> Result<&'a [u8], PickleError> {
        let end = self.bytes[self.at..].iter().position(|byte| *byte == b'\n');
        let line = self.take(end.ok_or(PickleError::Truncated { at: self.at })?)?;
        self.at += 1;
        Ok(line)
    }
}

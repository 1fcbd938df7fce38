//! ROS 2's encoding of messages: OMG CDR version 1, little endian.

/// Says what follows: plain CDR, little endian, no options. Alignment counts from behind it.
const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

/// A message being written.
pub(crate) struct Cdr(Vec<u8>);

impl Cdr {
    pub(crate) fn new() -> Self {
        Self(ENCAPSULATION.to_vec())
    }

    /// Numbers lie at multiples of their size.
    fn align(&mut self, size: usize) {
        while !(self.0.len() - ENCAPSULATION.len()).is_multiple_of(size) {
            self.0.push(0);
        }
    }

    pub(crate) fn i32(&mut self, value: i32) {
        self.align(4);
        self.0.extend(value.to_le_bytes());
    }

    pub(crate) fn u32(&mut self, value: u32) {
        self.align(4);
        self.0.extend(value.to_le_bytes());
    }

    /// Numbers of a message or of an array of fixed length, one after the other.
    pub(crate) fn f64s(&mut self, values: &[f64]) {
        for value in values {
            self.align(8);
            self.0.extend(value.to_le_bytes());
        }
    }

    /// The length counts the zero byte at the end.
    pub(crate) fn string(&mut self, text: &str) {
        // A zero byte would end the text early.
        let text = text.replace('\0', "\u{fffd}");
        self.u32(text.len() as u32 + 1);
        self.0.extend(text.as_bytes());
        self.0.push(0);
    }

    pub(crate) fn into_bytes(self) -> Vec<u8> {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::Cdr;

    #[test]
    fn numbers_are_aligned_behind_the_encapsulation() {
        let mut cdr = Cdr::new();
        cdr.string("ab");
        cdr.f64s(&[1.0]);
        cdr.i32(-2);
        // One byte of nothing up to 8, then 1.0, then -2.
        let expected =
            [&[0, 1, 0, 0, 3, 0, 0, 0, b'a', b'b', 0, 0][..], &1.0_f64.to_le_bytes(), &[0xfe, 0xff, 0xff, 0xff]];
        assert_eq!(cdr.into_bytes(), expected.concat());
    }
}

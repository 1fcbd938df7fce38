//! Huffman codes of JPEG, bit by bit.

/// Codes up to this length are looked up at once.
const QUICK_BITS: usize = 9;

/// One table of codes (T.81, annex C).
pub(super) struct Table {
    /// For each beginning of a code: symbol and length; length 0 for codes that are longer.
    quick: [(u8, u8); 1 << QUICK_BITS],
    /// For each length: the first code behind those of this length, and the position of its symbols less its first
    /// code.
    after: [(i32, i32); 17],
    symbols: Vec<u8>,
}

impl Table {
    /// A table from the count of codes of each length and their symbols; `None` when there are more codes than bits for
    /// them.
    pub(super) fn new(counts: &[u8; 16], symbols: &[u8]) -> Option<Self> {
        let mut table = Self { quick: [(0, 0); 1 << QUICK_BITS], after: [(0, 0); 17], symbols: symbols.to_vec() };
        let (mut code, mut position) = (0_usize, 0_usize);
        for (length, &count) in (1..).zip(counts) {
            let first = code;
            for _ in 0..count {
                let symbol = *symbols.get(position)?;
                if length <= QUICK_BITS {
                    let span = 1 << (QUICK_BITS - length);
                    table.quick.get_mut(code * span..(code + 1) * span)?.fill((symbol, length as u8));
                }
                code += 1;
                position += 1;
            }
            if code > 1 << length {
                return None;
            }
            table.after[length] = (code as i32, position as i32 - usize::from(count) as i32 - first as i32);
            code <<= 1;
        }
        Some(table)
    }
}

/// Why reading stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stop {
    /// No more data before the next marker.
    Exhausted,
    /// No such code.
    NoCode,
}

/// Reads entropy-coded data up to the next marker.
pub(super) struct Bits<'a> {
    bytes: &'a [u8],
    position: usize,
    /// The next bits, at the top.
    buffer: u64,
    /// How many of them are data.
    filled: u32,
}

impl<'a> Bits<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, position: 0, buffer: 0, filled: 0 }
    }

    /// Fills the buffer as far as there are data before a marker.
    fn refill(&mut self) {
        while self.filled <= 56 {
            let byte = match self.bytes.get(self.position..) {
                Some([0xFF, 0, ..]) => {
                    self.position += 2;
                    0xFF
                }
                Some([byte, ..]) if *byte != 0xFF => {
                    self.position += 1;
                    *byte
                }
                _ => return,
            };
            self.buffer |= u64::from(byte) << (56 - self.filled);
            self.filled += 8;
        }
    }

    fn take(&mut self, count: u32) -> Result<(), Stop> {
        if self.filled < count {
            return Err(Stop::Exhausted);
        }
        // Never 64: codes have at most 16 bits.
        self.buffer <<= count;
        self.filled -= count;
        Ok(())
    }

    /// The next `count` bits, at most 16, as a number.
    pub(super) fn number(&mut self, count: u32) -> Result<u32, Stop> {
        if count == 0 {
            return Ok(0);
        }
        if self.filled < count {
            self.refill();
        }
        let value = (self.buffer >> (64 - count)) as u32;
        self.take(count).map(|()| value)
    }

    /// Steps over `count` bits.
    pub(super) fn skip(&mut self, count: u32) -> Result<(), Stop> {
        let mut left = count;
        while left > 0 {
            let step = left.min(16);
            self.number(step)?;
            left -= step;
        }
        Ok(())
    }

    /// The next symbol.
    pub(super) fn symbol(&mut self, table: &Table) -> Result<u8, Stop> {
        if self.filled < 16 {
            self.refill();
        }
        let (symbol, length) = table.quick[(self.buffer >> (64 - QUICK_BITS)) as usize];
        if length > 0 {
            return self.take(u32::from(length)).map(|()| symbol);
        }
        for length in QUICK_BITS + 1..=16 {
            let code = (self.buffer >> (64 - length)) as i32;
            let (after, offset) = table.after[length];
            if code < after {
                let symbol = usize::try_from(code + offset).ok().and_then(|position| table.symbols.get(position));
                let symbol = *symbol.ok_or(Stop::NoCode)?;
                return self.take(length as u32).map(|()| symbol);
            }
        }
        Err(if self.filled < 16 { Stop::Exhausted } else { Stop::NoCode })
    }

    /// Goes on behind a restart marker; false when the next marker is none.
    pub(super) fn restart(&mut self) -> bool {
        let at = self.position;
        let Some(marker) = super::next_marker(&self.bytes[at..]) else { return false };
        let is_restart = matches!(self.bytes[at + marker + 1], 0xD0..=0xD7);
        if is_restart {
            *self = Self { bytes: self.bytes, position: at + marker + 2, buffer: 0, filled: 0 };
        }
        is_restart
    }

    /// Whether the data ended at a restart marker.
    pub(super) fn at_restart(&self) -> bool {
        matches!(self.bytes.get(self.position..), Some([0xFF, 0xD0..=0xD7, ..]))
    }

    /// Bytes that were taken; those that are only in the buffer are not counted.
    pub(super) fn used(&self) -> usize {
        // Every byte in the buffer came from one or two of the file; a few too many are no matter.
        self.position - (self.filled / 8) as usize
    }
}

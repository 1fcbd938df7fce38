//! Making strange files of good ones, the same every time.

/// A stream of numbers that follows from its seed (`SplitMix64`).
#[derive(Debug, Clone)]
pub struct Random(u64);

impl Random {
    /// The stream of this seed.
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next number.
    pub fn number(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    /// A number below `end`; 0 where there is none.
    pub fn below(&mut self, end: usize) -> usize {
        if end == 0 { 0 } else { (self.number() % end as u64) as usize }
    }
}

/// No input grows beyond this, bytes.
pub const LARGEST: usize = 1 << 20;

/// Numbers at which programs err, as text.
const WORDS: [&str; 26] = [
    "0",
    "-1",
    "1",
    "nan",
    "inf",
    "-inf",
    "1e300",
    "1e-300",
    "-0.0",
    "4294967296",
    "9223372036854775807",
    "18446744073709551615",
    "2147483648",
    "1073741824",
    "65536",
    "true",
    "null",
    "\"\"",
    "[]",
    "{}",
    "[[",
    "\n",
    " ",
    "\u{0}",
    "#",
    "=",
];

/// A strange relative of one of `inputs`: one to eight changes of bits, bytes, numbers, words and stretches, some of
/// them from another input.
pub fn mutated(inputs: &[Vec<u8>], random: &mut Random) -> Vec<u8> {
    let mut bytes = inputs.get(random.below(inputs.len())).cloned().unwrap_or_default();
    for _ in 0..=random.below(8) {
        let at = random.below(bytes.len() + 1);
        let length = 1 << random.below(8);
        let end = (at + random.below(length)).min(bytes.len());
        match random.below(10) {
            0 | 1 => flip(&mut bytes, at, random),
            2 => overwrite(&mut bytes, at, &[random.number() as u8]),
            3 => {
                let extremes = [0, 1, u64::MAX, 1 << 31, 1 << 30, 1 << 62, 255, random.number()];
                let number = extremes[random.below(extremes.len())].to_le_bytes();
                overwrite(&mut bytes, at, &number[..1 << random.below(4)]);
            }
            4 => drop(bytes.drain(at..end)),
            5 => {
                let again = bytes[at..end].to_vec();
                let times = 1 + random.below(20);
                drop(bytes.splice(at..at, again.repeat(times)));
            }
            6 => drop(bytes.splice(at..at, WORDS[random.below(WORDS.len())].bytes())),
            7 => {
                let word = word_at(&bytes, at);
                drop(bytes.splice(word, WORDS[random.below(WORDS.len())].bytes()));
            }
            8 => {
                let other = &inputs[random.below(inputs.len())];
                let from = random.below(other.len() + 1);
                let to = (from + random.below(256)).min(other.len());
                drop(bytes.splice(at..end, other[from..to].iter().copied()));
            }
            _ => bytes.truncate(at),
        }
        bytes.truncate(LARGEST);
    }
    bytes
}

fn flip(bytes: &mut [u8], at: usize, random: &mut Random) {
    if let Some(byte) = bytes.get_mut(at) {
        *byte ^= 1 << random.below(8);
    }
}

fn overwrite(bytes: &mut [u8], at: usize, with: &[u8]) {
    for (byte, new) in bytes.iter_mut().skip(at).zip(with) {
        *byte = *new;
    }
}

/// The word or number around `at`.
fn word_at(bytes: &[u8], at: usize) -> std::ops::Range<usize> {
    let is_part = |byte: &u8| byte.is_ascii_alphanumeric() || b"+-._".contains(byte);
    let start = at - bytes[..at].iter().rev().take_while(|byte| is_part(byte)).count();
    let end = at + bytes[at..].iter().take_while(|byte| is_part(byte)).count();
    start..end
}

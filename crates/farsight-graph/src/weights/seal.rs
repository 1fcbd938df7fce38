//! The hash that every file of ours carries: a flipped bit is told when the file is read, not by its answers.

use std::collections::BTreeMap;

use sha2::{Digest, Sha256};

use super::hexadecimal;

/// Key of the header under which the hash of everything else in the file stands, hexadecimal.
pub const FILE_SHA256_KEY: &str = "farsight.file_sha256";

/// SHA-256 of what a file says: its free-text facts but the hash itself, then format, shape and bytes of each tensor,
/// all in the order of their names. How the header is laid out plays no part.
pub(super) struct Seal(Sha256);

impl Seal {
    /// Begins with the facts.
    pub(super) fn new(metadata: &BTreeMap<String, String>) -> Self {
        let mut seal = Self(Sha256::new());
        for (key, value) in metadata.iter().filter(|(key, _)| *key != FILE_SHA256_KEY) {
            seal.part(key.as_bytes());
            seal.part(value.as_bytes());
        }
        seal
    }

    /// Goes on with a tensor; they come in the order of their names.
    pub(super) fn tensor(&mut self, name: &str, dtype: &str, shape: &[usize], bytes: &[u8]) {
        self.part(name.as_bytes());
        self.part(format!("{dtype} {shape:?}").as_bytes());
        self.part(bytes);
    }

    /// The hash.
    pub(super) fn finish(self) -> String {
        hexadecimal(&self.0.finalize())
    }

    /// Each part with its length, so that nothing can move from one to the next.
    fn part(&mut self, bytes: &[u8]) {
        self.0.update((bytes.len() as u64).to_le_bytes());
        self.0.update(bytes);
    }
}

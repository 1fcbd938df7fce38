//! What a file is by its first bytes.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// Bytes at the start of a file that are looked at to know what it holds.
const PROBED_BYTES: u64 = 1 << 16;

/// How files begin that are often at hand and are neither models nor calibrations.
const SIGNATURES: [(&[u8], &str); 3] = [
    (b"\x89PNG", "a PNG image"),
    (b"\xff\xd8\xff", "a JPEG image"),
    (b"PK\x03\x04", "a ZIP archive, as PyTorch's checkpoints are, which `farsight import` reads"),
];

/// The first bytes of a file; none where there is no file, or a pipe, which must not be read to look at it.
///
/// # Errors
/// When the file cannot be read.
pub fn start_of(path: &Path) -> io::Result<Vec<u8>> {
    let mut start = Vec::new();
    if path.is_file() {
        File::open(path)?.take(PROBED_BYTES).read_to_end(&mut start)?;
    }
    Ok(start)
}

/// What a file is that begins like this, when it is an image or an archive.
pub fn signature(start: &[u8]) -> Option<&'static str> {
    SIGNATURES.iter().find(|(signature, _)| start.starts_with(signature)).map(|(_, kind)| *kind)
}

//! Whether a shared library is all there. The system maps a library before it looks at it: of a truncated one the first
//! use of what is missing ends the process.

use std::fs::{self, File};
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use thiserror::Error;

/// How an ELF file starts (System V ABI, chapter 4): magic, 64 bits, little-endian.
const MAGIC: [u8; 6] = [0x7f, b'E', b'L', b'F', 2, 1];

/// Bytes of the header of a 64-bit file.
const HEADER_BYTES: usize = 64;

/// Bytes of an entry of the program header table.
const SEGMENT_BYTES: usize = 56;

/// A segment that is loaded.
const PT_LOAD: u32 = 1;

/// A library that is not whole.
#[derive(Debug, Error)]
pub enum LibraryDamage {
    /// It cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The library.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// It ends before its parts do.
    #[error("{}: truncated: {found} bytes; its headers ask for {expected}", path.display())]
    Truncated {
        /// The library.
        path: PathBuf,
        /// Bytes in the file.
        found: u64,
        /// Bytes that it should have, at least.
        expected: u64,
    },
}

/// Refuses a truncated library, and one beside which a truncated one lies: libraries load each other. What is no 64-bit
/// ELF file is left to the system.
///
/// # Errors
/// [`LibraryDamage`] names the file.
pub fn check_whole(library: &Path) -> Result<(), LibraryDamage> {
    check_one(library)?;
    let folder = library.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let Ok(entries) = fs::read_dir(folder) else { return Ok(()) };
    let mut beside: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    beside.retain(|path| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.starts_with("lib") && name.contains(".so") && path.is_file()
    });
    beside.sort();
    beside.iter().try_for_each(|path| check_one(path))
}

fn check_one(path: &Path) -> Result<(), LibraryDamage> {
    let failed = |source| LibraryDamage::Read { path: path.to_owned(), source };
    if !fs::metadata(path).map_err(failed)?.is_file() {
        // A pipe would be waited for.
        return Err(failed(io::Error::other("no regular file")));
    }
    let mut file = File::open(path).map_err(failed)?;
    let found = file.metadata().map_err(failed)?.len();
    let truncated = |expected| LibraryDamage::Truncated { path: path.to_owned(), found, expected };
    let mut header = Vec::new();
    file.by_ref().take(HEADER_BYTES as u64).read_to_end(&mut header).map_err(failed)?;
    if !header.starts_with(&MAGIC) {
        // An empty or very short file is no library of any kind, and the system says so.
        return Ok(());
    }
    if header.len() < HEADER_BYTES {
        return Err(truncated(HEADER_BYTES as u64));
    }
    let (segments_at, sections_at) = (long(&header, 32), long(&header, 40));
    let [segment_bytes, segments, section_bytes, sections] = [54, 56, 58, 60].map(|at| u64::from(short(&header, at)));
    let end_of = |at: u64, bytes: u64, count: u64| at.saturating_add(bytes * count);
    let mut expected = end_of(segments_at, segment_bytes, segments).max(end_of(sections_at, section_bytes, sections));
    if expected <= found && segment_bytes >= SEGMENT_BYTES as u64 {
        file.seek(SeekFrom::Start(segments_at)).map_err(failed)?;
        let mut table = vec![0; (segment_bytes * segments) as usize];
        file.read_exact(&mut table).map_err(failed)?;
        for segment in table.chunks_exact(segment_bytes as usize).filter(|segment| word(segment, 0) == PT_LOAD) {
            expected = expected.max(long(segment, 8).saturating_add(long(segment, 32)));
        }
    }
    if expected <= found { Ok(()) } else { Err(truncated(expected)) }
}

fn short(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

fn word(bytes: &[u8], at: usize) -> u32 {
    u32::from(short(bytes, at)) | u32::from(short(bytes, at + 2)) << 16
}

fn long(bytes: &[u8], at: usize) -> u64 {
    u64::from(word(bytes, at)) | u64::from(word(bytes, at + 4)) << 32
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn a_library_cut_anywhere_is_told() {
        // This test is an ELF file like any library.
        let whole = fs::read(std::env::current_exe().unwrap()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("libwhole.so");
        fs::write(&path, &whole).unwrap();
        check_whole(&path).unwrap();
        let cut = folder.path().join("libcut.so.1");
        for tenths in 1..10 {
            fs::write(&cut, &whole[..whole.len() / 10 * tenths]).unwrap();
            let told = check_whole(&cut).unwrap_err().to_string();
            assert!(told.contains("libcut.so.1: truncated: "), "{told}");
            assert!(check_whole(&path).is_err(), "a library beside it is cut");
        }
        fs::write(&cut, "no library").unwrap();
        check_whole(&cut).unwrap();
    }
}

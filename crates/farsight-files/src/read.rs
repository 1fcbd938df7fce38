//! Reading files of strangers: nothing is waited for, and no more is read than such a file ever has.

use std::fs::{self, File, FileType};
use std::io::{self, Read};
use std::path::Path;

/// Labels, results, calibrations and splits are shorter than this, bytes: a hundred thousand objects in one image.
pub const MAX_TEXT: u64 = 10 << 20;

/// Configs are shorter than this, bytes. TOML takes 70 times its length in memory.
pub const MAX_CONFIG: u64 = 1 << 20;

/// The bytes of a regular file of at most `limit` bytes.
///
/// # Errors
/// When the file cannot be read, is larger, or is a folder, pipe, socket or device: a pipe could be waited for without
/// end.
pub fn read_file(path: &Path, limit: u64) -> io::Result<Vec<u8>> {
    let file = open_regular(path)?;
    let length = file.metadata()?.len();
    check_length(length, limit)?;
    let mut bytes = Vec::with_capacity(usize::try_from(length).unwrap_or(0));
    // A file may grow while it is read.
    file.take(limit.saturating_add(1)).read_to_end(&mut bytes)?;
    check_length(bytes.len() as u64, limit)?;
    Ok(bytes)
}

/// Opens a regular file for reading.
///
/// # Errors
/// When it cannot be opened, or is a folder, pipe, socket or device: opening a pipe waits for its writer.
pub fn open_regular(path: &Path) -> io::Result<File> {
    check_regular(fs::metadata(path)?.file_type())?;
    let file = File::open(path)?;
    // Another file may have taken its name meanwhile.
    check_regular(file.metadata()?.file_type())?;
    Ok(file)
}

/// The text in a regular file of at most [`MAX_TEXT`] bytes.
///
/// # Errors
/// As [`read_file`], and when it is not UTF-8.
pub fn read_text(path: &Path) -> io::Result<String> {
    text_up_to(path, MAX_TEXT)
}

/// The text in a regular file of at most [`MAX_CONFIG`] bytes.
///
/// # Errors
/// As [`read_text`].
pub fn read_config(path: &Path) -> io::Result<String> {
    text_up_to(path, MAX_CONFIG)
}

/// The text in a regular file of at most `limit` bytes.
///
/// # Errors
/// As [`read_text`].
pub fn text_up_to(path: &Path, limit: u64) -> io::Result<String> {
    let bytes = read_file(path, limit)?;
    String::from_utf8(bytes)
        .map_err(|_| io::Error::new(io::ErrorKind::InvalidData, "stream did not contain valid UTF-8"))
}

fn check_regular(kind: FileType) -> io::Result<()> {
    if kind.is_file() {
        return Ok(());
    }
    if kind.is_dir() {
        return Err(io::Error::from(io::ErrorKind::IsADirectory));
    }
    Err(io::Error::other("a pipe, socket or device; expected a file"))
}

fn check_length(found: u64, limit: u64) -> io::Result<()> {
    if found <= limit {
        return Ok(());
    }
    Err(io::Error::new(io::ErrorKind::FileTooLarge, format!("{found} bytes or more; expected at most {limit}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_read_up_to_their_limit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        fs::write(&path, "twelve bytes").unwrap();
        assert_eq!(read_file(&path, 12).unwrap(), b"twelve bytes");
        assert_eq!(read_text(&path).unwrap(), "twelve bytes");
        let told = read_file(&path, 11).unwrap_err().to_string();
        assert_eq!(told, "12 bytes or more; expected at most 11");
        assert_eq!(read_file(folder.path(), 12).unwrap_err().kind(), io::ErrorKind::IsADirectory);
        fs::write(&path, [0xff]).unwrap();
        assert!(read_text(&path).is_err());
        fs::write(&path, vec![b' '; 1 << 20]).unwrap();
        assert!(read_config(&path).is_ok());
        fs::write(&path, vec![b' '; (1 << 20) + 1]).unwrap();
        let told = read_config(&path).unwrap_err().to_string();
        assert_eq!(told, "1048577 bytes or more; expected at most 1048576");
        assert!(read_text(&path).is_ok());
    }

    #[cfg(unix)]
    #[test]
    fn pipes_and_devices_are_refused_and_not_waited_for() {
        let told = |path: &Path| read_file(path, 12).unwrap_err().to_string();
        assert_eq!(told(Path::new("/dev/zero")), "a pipe, socket or device; expected a file");
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        if std::process::Command::new("mkfifo").arg(&pipe).status().is_ok_and(|status| status.success()) {
            assert_eq!(told(&pipe), "a pipe, socket or device; expected a file");
        }
    }
}

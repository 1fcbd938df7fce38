//! Number plates of labelled vehicles: parts of a known size, which say how large a vehicle is. Rendered data sets have them, KITTI does not.
//!
//! A data set keeps them beside its labels, in `plates`: one line for each plate that the image shows, with the place of its vehicle's label in the label
//! file, from 0, and the x, y and z of both ends.

use std::io;
use std::path::{Path, PathBuf};

use farsight_files::write_quickly;
use thiserror::Error;

/// A number plate that an image shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plate {
    /// Place of its vehicle among the labels.
    pub label: usize,
    /// The middles of its right and its left edge as the image shows it, camera coordinates, metres.
    pub ends: [[f64; 3]; 2],
}

/// A file of plates that cannot be used.
#[derive(Debug, Error)]
pub enum PlatesError {
    /// It cannot be read or written.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// A line is none.
    #[error("{}:{line}: expected the place of a label and six numbers", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Its line, from 1.
        line: usize,
    },
}

/// Reads the plates of one frame; none where there is no file.
///
/// # Errors
/// When the file cannot be read or a line is malformed.
pub fn read_plates(path: &Path) -> Result<Vec<Plate>, PlatesError> {
    let text = match std::fs::read_to_string(path) {
        Ok(text) => text,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(source) => return Err(PlatesError::File { path: path.to_owned(), source }),
    };
    let lines = text.lines().zip(1..);
    lines.map(|(text, line)| plate(text).ok_or_else(|| PlatesError::Line { path: path.to_owned(), line })).collect()
}

fn plate(line: &str) -> Option<Plate> {
    let (label, numbers) = line.split_once(' ')?;
    let numbers: Vec<f64> = numbers.split(' ').map(|word| word.parse().ok()).collect::<Option<_>>()?;
    let [ax, ay, az, bx, by, bz] = numbers.try_into().ok()?;
    let ends = [[ax, ay, az], [bx, by, bz]];
    ends.as_flattened().iter().all(|at| f64::is_finite(*at)).then_some(Plate { label: label.parse().ok()?, ends })
}

/// Writes the plates of one frame; the file is there whole or not at all.
///
/// # Errors
/// When the file cannot be written.
pub fn write_plates(path: &Path, plates: &[Plate]) -> Result<(), PlatesError> {
    let row = |Plate { label, ends }: &Plate| {
        let numbers: Vec<String> = ends.as_flattened().iter().map(|at| format!("{at:.4}")).collect();
        format!("{label} {}\n", numbers.join(" "))
    };
    let text = plates.iter().map(row).collect::<Vec<String>>().concat();
    write_quickly(path, |file| file.write_all(text.as_bytes()))
        .map_err(|source| PlatesError::File { path: path.to_owned(), source: io::Error::other(source) })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn plates_come_back_and_what_is_none_is_told_with_its_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("000007.txt");
        assert_eq!(read_plates(&path).unwrap(), []);
        let plates = [0, 3].map(|label| Plate { label, ends: [[-1.25, 1.5, 10.0], [-0.75, 1.5, 10.125]] });
        write_plates(&path, &plates).unwrap();
        assert_eq!(read_plates(&path).unwrap(), plates);
        for line in ["1 2 3", "x 1 1 1 1 1 1", "0 1 1 1 1 1 NaN", "0 1 1 1 1 1 1 1", ""] {
            std::fs::write(&path, format!("0 1 1 1 1 1 1\n{line}\n")).unwrap();
            let told = read_plates(&path).unwrap_err().to_string();
            assert!(told.contains("000007.txt:2: expected the place of a label"), "{line}: {told}");
        }
    }
}

//! Number plates of labelled vehicles: parts of a known size, which say how large a vehicle is. Rendered data sets have
//! them, KITTI does not.
//!
//! In a file, one line for each plate that the image shows: the place of its vehicle's label in the label file, from 0,
//! and the x, y and z of both ends.

use super::{Annotation, FileAnnotation};

/// A number plate that an image shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plate {
    /// Place of its vehicle among the labels.
    pub label: usize,
    /// The middles of its right and its left edge as the image shows it, camera coordinates, metres.
    pub ends: [[f64; 3]; 2],
}

/// The number plates that an image shows.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Plates(pub Vec<Plate>);

impl Annotation for Plates {
    const NAME: &'static str = "plates";
}

impl FileAnnotation for Plates {
    const EXPECTED: &'static str = "the place of a label and six numbers";

    fn from_text(text: &str) -> Result<Self, usize> {
        text.lines().zip(1..).map(|(line, number)| plate(line).ok_or(number)).collect::<Result<_, _>>().map(Self)
    }

    fn to_text(&self) -> String {
        let row = |Plate { label, ends }: &Plate| {
            let numbers: Vec<String> = ends.as_flattened().iter().map(|at| format!("{at:.4}")).collect();
            format!("{label} {}\n", numbers.join(" "))
        };
        self.0.iter().map(row).collect::<Vec<String>>().concat()
    }
}

fn plate(line: &str) -> Option<Plate> {
    let (label, numbers) = line.split_once(' ')?;
    let numbers: Vec<f64> = numbers.split(' ').map(|word| word.parse().ok()).collect::<Option<_>>()?;
    let [ax, ay, az, bx, by, bz] = numbers.try_into().ok()?;
    let ends = [[ax, ay, az], [bx, by, bz]];
    ends.as_flattened().iter().all(|at| f64::is_finite(*at)).then_some(Plate { label: label.parse().ok()?, ends })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::annotations::{Annotations, FileFormat};

    #[test]
    fn plates_come_back_and_a_malformed_line_is_told_with_its_place() {
        let folder = tempfile::tempdir().unwrap();
        let format = FileFormat::of::<Plates>();
        let read = || {
            let mut annotations = Annotations::default();
            format.read(folder.path(), "000007", &mut annotations).map(|()| annotations)
        };
        assert_eq!(read().unwrap().get::<Plates>(), Some(&Plates::default()), "no file");
        std::fs::create_dir(folder.path().join("plates")).unwrap();
        let mut annotations = Annotations::default();
        format.write(folder.path(), "000007", &annotations).unwrap();
        assert!(!format.path(folder.path(), "000007").exists(), "nothing to write");
        annotations.insert(Plates(
            [0, 3].map(|label| Plate { label, ends: [[-1.25, 1.5, 10.0], [-0.75, 1.5, 10.125]] }).into(),
        ));
        format.write(folder.path(), "000007", &annotations).unwrap();
        assert_eq!(read().unwrap(), annotations);
        for line in ["1 2 3", "x 1 1 1 1 1 1", "0 1 1 1 1 1 NaN", "0 1 1 1 1 1 1 1", ""] {
            std::fs::write(format.path(folder.path(), "000007"), format!("0 1 1 1 1 1 1\n{line}\n")).unwrap();
            let told = read().unwrap_err().to_string();
            assert!(told.ends_with("000007.txt:2: expected the place of a label and six numbers"), "{line}: {told}");
        }
    }
}

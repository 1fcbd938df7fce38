//! What a data set's own class names mean.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use farsight_core::ObjectClass;
use thiserror::Error;

/// From a data set's own class names to [`ObjectClass`].
///
/// Names that are not in the map are taken as they are: KITTI's for its classes, others for [`ObjectClass::Other`].
/// Objects of a class that is mapped to [`ObjectClass::DontCare`] are neither learnt nor counted.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct ClassMap(BTreeMap<String, ObjectClass>);

/// A file of class names that cannot be used.
#[derive(Debug, Error)]
pub enum ClassMapError {
    /// The file cannot be opened or is no text.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// A line is malformed.
    #[error(
        "{}:{line}: \"{found}\"; expected a class name of the labels and the class that it means, such as: Bus Truck",
        path.display()
    )]
    Line {
        /// The file.
        path: PathBuf,
        /// Its line, from 1.
        line: usize,
        /// The line.
        found: String,
    },
    /// A name is mapped again.
    #[error("{}:{line}: {name} is mapped already; expected each name once", path.display())]
    Twice {
        /// The file.
        path: PathBuf,
        /// Its line, from 1.
        line: usize,
        /// The name.
        name: String,
    },
}

impl ClassMap {
    /// A map from these names to these classes.
    pub fn new<'a>(rows: impl IntoIterator<Item = (&'a str, ObjectClass)>) -> Self {
        Self(rows.into_iter().map(|(name, class)| (name.to_owned(), class)).collect())
    }

    /// Reads a map: a name and its class on each line, with spaces between. Empty lines and what follows a `#` count
    /// for nothing.
    ///
    /// # Errors
    /// When the file cannot be read, a line has not two words, or a name is mapped twice.
    pub fn read(path: &Path) -> Result<Self, ClassMapError> {
        let text =
            farsight_files::read_text(path).map_err(|source| ClassMapError::Read { path: path.to_owned(), source })?;
        let mut map = BTreeMap::new();
        for (row, line) in text.lines().zip(1..) {
            let words = row.split_once('#').map_or(row, |(words, _)| words);
            let (name, class) = match words.split_ascii_whitespace().collect::<Vec<_>>()[..] {
                [] => continue,
                [name, class] => (name, class),
                _ => return Err(ClassMapError::Line { path: path.to_owned(), line, found: row.to_owned() }),
            };
            if map.insert(name.to_owned(), ObjectClass::from_name(class)).is_some() {
                return Err(ClassMapError::Twice { path: path.to_owned(), line, name: name.to_owned() });
            }
        }
        Ok(Self(map))
    }

    /// The text of its file, sorted by name.
    pub fn to_text(&self) -> String {
        self.0.iter().fold(String::new(), |text, (name, class)| text + &format!("{name} {class}\n"))
    }

    /// Whether every name is taken as it is.
    pub fn is_identity(&self) -> bool {
        self.0.iter().all(|(name, class)| *class == ObjectClass::from_name(name))
    }

    /// The class that `name` means.
    pub fn class(&self, name: &str) -> ObjectClass {
        self.0.get(name).cloned().unwrap_or_else(|| ObjectClass::from_name(name))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use farsight_core::ObjectClass::{Car, Cyclist, DontCare, Other, Pedestrian, Truck};

    use super::*;

    #[test]
    fn names_mean_what_the_map_says_and_others_are_taken_as_they_are() {
        let map = ClassMap::new([
            ("vehicle.car", Car),
            ("vehicle.bus.rigid", Truck),
            ("human.pedestrian.adult", Pedestrian),
            ("Bus", Truck),
            ("movable_object.barrier", DontCare),
        ]);
        for (name, class) in [
            ("vehicle.car", Car),
            ("vehicle.bus.rigid", Truck),
            ("Bus", Truck),
            ("human.pedestrian.adult", Pedestrian),
            ("movable_object.barrier", DontCare),
            ("Cyclist", Cyclist),
            ("bus", Other("bus".into())),
        ] {
            assert_eq!(map.class(name), class, "{name}");
        }
        assert!(!map.is_identity());
        assert!(ClassMap::default().is_identity() && ClassMap::new([("Car", Car)]).is_identity());
    }

    #[test]
    fn files_are_read_strictly() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("classes.txt");
        let read = |text: &str| {
            std::fs::write(&path, text).unwrap();
            ClassMap::read(&path).map_err(|error| error.to_string().replace(&path.display().to_string(), "FILE"))
        };
        let map = read("# ours  theirs\nBus\tTruck\r\n\n  Rider Cyclist # on a bicycle\n").unwrap();
        assert_eq!(map, ClassMap::new([("Bus", Truck), ("Rider", Cyclist)]));
        let expected = "expected a class name of the labels and the class that it means, such as: Bus Truck";
        assert_eq!(read("Bus Truck\nRider\n").unwrap_err(), format!("FILE:2: \"Rider\"; {expected}"));
        assert_eq!(read("a b c").unwrap_err(), format!("FILE:1: \"a b c\"; {expected}"));
        assert_eq!(read("Bus Truck\nBus Car\n").unwrap_err(), "FILE:2: Bus is mapped already; expected each name once");
        assert!(ClassMap::read(folder.path()).unwrap_err().to_string().contains("cannot be read"));
    }
}

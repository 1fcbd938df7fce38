//! Object classes by KITTI's names.

use std::convert::Infallible;
use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// What an object is. KITTI's names are known; any other name is kept as written.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(from = "String", into = "String")]
pub enum ObjectClass {
    /// Passenger car.
    Car,
    /// Van; a neighbour of `Car` in the KITTI evaluation.
    Van,
    /// Truck: what carries freight, and buses in rendered labels.
    Truck,
    /// Person on foot.
    Pedestrian,
    /// Seated person; a neighbour of `Pedestrian` in the KITTI evaluation.
    PersonSitting,
    /// Person on a bicycle, bicycle included.
    Cyclist,
    /// Tram or train.
    Tram,
    /// Anything else with wheels, trailers for instance.
    Misc,
    /// A region that was not labelled.
    DontCare,
    /// A class that KITTI does not have.
    Other(Box<str>),
}

impl ObjectClass {
    /// The classes that KITTI labels, in the order of its paper.
    pub const KITTI: [Self; 9] = [
        Self::Car,
        Self::Van,
        Self::Truck,
        Self::Pedestrian,
        Self::PersonSitting,
        Self::Cyclist,
        Self::Tram,
        Self::Misc,
        Self::DontCare,
    ];

    /// The name as KITTI writes it.
    pub fn name(&self) -> &str {
        match self {
            Self::Car => "Car",
            Self::Van => "Van",
            Self::Truck => "Truck",
            Self::Pedestrian => "Pedestrian",
            Self::PersonSitting => "Person_sitting",
            Self::Cyclist => "Cyclist",
            Self::Tram => "Tram",
            Self::Misc => "Misc",
            Self::DontCare => "DontCare",
            Self::Other(name) => name,
        }
    }

    /// Whether both are one class, or classes that are easily taken for one another: cars, vans and trucks; people,
    /// however they move.
    pub fn is_like(&self, other: &Self) -> bool {
        let is_vehicle = |class: &Self| matches!(class, Self::Car | Self::Van | Self::Truck);
        let is_person = |class: &Self| matches!(class, Self::Pedestrian | Self::PersonSitting | Self::Cyclist);
        self == other || (is_vehicle(self) && is_vehicle(other)) || (is_person(self) && is_person(other))
    }

    /// Whether this is `known`, one of KITTI's, by its name in any case: the devkit compares like that, so `car` and
    /// `dontcare` count.
    pub fn eq_ignore_case(&self, known: &Self) -> bool {
        match self {
            Self::Other(name) => name.eq_ignore_ascii_case(known.name()),
            _ => self == known,
        }
    }

    /// The class of KITTI's that this name probably means, if it is none of them but for its case or a letter.
    pub fn misspelt(&self) -> Option<Self> {
        let Self::Other(name) = self else { return None };
        let written = name.to_ascii_lowercase();
        // Short words are a letter from many others: a cat is no car.
        let most = usize::from(written.len() > 3);
        let is_near = |known: &Self| {
            let known = known.name().to_ascii_lowercase();
            written.len().abs_diff(known.len()) <= most && edits(written.as_bytes(), known.as_bytes()) <= most
        };
        Self::KITTI.into_iter().find(is_near)
    }

    /// The class called `name`, case included.
    pub fn from_name(name: &str) -> Self {
        Self::KITTI.into_iter().find(|class| class.name() == name).unwrap_or_else(|| Self::Other(name.into()))
    }
}

/// Letters to add, drop or replace to get from one word to the other; two that changed places count as one (optimal
/// string alignment).
fn edits(a: &[u8], b: &[u8]) -> usize {
    let mut least = vec![vec![0; b.len() + 1]; a.len() + 1];
    for i in 0..=a.len() {
        for j in 0..=b.len() {
            if i == 0 || j == 0 {
                least[i][j] = i + j;
                continue;
            }
            let replaced = least[i - 1][j - 1] + usize::from(a[i - 1] != b[j - 1]);
            least[i][j] = replaced.min(least[i - 1][j] + 1).min(least[i][j - 1] + 1);
            if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                least[i][j] = least[i][j].min(least[i - 2][j - 2] + 1);
            }
        }
    }
    least[a.len()][b.len()]
}

impl fmt::Display for ObjectClass {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for ObjectClass {
    type Err = Infallible;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        Ok(Self::from_name(name))
    }
}

impl From<String> for ObjectClass {
    fn from(name: String) -> Self {
        Self::from_name(&name)
    }
}

impl From<ObjectClass> for String {
    fn from(class: ObjectClass) -> Self {
        class.name().to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::ObjectClass::{Car, Cyclist, DontCare, Misc, Pedestrian, PersonSitting, Tram, Truck, Van};

    #[test]
    fn misspelt_names_are_known() {
        let meant = |name: &str| super::ObjectClass::from_name(name).misspelt();
        for (name, class) in [
            ("car", Car),
            ("Carr", Car),
            ("Pedestrain", Pedestrian),
            ("cyclists", Cyclist),
            ("dontcare", DontCare),
            ("VAN", Van),
        ] {
            assert_eq!(meant(name), Some(class), "{name}");
        }
        for name in ["Car", "Cat", "Bus", "Rider", "Bicycle", "van.large", ""] {
            assert_eq!(meant(name), None, "{name}");
        }
    }

    #[test]
    fn vehicles_are_like_vehicles_and_people_like_people() {
        for (a, b) in [(Car, Truck), (Van, Car), (Cyclist, Pedestrian), (PersonSitting, Cyclist), (Tram, Tram)] {
            assert!(a.is_like(&b) && b.is_like(&a), "{a} and {b}");
        }
        for (a, b) in [(Van, Cyclist), (Car, Tram), (Truck, Misc), (Pedestrian, DontCare)] {
            assert!(!a.is_like(&b) && !b.is_like(&a), "{a} and {b}");
        }
    }
}

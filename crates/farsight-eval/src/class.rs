//! The classes that KITTI evaluates and the part that every other class plays for them.

use std::fmt;

use farsight_core::ObjectClass;
use serde::Serialize;

/// A class with figures of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum EvaluatedClass {
    /// Passenger cars.
    Car,
    /// People on foot.
    Pedestrian,
    /// People on bicycles.
    Cyclist,
}

/// What an object is to an evaluated class (spec kitti-eval.md, rule 8).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// It belongs to the class.
    Own,
    /// It looks like the class and is labelled as another: finding it is neither right nor wrong.
    Neighbour,
    /// It has nothing to do with the class.
    Other,
}

impl EvaluatedClass {
    /// All of them, in the devkit's order.
    pub const ALL: [Self; 3] = [Self::Car, Self::Pedestrian, Self::Cyclist];

    /// The class as labels name it.
    pub const fn object_class(self) -> ObjectClass {
        match self {
            Self::Car => ObjectClass::Car,
            Self::Pedestrian => ObjectClass::Pedestrian,
            Self::Cyclist => ObjectClass::Cyclist,
        }
    }

    /// The name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Car => "car",
            Self::Pedestrian => "pedestrian",
            Self::Cyclist => "cyclist",
        }
    }

    /// The evaluated class that `class` is, if any.
    pub fn of(class: &ObjectClass) -> Option<Self> {
        Self::ALL.into_iter().find(|evaluated| class.eq_ignore_case(&evaluated.object_class()))
    }

    /// What an object of `class` is to this class.
    pub fn role(self, class: &ObjectClass) -> Role {
        if class.eq_ignore_case(&self.object_class()) {
            Role::Own
        } else if self.neighbour().is_some_and(|neighbour| class.eq_ignore_case(&neighbour)) {
            Role::Neighbour
        } else {
            Role::Other
        }
    }

    const fn neighbour(self) -> Option<ObjectClass> {
        match self {
            Self::Car => Some(ObjectClass::Van),
            Self::Pedestrian => Some(ObjectClass::PersonSitting),
            Self::Cyclist => None,
        }
    }
}

impl fmt::Display for EvaluatedClass {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_count_in_any_case() {
        for name in ["Car", "car", "CAR"] {
            assert_eq!(EvaluatedClass::of(&ObjectClass::from_name(name)), Some(EvaluatedClass::Car), "{name}");
        }
        assert!(ObjectClass::from_name("dontcare").eq_ignore_case(&ObjectClass::DontCare));
    }

    #[test]
    fn neighbours_are_those_of_the_devkit() {
        let neighbours = |class: EvaluatedClass| {
            let names = ObjectClass::KITTI.into_iter().filter(|c| class.role(c) == Role::Neighbour);
            names.map(|c| c.name().to_owned()).collect::<Vec<_>>()
        };
        assert_eq!(neighbours(EvaluatedClass::Car), ["Van"]);
        assert_eq!(neighbours(EvaluatedClass::Pedestrian), ["Person_sitting"]);
        assert!(neighbours(EvaluatedClass::Cyclist).is_empty());
    }
}

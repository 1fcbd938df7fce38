//! The parts of a data set that errors are reported for.

use super::matching::Target;
use crate::Difficulty;
use crate::parts::{Bins, Part};

/// The objects that count at a difficulty, or all that are labelled.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Group {
    /// Those that count at this level.
    Level(Difficulty),
    /// Every labelled object, at whatever size and however hidden.
    All,
}

/// A part of a group: what one row of a report is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Slice {
    /// The objects it is taken from.
    pub group: Group,
    /// Which of them.
    pub part: Part,
}

impl Group {
    /// All groups, easiest first.
    pub const ALL: [Self; 4] =
        [Self::Level(Difficulty::Easy), Self::Level(Difficulty::Moderate), Self::Level(Difficulty::Hard), Self::All];

    /// The name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Level(difficulty) => difficulty.name(),
            Self::All => "all",
        }
    }

    /// Whether an object whose easiest level is `difficulty` belongs to it.
    pub fn holds(self, difficulty: Option<Difficulty>) -> bool {
        match self {
            Self::Level(level) => difficulty.is_some_and(|easiest| easiest <= level),
            Self::All => true,
        }
    }
}

/// Where an object stands in every division at once; the smallest set that each slice is a union of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Cell {
    difficulty: Option<Difficulty>,
    bins: Bins,
}

impl Cell {
    pub(super) fn of(target: &Target) -> Self {
        let Target { height_px, depth_m, occlusion, truncation, .. } = *target;
        Self { difficulty: target.difficulty, bins: Bins::new(height_px, depth_m, occlusion, truncation) }
    }

    pub(super) fn is_in(self, slice: Slice) -> bool {
        slice.part.holds(self.bins) && slice.group.holds(self.difficulty)
    }
}

impl Slice {
    /// All slices, group by group: the whole, then each table.
    pub(super) fn all() -> Vec<Self> {
        let parts: Vec<_> =
            std::iter::once(Part::Whole).chain(Part::divisions().into_iter().flatten().map(|(_, part)| part)).collect();
        Group::ALL.iter().flat_map(|&group| parts.iter().map(move |&part| Self { group, part })).collect()
    }

    /// Whether the object belongs to it.
    pub fn holds(self, target: &Target) -> bool {
        Cell::of(target).is_in(self)
    }
}

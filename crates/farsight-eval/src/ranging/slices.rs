//! The parts of a data set that errors are reported for.

use super::matching::Target;
use crate::Difficulty;

/// Width of a distance bin, metres of true z; the last has no end.
const DISTANCE_BIN_M: f64 = 10.0;

/// Names of the distance bins: metres of true z.
pub const DISTANCE_BINS: [&str; 8] = ["0-10", "10-20", "20-30", "30-40", "40-50", "50-60", "60-70", "70-inf"];

/// Names of the occlusion levels as KITTI numbers them; 3 is "unknown".
const OCCLUSIONS: [&str; 4] = ["0", "1", "2", "3"];

/// Upper edges of the truncation bins: the limits of the three levels.
const TRUNCATION_EDGES: [f64; 4] = [0.0, 0.15, 0.30, 0.50];

/// Names of the truncation bins.
const TRUNCATIONS: [&str; 5] = ["0", "0-0.15", "0.15-0.30", "0.30-0.50", "0.50-1"];

/// The objects that count at a difficulty, or all that are labelled.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Group {
    /// Those that count at this level.
    Level(Difficulty),
    /// Every labelled object, at whatever size and however hidden.
    All,
}

/// A part of a group.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// All of it.
    Whole,
    /// One of [`DISTANCE_BINS`]; what lies behind the camera is in the first.
    Distance(usize),
    /// One occlusion level.
    Occlusion(usize),
    /// One truncation bin.
    Truncation(usize),
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

/// The bin of a depth, metres; what lies behind the camera is in the first.
fn distance_bin(depth_m: f64) -> usize {
    ((depth_m / DISTANCE_BIN_M) as usize).min(DISTANCE_BINS.len() - 1)
}

/// Middle of a distance bin, metres; of the last one as if it were as wide as the others.
pub(crate) fn bin_middle_m(bin: usize) -> f64 {
    (bin as f64 + 0.5) * DISTANCE_BIN_M
}

impl Part {
    /// The parts by distance, by occlusion and by truncation, with their names.
    pub(super) fn tables() -> [Vec<(&'static str, Self)>; 3] {
        let named = |names: &[&'static str], part: fn(usize) -> Self| {
            names.iter().enumerate().map(|(i, name)| (*name, part(i))).collect()
        };
        [
            named(&DISTANCE_BINS, Self::Distance),
            named(&OCCLUSIONS, Self::Occlusion),
            named(&TRUNCATIONS, Self::Truncation),
        ]
    }
}

/// Where an object stands in every division at once; the smallest set that each slice is a union of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Cell {
    difficulty: Option<Difficulty>,
    distance: usize,
    occlusion: usize,
    truncation: usize,
}

impl Cell {
    pub(super) fn of(target: &Target) -> Self {
        Self {
            difficulty: target.difficulty,
            distance: distance_bin(target.depth_m),
            occlusion: (target.occlusion.max(0) as usize).min(OCCLUSIONS.len() - 1),
            truncation: TRUNCATION_EDGES.iter().filter(|edge| target.truncation > **edge).count(),
        }
    }

    pub(super) fn is_in(&self, slice: Slice) -> bool {
        let in_part = match slice.part {
            Part::Whole => true,
            Part::Distance(bin) => self.distance == bin,
            Part::Occlusion(level) => self.occlusion == level,
            Part::Truncation(bin) => self.truncation == bin,
        };
        in_part && slice.group.holds(self.difficulty)
    }
}

impl Slice {
    /// All slices, group by group: the whole, then each table.
    pub(super) fn all() -> Vec<Self> {
        let parts: Vec<_> =
            std::iter::once(Part::Whole).chain(Part::tables().into_iter().flatten().map(|(_, part)| part)).collect();
        Group::ALL.iter().flat_map(|&group| parts.iter().map(move |&part| Self { group, part })).collect()
    }

    /// Whether the object belongs to it.
    pub fn holds(self, target: &Target) -> bool {
        Cell::of(target).is_in(self)
    }
}

#[cfg(test)]
mod tests {
    use super::{DISTANCE_BINS, bin_middle_m, distance_bin};

    #[test]
    fn names_and_middles_of_the_distance_bins_are_those_of_their_distances() {
        for (bin, name) in DISTANCE_BINS.iter().enumerate() {
            let (from, to) = name.split_once('-').unwrap();
            let from: f64 = from.parse().unwrap();
            assert_eq!([from, from + 9.999, bin_middle_m(bin)].map(distance_bin), [bin; 3], "{name}");
            assert_eq!(distance_bin(to.parse().unwrap()), (bin + 1).min(7), "{name}");
        }
        assert_eq!(distance_bin(-3.0), 0);
    }
}

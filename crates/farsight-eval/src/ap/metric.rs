//! What an overlap is measured on, and how much of it a match takes.

use farsight_core::overlap::Overlap;

use crate::parts::Part;
use crate::{Difficulty, EvaluatedClass};

/// What an overlap is measured on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Metric {
    /// Boxes in the image; the orientation score (AOS) uses these matches.
    Image,
    /// Footprints seen from above.
    Bev,
    /// Boxes in space.
    Box3d,
}

/// The overlap that a detection must exceed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OverlapSet {
    /// The devkit's: 0.7 for cars, 0.5 for others, in every metric.
    Strict,
    /// 0.5 for cars, 0.25 for others, seen from above and in space; in the image as the strict ones.
    Loose,
}

/// Which curve: of what, measured how.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CurveSpec {
    /// The overlap that a detection must exceed.
    pub overlaps: OverlapSet,
    /// What it is measured on.
    pub metric: Metric,
    /// Of which class.
    pub class: EvaluatedClass,
    /// Which of its objects must be found.
    pub difficulty: Difficulty,
    /// And in which part of the data set. Objects elsewhere may be found; a detection that finds nothing is wrong when
    /// its own height or distance lies in the part. No detection says how hidden it is, so in a part by occlusion or
    /// truncation all of them are.
    pub part: Part,
}

impl CurveSpec {
    /// The devkit's curve: the whole data set.
    pub fn new(overlaps: OverlapSet, metric: Metric, class: EvaluatedClass, difficulty: Difficulty) -> Self {
        Self { overlaps, metric, class, difficulty, part: Part::Whole }
    }

    /// The same over a part of the data set.
    #[must_use]
    pub fn of_part(self, part: Part) -> Self {
        Self { part, ..self }
    }
}

impl Metric {
    /// All of them, in the devkit's order.
    pub const ALL: [Self; 3] = [Self::Image, Self::Bev, Self::Box3d];

    /// The name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Image => "2d",
            Self::Bev => "bev",
            Self::Box3d => "3d",
        }
    }
}

impl OverlapSet {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Strict, Self::Loose];

    /// The overlap that a detection of `class` must exceed (not only reach).
    pub fn min_overlap(self, class: EvaluatedClass, metric: Metric) -> f64 {
        let is_loose = self == Self::Loose && metric != Metric::Image;
        match (class, is_loose) {
            (EvaluatedClass::Car, false) => 0.7,
            (EvaluatedClass::Car, true) | (_, false) => 0.5,
            (_, true) => 0.25,
        }
    }
}

/// A measure of two boxes in every metric.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Overlaps {
    /// In the image.
    pub image: f64,
    /// From above and in space.
    pub box3d: Overlap,
}

impl Overlaps {
    /// The value in one metric.
    pub fn get(&self, metric: Metric) -> f64 {
        match metric {
            Metric::Image => self.image,
            Metric::Bev => self.box3d.bev,
            Metric::Box3d => self.box3d.volume,
        }
    }

    pub(super) fn largest(self, other: Self) -> Self {
        let box3d =
            Overlap { bev: self.box3d.bev.max(other.box3d.bev), volume: self.box3d.volume.max(other.box3d.volume) };
        Self { image: self.image.max(other.image), box3d }
    }

    /// Whether some curve of `class` can match at these overlaps.
    pub(super) fn matter(&self, class: EvaluatedClass) -> bool {
        Metric::ALL.iter().any(|&metric| self.get(metric) > OverlapSet::Loose.min_overlap(class, metric))
    }
}

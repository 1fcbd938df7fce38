//! What an overlap is measured on, and how much of it a match takes.

use farsight_core::overlap::Overlap;

use crate::EvaluatedClass;

/// What an overlap is measured on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Metric {
    /// Boxes in the image; the orientation score (AOS) uses these matches.
    Image,
    /// Footprints seen from above.
    Bev,
    /// Boxes in space.
    Space,
}

/// The overlap that a detection must exceed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OverlapSet {
    /// The devkit's: 0.7 for cars, 0.5 for others, in every metric.
    Strict,
    /// 0.5 for cars, 0.25 for others, seen from above and in space; in the image as the strict ones.
    Loose,
}

impl Metric {
    /// All of them, in the devkit's order.
    pub const ALL: [Self; 3] = [Self::Image, Self::Bev, Self::Space];

    /// The name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Image => "2d",
            Self::Bev => "bev",
            Self::Space => "3d",
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
    pub scene: Overlap,
}

impl Overlaps {
    /// The value in one metric.
    pub fn get(&self, metric: Metric) -> f64 {
        match metric {
            Metric::Image => self.image,
            Metric::Bev => self.scene.bev,
            Metric::Space => self.scene.volume,
        }
    }

    pub(super) fn largest(self, other: Self) -> Self {
        let scene =
            Overlap { bev: self.scene.bev.max(other.scene.bev), volume: self.scene.volume.max(other.scene.volume) };
        Self { image: self.image.max(other.image), scene }
    }

    /// Whether some curve of `class` can match at these overlaps.
    pub(super) fn matter(&self, class: EvaluatedClass) -> bool {
        Metric::ALL.iter().any(|&metric| self.get(metric) > OverlapSet::Loose.min_overlap(class, metric))
    }
}

//! Easy, Moderate, Hard: which objects a detector must find.

use std::fmt;

use farsight_core::{Box2d, Label};
use serde::Serialize;

/// A level of the KITTI evaluation. Each one holds all objects of the easier ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Difficulty {
    /// Large, fully visible, in the image.
    Easy,
    /// Partly occluded objects too; the level that KITTI ranks by.
    Moderate,
    /// Largely occluded objects too.
    Hard,
}

impl Difficulty {
    /// All of them, easiest first.
    pub const ALL: [Self; 3] = [Self::Easy, Self::Moderate, Self::Hard];

    /// The name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Easy => "easy",
            Self::Moderate => "moderate",
            Self::Hard => "hard",
        }
    }

    /// Objects of exactly this height in the image or less do not count, pixels (devkit, `MIN_HEIGHT`).
    pub const fn min_height_px(self) -> f64 {
        match self {
            Self::Easy => 40.0,
            Self::Moderate | Self::Hard => 25.0,
        }
    }

    /// Objects that are more occluded do not count (devkit, `MAX_OCCLUSION`).
    pub const fn max_occlusion(self) -> i32 {
        match self {
            Self::Easy => 0,
            Self::Moderate => 1,
            Self::Hard => 2,
        }
    }

    /// Objects with a larger share outside the image do not count (devkit, `MAX_TRUNCATION`).
    pub const fn max_truncation(self) -> f64 {
        match self {
            Self::Easy => 0.15,
            Self::Moderate => 0.30,
            Self::Hard => 0.50,
        }
    }

    /// Why `label` does not count at this level, or `None` when it does (spec rule 7: the height is strict, the others
    /// are not).
    pub fn reason_to_ignore(self, label: &Label) -> Option<DifficultyLimit> {
        if label.occlusion > self.max_occlusion() {
            Some(DifficultyLimit::Occluded)
        } else if label.truncation > self.max_truncation() {
            Some(DifficultyLimit::Truncated)
        } else if label.box2d.height() <= self.min_height_px() {
            Some(DifficultyLimit::Small)
        } else {
            None
        }
    }

    /// The easiest level at which `label` counts.
    pub fn of(label: &Label) -> Option<Self> {
        Self::ALL.into_iter().find(|level| level.reason_to_ignore(label).is_none())
    }

    /// Whether a detection is too small to be right or wrong (spec rule 9: strict the other way than for labels).
    ///
    /// The devkit cuts the height to a whole number first, which changes nothing but NaN: it becomes a small one.
    pub fn ignores_detection(self, box2d: &Box2d) -> bool {
        let height = box2d.height().abs();
        height.is_nan() || height < self.min_height_px()
    }
}

impl fmt::Display for Difficulty {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// Why a labelled object does not count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DifficultyLimit {
    /// Too much hides it.
    Occluded,
    /// Too much of it is outside the image.
    Truncated,
    /// Not high enough in the image.
    Small,
}

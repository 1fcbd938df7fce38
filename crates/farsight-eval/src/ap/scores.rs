//! Scores of detections, sorted so that those above a threshold can be counted.

use crate::Difficulty;
use crate::parts::Bins;

/// The scores of all detections of a class, those that are no numbers left out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScoreRange {
    /// How many detections there are.
    pub count: usize,
    /// The lowest score; infinite without any.
    pub lowest: f64,
    /// The highest score; negative and infinite without any.
    pub highest: f64,
}

/// A detection of a class, wherever it is; wrong where no object takes it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ScoredDetection {
    pub(super) score: f64,
    pub(super) frame: u32,
    /// The easiest level at which it is not too small.
    pub(super) size: Option<Difficulty>,
    pub(super) bins: Bins,
}

impl ScoreRange {
    pub(super) fn of(detections: &[ScoredDetection]) -> Self {
        let numbers = || detections.iter().map(|detection| detection.score).filter(|score| !score.is_nan());
        Self {
            count: numbers().count(),
            lowest: numbers().fold(f64::INFINITY, f64::min),
            highest: numbers().fold(f64::NEG_INFINITY, f64::max),
        }
    }
}

/// Best score first.
pub(super) fn sorted(detections: &[ScoredDetection]) -> Vec<ScoredDetection> {
    let mut sorted = detections.to_vec();
    sorted.sort_by(|a, b| highest_first(a.score, b.score));
    sorted
}

/// Whether a detection of this score takes part at a threshold. A score that is no number always does: the devkit asks
/// whether it is lower.
pub(super) fn reaches(score: f64, threshold: f64) -> bool {
    score.is_nan() || score >= threshold
}

/// Falling, with those that are no numbers in front.
pub(super) fn highest_first(a: f64, b: f64) -> std::cmp::Ordering {
    b.is_nan().cmp(&a.is_nan()).then(b.total_cmp(&a))
}

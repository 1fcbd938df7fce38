//! How sure average precision is: its values on frames drawn again, and the intervals that follow.

use serde::Serialize;

use crate::bootstrap::Interval;

/// Average precision of one draw, percent; NaN when no object counts in it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ApSample {
    /// Over 40 points of recall.
    pub r40: f64,
    /// Over 11 points of recall.
    pub r11: f64,
}

/// 95% intervals over frames of average precision, percent: of one curve, or of the three difficulties.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ApIntervals<T> {
    /// Over 40 points of recall.
    #[serde(rename = "r40_interval")]
    pub r40: T,
    /// Over 11 points of recall.
    #[serde(rename = "r11_interval")]
    pub r11: T,
}

impl ApIntervals<Option<Interval>> {
    /// The intervals that these resamples give.
    pub(super) fn of(resamples: &[ApSample]) -> Self {
        let interval = |of: fn(&ApSample) -> f64| Interval::of(&mut resamples.iter().map(of).collect());
        Self { r40: interval(|ap| ap.r40), r11: interval(|ap| ap.r11) }
    }
}

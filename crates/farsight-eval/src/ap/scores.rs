//! Scores of detections, sorted so that those above a threshold can be counted.

use super::class_frame::{ClassFrames, FramePrediction};
use super::matching::Matching;
use crate::Difficulty;

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

/// Scores of all detections of a class, by the easiest level at which they are not too small.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct SizedScores([Vec<f64>; 3]);

/// Scores of the detections that count and that no `DontCare` region excuses, highest first.
pub(super) struct Scores<'a> {
    counting: &'a [f64],
    excused: Vec<f64>,
}

impl SizedScores {
    pub(super) fn add(&mut self, score: f64, size: Difficulty) {
        self.0[size as usize].push(score);
    }

    pub(super) fn range(&self) -> ScoreRange {
        let numbers = || self.0.iter().flatten().copied().filter(|score| !score.is_nan());
        ScoreRange {
            count: numbers().count(),
            lowest: numbers().fold(f64::INFINITY, f64::min),
            highest: numbers().fold(f64::NEG_INFINITY, f64::max),
        }
    }

    pub(super) fn append(&mut self, other: &mut Self) {
        for (scores, later) in self.0.iter_mut().zip(&mut other.0) {
            scores.append(later);
        }
    }

    /// The scores that count at each difficulty, highest first.
    pub(super) fn by_difficulty(&self) -> [Vec<f64>; 3] {
        let mut so_far = Vec::new();
        self.0.each_ref().map(|scores| {
            so_far.extend_from_slice(scores);
            so_far.sort_unstable_by(highest_first);
            so_far.clone()
        })
    }
}

impl<'a> Scores<'a> {
    /// `counting` are the scores at one difficulty ([`SizedScores::by_difficulty`]).
    pub(super) fn new(counting: &'a [f64], class_frames: &ClassFrames, matching: &Matching) -> Self {
        Self { counting, excused: excused_scores(class_frames, matching) }
    }

    /// How many detections reach the threshold.
    pub(super) fn reaching(&self, threshold: f64) -> usize {
        let count = |scores: &[f64]| scores.partition_point(|&score| score >= threshold || score.is_nan());
        count(self.counting) - count(&self.excused)
    }
}

fn excused_scores(class_frames: &ClassFrames, matching: &Matching) -> Vec<f64> {
    let counts = |prediction: &&FramePrediction| {
        prediction.is_own && prediction.size.is_some_and(|size| size <= matching.difficulty)
    };
    let predictions = class_frames.iter().flat_map(|class_frame| &class_frame.predictions).filter(counts);
    let mut scores: Vec<_> =
        predictions.filter(|prediction| matching.excuses(prediction)).map(|prediction| prediction.score).collect();
    scores.sort_unstable_by(highest_first);
    scores
}

/// Falling, with those that are no numbers in front: they reach every threshold.
#[allow(clippy::trivially_copy_pass_by_ref)] // The signature that `sort_by` wants.
fn highest_first(a: &f64, b: &f64) -> std::cmp::Ordering {
    b.is_nan().cmp(&a.is_nan()).then(b.total_cmp(a))
}

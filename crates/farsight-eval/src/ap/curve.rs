//! Precision at 41 points of recall (spec rules 17 to 21).

use super::class_frame::{ClassFrame, ClassFrames};
use super::matching::{Counts, Matching, counts, first_pass_scores};
use super::scores::Scores;

/// Points of a curve: recall 0, 1/40, ... 1.
pub const RECALL_POINTS: usize = 41;

/// Precision against recall for one class, metric and difficulty.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// The overlap that a detection had to exceed.
    pub min_overlap: f64,
    /// Objects that had to be found.
    pub objects: usize,
    /// True positives of the first pass, from whose scores the thresholds are chosen.
    pub matched: usize,
    /// The score thresholds, highest first; the one at position `i` stands for recall `i / 40`.
    pub thresholds: Vec<ScoreThreshold>,
    /// Precision at each point, 0 to 1, made falling; 0 where no threshold is.
    pub precision: [f64; RECALL_POINTS],
    /// Orientation similarity at each point, 0 to 1; only in the image, and only when every detection states its angle.
    pub orientation: Option<[f64; RECALL_POINTS]>,
}

/// One score threshold and the counts over all frames there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScoreThreshold {
    /// Detections with a lower score take no part.
    pub score: f64,
    /// True positives.
    pub true_positives: usize,
    /// False positives.
    pub false_positives: usize,
    /// Objects missed.
    pub false_negatives: usize,
    /// Sum of the orientation similarities of the true positives.
    pub similarity: f64,
}

impl Curve {
    /// Average precision over 40 points of recall, percent: the mean without the point at recall 0 (KITTI since
    /// 8.10.2019).
    pub fn ap_r40(&self) -> f64 {
        percent_r40(&self.precision)
    }

    /// Average precision over 11 points of recall, percent (KITTI before that).
    pub fn ap_r11(&self) -> f64 {
        percent_r11(&self.precision)
    }

    pub(super) fn new(
        class_frames: &ClassFrames,
        matching: &Matching,
        scores: &Scores,
        with_orientation: bool,
    ) -> Self {
        let must_be_found = |class_frame: &ClassFrame| {
            class_frame.objects.iter().filter(|object| object.label.counts_at(matching.difficulty)).count()
        };
        let objects = class_frames.iter().map(must_be_found).sum();
        let mut taken = Vec::new();
        let mut found_scores = Vec::new();
        for class_frame in class_frames {
            first_pass_scores(class_frame, matching, &mut taken, &mut found_scores);
        }
        let matched = found_scores.len();
        let thresholds = score_thresholds(found_scores, objects);
        let thresholds = count_at_thresholds(class_frames, matching, scores, &thresholds);
        let share = |part: fn(&ScoreThreshold) -> f64| falling(&thresholds, part);
        let precision = share(|threshold| threshold.true_positives as f64);
        let orientation = with_orientation.then(|| share(|threshold| threshold.similarity));
        Self { min_overlap: matching.min_overlap, objects, matched, thresholds, precision, orientation }
    }
}

pub(super) fn percent_r40(points: &[f64; RECALL_POINTS]) -> f64 {
    100.0 * points[1..].iter().sum::<f64>() / 40.0
}

pub(super) fn percent_r11(points: &[f64; RECALL_POINTS]) -> f64 {
    100.0 * points.iter().step_by(4).sum::<f64>() / 11.0
}

/// The scores at which recall comes nearest to 0, 1/40, ... 1; the last score is always one (spec rule 17).
///
/// The recall aimed at is **summed up**, as the devkit does: `k / 40` would choose other scores for most numbers of
/// objects.
fn score_thresholds(mut scores: Vec<f64>, objects: usize) -> Vec<f64> {
    scores.sort_unstable_by(|a, b| b.total_cmp(a));
    let recall = |count: usize| count as f64 / objects as f64;
    let mut aim = 0.0;
    let mut thresholds = Vec::with_capacity(RECALL_POINTS);
    for (i, &score) in scores.iter().enumerate() {
        let is_last = i + 1 == scores.len();
        let here = recall(i + 1);
        if !is_last && recall(i + 2) - aim < aim - here {
            continue;
        }
        thresholds.push(score);
        aim += 1.0 / (RECALL_POINTS as f64 - 1.0);
    }
    // Never more than 41 for any number of objects tried; a longer list would have no place on the curve.
    thresholds.truncate(RECALL_POINTS);
    thresholds
}

/// Position of the first threshold that a score reaches. Scores that are no numbers reach every threshold: the devkit
/// asks whether they are lower.
fn first_reached(thresholds: &[f64], score: f64) -> usize {
    thresholds.partition_point(|&threshold| score < threshold)
}

fn count_at_thresholds(
    class_frames: &ClassFrames,
    matching: &Matching,
    scores: &Scores,
    thresholds: &[f64],
) -> Vec<ScoreThreshold> {
    let mut totals = vec![Counts::default(); thresholds.len()];
    let (mut taken, mut reached, mut starts) = (Vec::new(), Vec::new(), Vec::new());
    for class_frame in class_frames {
        reached.clear();
        reached.extend(class_frame.predictions.iter().map(|prediction| first_reached(thresholds, prediction.score)));
        // A frame looks the same at all thresholds between two scores of its candidates: it is matched once for each
        // such stretch.
        starts.clear();
        starts.extend(candidates(class_frame, matching).map(|position| reached[position]));
        starts.push(0);
        starts.sort_unstable();
        starts.dedup();
        for (i, &start) in starts.iter().enumerate().take_while(|(_, start)| **start < thresholds.len()) {
            let end = starts.get(i + 1).map_or(thresholds.len(), |&end| end.min(thresholds.len()));
            let here = counts(class_frame, matching, &mut taken, |position| reached[position] <= start);
            for total in &mut totals[start..end] {
                total.found += here.found;
                total.missed += here.missed;
                total.matched += here.matched;
                total.similarity += here.similarity;
            }
        }
    }
    let threshold = |(&score, total): (&f64, &Counts)| ScoreThreshold {
        score,
        true_positives: total.found,
        false_positives: scores.reaching(score) - total.matched,
        false_negatives: total.missed,
        similarity: total.similarity,
    };
    thresholds.iter().zip(&totals).map(threshold).collect()
}

/// Positions of the predictions that can match some object.
fn candidates<'a>(class_frame: &'a ClassFrame, matching: &'a Matching) -> impl Iterator<Item = usize> + 'a {
    let overlapping = class_frame.objects.iter().flat_map(|object| &object.overlapping);
    let enough = overlapping.filter(|(_, overlaps)| overlaps.get(matching.metric) > matching.min_overlap);
    enough.map(|(position, _)| *position)
}

/// `part / (true + false positives)` at each threshold, then the largest value from there on.
///
/// 0 / 0 counts as 0. The devkit gets NaN there, which hides or spreads depending on where it stands (spec rule 21).
fn falling(thresholds: &[ScoreThreshold], part: impl Fn(&ScoreThreshold) -> f64) -> [f64; RECALL_POINTS] {
    let mut points = [0.0; RECALL_POINTS];
    let mut largest = 0.0_f64;
    for (point, threshold) in points.iter_mut().zip(thresholds).rev() {
        let predictions = threshold.true_positives + threshold.false_positives;
        if predictions > 0 {
            largest = largest.max(part(threshold) / predictions as f64);
        }
        *point = largest;
    }
    points
}

//! What a curve is made of, kept by frame: a curve over frames drawn at random is then a merge of sorted lists.
//!
//! Who matches whom is settled within a frame, by the scores that reach a threshold. So a frame needs to be matched
//! once for each score at which its answer changes, and never again, however often it is drawn. What does depend on
//! the drawn frames are the score thresholds, as they are chosen by recall: they are found anew for each draw.

use rayon::prelude::*;

use super::class_frame::ClassFrames;
use super::curve::{percent_r11, percent_r40};
use super::intervals::{ApIntervals, ApSample};
use super::matching::{Counts, Matching, counts, first_pass_scores};
use super::scores::{ScoredDetection, highest_first, reaches};
use super::thresholds::threshold_positions;
use super::{Curve, RECALL_POINTS, ScoreThreshold};
use crate::bootstrap::{Bootstrap, Interval};

/// Draws that are merged side by side.
const LANES: usize = 8;

/// One curve's outcomes in every frame.
#[derive(Debug, Clone, PartialEq)]
pub struct CurveOutcomes {
    min_overlap: f64,
    /// Frames and how many objects must be found in them.
    objects: Vec<(u32, u32)>,
    /// Frames of the true positives of the first pass, best score first.
    matches: Vec<u32>,
    /// Frames of the detections that would be wrong if no object took them, best score first.
    detections: Vec<u32>,
    /// What lower thresholds change in the frames, highest threshold first.
    changes: Vec<Change>,
    /// The scores that can become thresholds, highest first.
    steps: Vec<Step>,
}

/// A score that can become a threshold, and how far the lists go until there.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Step {
    score: f64,
    matches: usize,
    detections: usize,
    changes: usize,
}

/// What changes in a frame when the threshold falls to a score.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Change {
    frame: u32,
    /// True positives.
    found: i32,
    /// True and false positives, but for those in [`CurveOutcomes::detections`].
    predicted: i32,
    /// Objects missed.
    missed: i32,
    /// Sum of orientation similarities.
    similarity: f64,
}

impl CurveOutcomes {
    /// `detections` are all those of the class, best score first.
    pub(super) fn new(class_frames: &ClassFrames, detections: &[ScoredDetection], matching: &Matching) -> Self {
        let mut taken = Vec::new();
        let (mut objects, mut matches, mut scores) = (Vec::new(), Vec::new(), Vec::new());
        for class_frame in class_frames {
            let must_be_found = class_frame.objects.iter().filter(|object| matching.must_be_found(&object.label));
            objects.push((class_frame.frame, must_be_found.count() as u32));
            scores.clear();
            first_pass_scores(class_frame, matching, &mut taken, &mut scores);
            matches.extend(scores.iter().map(|&score| (score, class_frame.frame)));
        }
        objects.retain(|(_, count)| *count > 0);
        matches.sort_by(|a, b| highest_first(a.0, b.0));
        // Lower scores are never thresholds, so what happens there is never seen.
        let lowest = matches.last().map_or(f64::INFINITY, |(score, _)| *score);
        let mut changes = Vec::new();
        for class_frame in class_frames {
            push_changes(class_frame, matching, lowest, &mut taken, &mut changes);
        }
        changes.sort_by(|a, b| highest_first(a.0, b.0));
        let detections: Vec<_> = detections.iter().filter(|detection| matching.counts(detection)).collect();

        let (mut steps, mut at) = (Vec::new(), Step { score: f64::INFINITY, matches: 0, detections: 0, changes: 0 });
        while let Some(&(score, _)) = matches.get(at.matches) {
            let run = |reached: &mut dyn Iterator<Item = f64>| reached.take_while(|&s| reaches(s, score)).count();
            at.score = score;
            at.matches += run(&mut matches[at.matches..].iter().map(|m| m.0));
            at.detections += run(&mut detections[at.detections..].iter().map(|d| d.score));
            at.changes += run(&mut changes[at.changes..].iter().map(|c| c.0));
            steps.push(at);
        }
        Self {
            min_overlap: matching.min_overlap,
            objects,
            matches: matches.into_iter().map(|(_, frame)| frame).collect(),
            detections: detections[..at.detections].iter().map(|detection| detection.frame).collect(),
            changes: changes[..at.changes].iter().map(|(_, change)| *change).collect(),
            steps,
        }
    }

    /// Objects that must be found.
    pub fn objects(&self) -> usize {
        self.objects.iter().map(|(_, count)| *count as usize).sum()
    }

    /// The curve when each frame counts once.
    pub(super) fn curve(&self, with_orientation: bool) -> Curve {
        let objects = self.objects();
        let positions = threshold_positions(objects as u64, self.matches.len() as u64);
        let mut positions = positions.iter().peekable();
        let mut thresholds = Vec::new();
        let (mut sum, mut start) = (Change::default(), 0);
        for step in &self.steps {
            for change in &self.changes[start..step.changes] {
                sum.found += change.found;
                sum.predicted += change.predicted;
                sum.missed += change.missed;
                sum.similarity += change.similarity;
            }
            start = step.changes;
            while positions.next_if(|position| **position < step.matches as u64).is_some() {
                let predicted = step.detections as i32 + sum.predicted;
                thresholds.push(ScoreThreshold {
                    score: step.score,
                    true_positives: sum.found as usize,
                    false_positives: (predicted - sum.found) as usize,
                    false_negatives: sum.missed as usize,
                    similarity: sum.similarity,
                });
            }
        }
        Curve::new(self.min_overlap, objects, self.matches.len(), thresholds, with_orientation)
    }

    /// AP when frame `i` of the set counts `drawn[i]` times; `drawn` must have an entry for every frame of the set.
    pub fn drawn_ap(&self, drawn: &[u32]) -> ApSample {
        let weights: Vec<_> = drawn.iter().map(|&count| [count]).collect();
        let [ap] = self.merged(&weights);
        ap
    }

    /// AP in several draws at once; `weights` says how often each frame counts in each of them.
    fn merged<const N: usize>(&self, weights: &[[u32; N]]) -> [ApSample; N] {
        let mut objects = [0; N];
        for &(frame, count) in &self.objects {
            add(&mut objects, &weights[frame as usize], |weight| weight * count);
        }
        let mut matched = [0; N];
        for &frame in &self.matches {
            add(&mut matched, &weights[frame as usize], |weight| weight);
        }
        let positions: [Vec<u64>; N] =
            std::array::from_fn(|lane| threshold_positions(u64::from(objects[lane]), u64::from(matched[lane])));
        let mut precision = [[0.0; RECALL_POINTS]; N];
        let (mut found, mut predicted, mut reached, mut next) = ([0_i32; N], [0_i32; N], [0_u32; N], [0; N]);
        let mut start = Step { score: f64::INFINITY, matches: 0, detections: 0, changes: 0 };
        for step in &self.steps {
            for &frame in &self.detections[start.detections..step.detections] {
                add(&mut predicted, &weights[frame as usize], |weight| weight as i32);
            }
            for change in &self.changes[start.changes..step.changes] {
                let weights = &weights[change.frame as usize];
                add(&mut found, weights, |weight| weight as i32 * change.found);
                add(&mut predicted, weights, |weight| weight as i32 * change.predicted);
            }
            for &frame in &self.matches[start.matches..step.matches] {
                add(&mut reached, &weights[frame as usize], |weight| weight);
            }
            start = *step;
            for lane in 0..N {
                let positions = &positions[lane];
                while positions.get(next[lane]).is_some_and(|position| *position < u64::from(reached[lane])) {
                    if predicted[lane] > 0 {
                        precision[lane][next[lane]] = f64::from(found[lane]) / f64::from(predicted[lane]);
                    }
                    next[lane] += 1;
                }
            }
        }
        std::array::from_fn(|lane| {
            if objects[lane] == 0 {
                return ApSample { r40: f64::NAN, r11: f64::NAN };
            }
            let points = &mut precision[lane];
            for i in (1..RECALL_POINTS).rev() {
                points[i - 1] = points[i - 1].max(points[i]);
            }
            ApSample { r40: percent_r40(points), r11: percent_r11(points) }
        })
    }

    /// AP of each of the curves in each resample of their `frames` frames. All curves see the same draws.
    pub(crate) fn resampled(curves: &[&Self], frames: usize, bootstrap: &Bootstrap) -> Vec<Vec<ApSample>> {
        let blocks = (0..bootstrap.resamples.div_ceil(LANES)).into_par_iter().map(|block| {
            let mut weights = vec![[0; LANES]; frames];
            for lane in 0..LANES {
                let drawn = bootstrap.draw(frames, block * LANES + lane);
                weights.iter_mut().zip(drawn).for_each(|(weights, count)| weights[lane] = count);
            }
            curves.iter().map(|curve| curve.merged(&weights)).collect::<Vec<_>>()
        });
        let blocks: Vec<_> = blocks.collect();
        let of_curve =
            |curve: usize| blocks.iter().flat_map(|block| block[curve]).take(bootstrap.resamples).collect::<Vec<_>>();
        (0..curves.len()).map(of_curve).collect()
    }
}

impl CurveOutcomes {
    /// The intervals of these curves of `frames` frames, in their order.
    pub(crate) fn intervals(
        curves: &[Option<Self>],
        frames: usize,
        bootstrap: &Bootstrap,
    ) -> Vec<Option<ApIntervals<Option<Interval>>>> {
        let there: Vec<_> = curves.iter().flatten().collect();
        let mut resampled = Self::resampled(&there, frames, bootstrap).into_iter();
        let intervals =
            curves.iter().map(|curve| curve.as_ref().and(resampled.next()).map(|aps| ApIntervals::of(&aps)));
        intervals.collect()
    }
}

fn add<T: std::ops::AddAssign, const N: usize>(sums: &mut [T; N], weights: &[u32; N], of: impl Fn(u32) -> T) {
    for (sum, weight) in sums.iter_mut().zip(weights) {
        *sum += of(*weight);
    }
}

/// Adds what changes in one frame, with the scores where it does; nothing below `lowest`.
fn push_changes(
    class_frame: &super::ClassFrame,
    matching: &Matching,
    lowest: f64,
    taken: &mut Vec<bool>,
    changes: &mut Vec<(f64, Change)>,
) {
    let frame = class_frame.frame;
    let predictions = &class_frame.predictions;
    for excused in predictions.iter().filter(|prediction| prediction.is_own && matching.excuses(prediction)) {
        if matching.counts(&excused.scored(frame)) && reaches(excused.score, lowest) {
            changes.push((excused.score, Change { frame, predicted: -1, ..Change::default() }));
        }
    }
    let candidates = class_frame.objects.iter().flat_map(|object| &object.overlapping);
    let enough = candidates.filter(|(_, overlaps)| overlaps.get(matching.metric) > matching.min_overlap);
    let scores = enough.map(|(position, _)| predictions[*position].score);
    // Above every score stand those that are no numbers: they reach any threshold.
    let mut starts: Vec<f64> = scores.filter(|score| *score >= lowest).chain(std::iter::once(f64::NAN)).collect();
    starts.sort_unstable_by(|a, b| highest_first(*a, *b));
    starts.dedup();
    let mut before = Counts::default();
    for &start in &starts {
        let here = counts(class_frame, matching, taken, |position| reaches(predictions[position].score, start));
        let change = Change {
            frame,
            found: here.found as i32 - before.found as i32,
            predicted: (here.found as i32 - here.matched as i32) - (before.found as i32 - before.matched as i32),
            missed: here.missed as i32 - before.missed as i32,
            similarity: here.similarity - before.similarity,
        };
        if change != (Change { frame, ..Change::default() }) {
            changes.push((start, change));
        }
        before = here;
    }
}

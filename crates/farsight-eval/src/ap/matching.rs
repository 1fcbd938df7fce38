//! Who matches whom in one frame: the devkit's two greedy passes (spec rules 11 to 15).

use super::class_frame::PredictionRole;
use super::scores::ScoredDetection;
use super::{ClassFrame, CurveSpec, FrameLabel, FramePrediction, Metric};
use crate::Difficulty;
use crate::parts::Part;

/// Scores at or below this never match (devkit, `NO_DETECTION`).
const NO_DETECTION: f64 = -1e7;

/// One of the curves: which objects, which overlap, how much of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Matching {
    pub(crate) metric: Metric,
    pub(crate) difficulty: Difficulty,
    /// The overlap that must be exceeded.
    pub(crate) min_overlap: f64,
    /// Objects elsewhere need not be found.
    pub(crate) part: Part,
}

/// What became of an object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum MatchOutcome {
    /// Found by the prediction at this position of the frame.
    Found(usize),
    /// Taken by the prediction at this position; neither counts as right or wrong.
    Taken(usize),
    /// It had to be found and was not.
    Missed,
    /// It need not be found and was not.
    Left,
}

/// What one frame adds to one point of a curve.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Counts {
    /// Objects found.
    pub(super) found: usize,
    /// Objects that must be found and were not.
    pub(super) missed: usize,
    /// Detections that would be false positives, had an object not taken them.
    pub(super) matched: usize,
    /// Sum of the orientation similarities of the found objects, each from 0 to 1.
    pub(super) similarity: f64,
}

impl Matching {
    pub(super) fn new(curve: &CurveSpec) -> Self {
        let CurveSpec { overlaps, metric, class, difficulty, part } = *curve;
        Self { metric, difficulty, min_overlap: overlaps.min_overlap(class, metric), part }
    }

    /// Whether the object is one of those that must be found.
    pub(crate) fn must_be_found(&self, label: &FrameLabel) -> bool {
        label.counts_at(self.difficulty) && self.part.holds(label.bins)
    }

    /// Whether the detection is wrong where no object takes it and no region excuses it.
    pub(super) fn counts(&self, detection: &ScoredDetection) -> bool {
        detection.size.is_some_and(|size| size <= self.difficulty) && self.part.judges(detection.bins)
    }

    /// Whether a `DontCare` region keeps the prediction from being a false positive.
    pub(crate) fn excuses(&self, prediction: &FramePrediction) -> bool {
        prediction.excuse.get(self.metric) > self.min_overlap
    }
}

/// The first pass: scores of the true positives when each object takes the best-scored detection.
pub(super) fn first_pass_scores(
    class_frame: &ClassFrame,
    matching: &Matching,
    taken: &mut Vec<bool>,
    scores: &mut Vec<f64>,
) {
    taken.clear();
    taken.resize(class_frame.predictions.len(), false);
    for object in &class_frame.objects {
        let mut best: Option<(usize, f64)> = None;
        for &(position, overlaps) in &object.overlapping {
            let prediction = &class_frame.predictions[position];
            let is_candidate = overlaps.get(matching.metric) > matching.min_overlap
                && !taken[position]
                && prediction.role_at(matching.difficulty) != PredictionRole::Other;
            // Strictly better, so the first one wins a tie; a score that is no number is never better.
            if is_candidate && prediction.score > best.map_or(NO_DETECTION, |(_, score)| score) {
                best = Some((position, prediction.score));
            }
        }
        if let Some((position, score)) = best {
            taken[position] = true;
            let counts = class_frame.predictions[position].role_at(matching.difficulty) == PredictionRole::Counts;
            if counts && matching.must_be_found(&object.label) {
                scores.push(score);
            }
        }
    }
}

/// The second pass: what becomes of each object when only the predictions at the positions that `takes_part` names are
/// there.
pub(crate) fn outcomes<'a>(
    class_frame: &'a ClassFrame,
    matching: &'a Matching,
    taken: &'a mut Vec<bool>,
    takes_part: impl Fn(usize) -> bool + 'a,
) -> impl Iterator<Item = MatchOutcome> + 'a {
    taken.clear();
    taken.resize(class_frame.predictions.len(), false);
    class_frame.objects.iter().map(move |object| {
        let mut best: Option<(usize, f64)> = None;
        let mut small = None;
        for &(position, overlaps) in &object.overlapping {
            let overlap = overlaps.get(matching.metric);
            if overlap <= matching.min_overlap || taken[position] || !takes_part(position) {
                continue;
            }
            match class_frame.predictions[position].role_at(matching.difficulty) {
                PredictionRole::Counts if best.is_none_or(|(_, largest)| overlap > largest) => {
                    best = Some((position, overlap));
                }
                PredictionRole::TooSmall => small = small.or(Some(position)),
                PredictionRole::Counts | PredictionRole::Other => {}
            }
        }
        let must_be_found = matching.must_be_found(&object.label);
        // A prediction of full size replaces a small one, whatever their overlaps.
        let Some(position) = best.map(|(position, _)| position).or(small) else {
            return if must_be_found { MatchOutcome::Missed } else { MatchOutcome::Left };
        };
        taken[position] = true;
        if must_be_found && best.is_some() { MatchOutcome::Found(position) } else { MatchOutcome::Taken(position) }
    })
}

/// The second pass in numbers.
pub(super) fn counts(
    class_frame: &ClassFrame,
    matching: &Matching,
    taken: &mut Vec<bool>,
    takes_part: impl Fn(usize) -> bool,
) -> Counts {
    let mut counts = Counts::default();
    for (outcome, object) in outcomes(class_frame, matching, taken, takes_part).zip(&class_frame.objects) {
        match outcome {
            MatchOutcome::Found(position) => {
                counts.found += 1;
                let turn = object.label.alpha_rad - class_frame.predictions[position].alpha_rad;
                counts.similarity += 0.5 * (1.0 + turn.cos());
            }
            MatchOutcome::Missed => counts.missed += 1,
            MatchOutcome::Taken(_) | MatchOutcome::Left => {}
        }
        if let MatchOutcome::Found(position) | MatchOutcome::Taken(position) = outcome {
            let prediction = &class_frame.predictions[position];
            let would_count = prediction.role_at(matching.difficulty) == PredictionRole::Counts
                && matching.part.judges(prediction.bins)
                && !matching.excuses(prediction);
            counts.matched += usize::from(would_count);
        }
    }
    counts
}

//! Who matches whom in one frame: the devkit's two greedy passes (spec rules 11 to 15).

use super::scene::ClaimRole;
use super::{Metric, OverlapSet, Scene, SceneClaim};
use crate::{Difficulty, EvaluatedClass};

/// Scores at or below this never match (devkit, `NO_DETECTION`).
const NO_DETECTION: f64 = -1e7;

/// One of the curves: which objects, which overlap, how much of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Matching {
    pub(crate) metric: Metric,
    pub(crate) difficulty: Difficulty,
    /// The overlap that must be exceeded.
    pub(crate) min_overlap: f64,
}

/// What became of an object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Fate {
    /// Found by the claim at this position of the scene.
    Found(usize),
    /// Taken by the claim at this position; neither counts as right or wrong.
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
    pub(super) claimed: usize,
    /// Sum of the orientation similarities of the found objects, each from 0 to 1.
    pub(super) similarity: f64,
}

impl Matching {
    pub(super) fn new(set: OverlapSet, metric: Metric, class: EvaluatedClass, difficulty: Difficulty) -> Self {
        Self { metric, difficulty, min_overlap: set.min_overlap(class, metric) }
    }

    /// Whether a `DontCare` region keeps the claim from being a false positive.
    pub(crate) fn excuses(&self, claim: &SceneClaim) -> bool {
        claim.excuse.get(self.metric) > self.min_overlap
    }
}

/// The first pass: scores of the true positives when each object takes the best-scored detection.
pub(super) fn first_pass_scores(scene: &Scene, matching: &Matching, taken: &mut Vec<bool>, scores: &mut Vec<f64>) {
    taken.clear();
    taken.resize(scene.claims.len(), false);
    for object in &scene.objects {
        let mut best: Option<(usize, f64)> = None;
        for &(position, overlaps) in &object.overlapping {
            let claim = &scene.claims[position];
            let is_candidate = overlaps.get(matching.metric) > matching.min_overlap
                && !taken[position]
                && claim.role_at(matching.difficulty) != ClaimRole::Other;
            // Strictly better, so the first one wins a tie; a score that is no number is never better.
            if is_candidate && claim.score > best.map_or(NO_DETECTION, |(_, score)| score) {
                best = Some((position, claim.score));
            }
        }
        if let Some((position, score)) = best {
            taken[position] = true;
            let counts = scene.claims[position].role_at(matching.difficulty) == ClaimRole::Counts;
            if counts && object.label.counts_at(matching.difficulty) {
                scores.push(score);
            }
        }
    }
}

/// The second pass: what becomes of each object when only the claims at the positions that `takes_part` names are there.
pub(crate) fn fates<'a>(
    scene: &'a Scene,
    matching: &'a Matching,
    taken: &'a mut Vec<bool>,
    takes_part: impl Fn(usize) -> bool + 'a,
) -> impl Iterator<Item = Fate> + 'a {
    taken.clear();
    taken.resize(scene.claims.len(), false);
    scene.objects.iter().map(move |object| {
        let mut best: Option<(usize, f64)> = None;
        let mut small = None;
        for &(position, overlaps) in &object.overlapping {
            let overlap = overlaps.get(matching.metric);
            if overlap <= matching.min_overlap || taken[position] || !takes_part(position) {
                continue;
            }
            match scene.claims[position].role_at(matching.difficulty) {
                ClaimRole::Counts if best.is_none_or(|(_, largest)| overlap > largest) => {
                    best = Some((position, overlap));
                }
                ClaimRole::TooSmall => small = small.or(Some(position)),
                ClaimRole::Counts | ClaimRole::Other => {}
            }
        }
        let must_be_found = object.label.counts_at(matching.difficulty);
        // A claim of full size replaces a small one, whatever their overlaps.
        let Some(position) = best.map(|(position, _)| position).or(small) else {
            return if must_be_found { Fate::Missed } else { Fate::Left };
        };
        taken[position] = true;
        if must_be_found && best.is_some() { Fate::Found(position) } else { Fate::Taken(position) }
    })
}

/// The second pass in numbers.
pub(super) fn counts(
    scene: &Scene,
    matching: &Matching,
    taken: &mut Vec<bool>,
    takes_part: impl Fn(usize) -> bool,
) -> Counts {
    let mut counts = Counts::default();
    for (fate, object) in fates(scene, matching, taken, takes_part).zip(&scene.objects) {
        match fate {
            Fate::Found(position) => {
                counts.found += 1;
                let turn = object.label.alpha_rad - scene.claims[position].alpha_rad;
                counts.similarity += 0.5 * (1.0 + turn.cos());
            }
            Fate::Missed => counts.missed += 1,
            Fate::Taken(_) | Fate::Left => {}
        }
        if let Fate::Found(position) | Fate::Taken(position) = fate {
            let claim = &scene.claims[position];
            let would_count = claim.role_at(matching.difficulty) == ClaimRole::Counts && !matching.excuses(claim);
            counts.claimed += usize::from(would_count);
        }
    }
    counts
}

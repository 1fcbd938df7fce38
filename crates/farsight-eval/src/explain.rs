//! What became of every object and every detection of one frame, and by which rule.

use std::fmt;

use farsight_core::ObjectClass;
use farsight_core::overlap::{Block, iou_2d};

use crate::ap::{ApAccumulator, ClassFrame, MatchOutcome, Matching, Metric, OverlapSet, outcomes};
use crate::class::Role;
use crate::difficulty::DifficultyLimit;
use crate::parts::Part;
use crate::{Difficulty, EvaluatedClass, Frame};

/// How to look at a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExplainOptions {
    /// What overlaps are measured on.
    pub metric: Metric,
    /// How much overlap it takes.
    pub overlaps: OverlapSet,
    /// Detections with a lower score take no part. The curves look at up to 41 such limits; this is one of them.
    pub min_score: Option<f64>,
}

/// The outcomes of a frame at the three difficulties.
#[derive(Debug, Clone, PartialEq)]
pub struct Explanation {
    /// For each label, in file order: easy, moderate, hard.
    pub objects: Vec<[ObjectOutcome; 3]>,
    /// For each detection, in file order: easy, moderate, hard.
    pub predictions: Vec<[PredictionOutcome; 3]>,
}

/// What became of a labelled object. Positions count from 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ObjectOutcome {
    /// A detection found it: a true positive.
    Found {
        /// Position of the detection.
        prediction: usize,
        /// How much they overlap.
        overlap: f64,
    },
    /// It counts and nobody found it.
    Missed {
        /// The detection of its class that comes nearest, and their overlap.
        nearest: Option<(usize, f64)>,
    },
    /// Only a detection too small to count lies on it: neither found nor missed (spec rule 14).
    MatchedBySmall {
        /// Position of the detection.
        prediction: usize,
    },
    /// It need not be found.
    Ignored {
        /// Why.
        reason: IgnoreReason,
        /// The detection on it, which is neither right nor wrong either.
        prediction: Option<usize>,
    },
    /// A region that was not labelled; excuses detections in the image.
    DontCare,
    /// Its class is not evaluated: a detection on it is wrong.
    NotEvaluated,
}

/// Why an object need not be found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum IgnoreReason {
    /// It does not count at this difficulty.
    Level(DifficultyLimit),
    /// It is of a class that looks like an evaluated one.
    Neighbour(EvaluatedClass),
}

/// What became of a detection. Positions count from 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PredictionOutcome {
    /// It found an object.
    TruePositive {
        /// Position of the label.
        object: usize,
        /// How much they overlap.
        overlap: f64,
    },
    /// It found nothing.
    FalsePositive {
        /// The label that it overlaps most, of whatever class.
        nearest: Option<(usize, f64)>,
    },
    /// It lies on an object that need not be found.
    OnIgnored {
        /// Position of the label.
        object: usize,
    },
    /// It is not high enough in the image to count.
    TooSmall,
    /// A `DontCare` region covers it.
    InDontCare,
    /// Its score is too low to take part.
    BelowScore,
    /// Its class is not evaluated.
    NotEvaluated,
}

/// Explains one frame.
pub fn explain(frame: &Frame, options: &ExplainOptions) -> Explanation {
    let class_frames = EvaluatedClass::ALL.map(|class| ApAccumulator::class_frame(frame, class));
    let mut explanation = Explanation {
        objects: frame.labels.iter().map(|label| [unmatched_object(&label.class); 3]).collect(),
        predictions: vec![[PredictionOutcome::NotEvaluated; 3]; frame.predictions.len()],
    };
    for (class, class_frame) in EvaluatedClass::ALL.into_iter().zip(&class_frames) {
        for difficulty in Difficulty::ALL {
            Explainer { frame, options, class, difficulty, class_frame }.explain(&mut explanation);
        }
    }
    explanation
}

fn unmatched_object(class: &ObjectClass) -> ObjectOutcome {
    if class.eq_ignore_case(&ObjectClass::DontCare) { ObjectOutcome::DontCare } else { ObjectOutcome::NotEvaluated }
}

/// One frame for one class and difficulty.
struct Explainer<'a> {
    frame: &'a Frame,
    options: &'a ExplainOptions,
    class: EvaluatedClass,
    difficulty: Difficulty,
    class_frame: &'a ClassFrame,
}

impl Explainer<'_> {
    fn explain(&self, explanation: &mut Explanation) {
        let level = self.difficulty as usize;
        let min_overlap = self.options.overlaps.min_overlap(self.class, self.options.metric);
        let matching =
            Matching { metric: self.options.metric, difficulty: self.difficulty, min_overlap, part: Part::Whole };
        let mut taken = Vec::new();
        let takes_part = |position: usize| !self.is_below(self.class_frame.predictions[position].score);
        let outcomes: Vec<_> = outcomes(self.class_frame, &matching, &mut taken, takes_part).collect();

        for (index, prediction) in self.frame.predictions.iter().enumerate() {
            if EvaluatedClass::of(&prediction.detection.class) == Some(self.class) {
                explanation.predictions[index][level] = self.unmatched_prediction(index, &matching);
            }
        }
        for (object, outcome) in self.class_frame.objects.iter().zip(outcomes) {
            let label = object.label.index;
            explanation.objects[label][level] = self.object_outcome(label, outcome, object);
            let (MatchOutcome::Found(position) | MatchOutcome::Taken(position)) = outcome else { continue };
            let prediction = self.class_frame.predictions[position];
            // A small detection of another class can be taken too; its own class explains it.
            if prediction.is_own && !self.is_small(prediction.index) {
                explanation.predictions[prediction.index][level] = match outcome {
                    MatchOutcome::Found(_) => PredictionOutcome::TruePositive {
                        object: label,
                        overlap: self.overlap(prediction.index, label),
                    },
                    _ => PredictionOutcome::OnIgnored { object: label },
                };
            }
        }
    }

    fn object_outcome(&self, label: usize, outcome: MatchOutcome, object: &crate::ap::FrameObject) -> ObjectOutcome {
        let prediction_at = |position: usize| self.class_frame.predictions[position].index;
        let taken_by = match outcome {
            MatchOutcome::Found(position) | MatchOutcome::Taken(position) => Some(prediction_at(position)),
            MatchOutcome::Missed | MatchOutcome::Left => None,
        };
        match (self.ignore_reason(label), outcome, taken_by) {
            (Some(reason), _, prediction) => ObjectOutcome::Ignored { reason, prediction },
            (None, MatchOutcome::Found(_), Some(prediction)) => {
                ObjectOutcome::Found { prediction, overlap: self.overlap(prediction, label) }
            }
            (None, _, Some(prediction)) => ObjectOutcome::MatchedBySmall { prediction },
            (None, _, None) => {
                debug_assert!(object.label.counts_at(self.difficulty));
                ObjectOutcome::Missed { nearest: self.nearest_prediction(label) }
            }
        }
    }

    fn ignore_reason(&self, label: usize) -> Option<IgnoreReason> {
        let label = &self.frame.labels[label];
        match self.class.role(&label.class) {
            Role::Neighbour => Some(IgnoreReason::Neighbour(self.class)),
            _ => self.difficulty.reason_to_ignore(label).map(IgnoreReason::Level),
        }
    }

    fn unmatched_prediction(&self, index: usize, matching: &Matching) -> PredictionOutcome {
        let is_excused = self
            .class_frame
            .predictions
            .iter()
            .any(|prediction| prediction.index == index && prediction.is_own && matching.excuses(prediction));
        if self.is_below(self.frame.predictions[index].detection.score) {
            PredictionOutcome::BelowScore
        } else if self.is_small(index) {
            PredictionOutcome::TooSmall
        } else if is_excused {
            PredictionOutcome::InDontCare
        } else {
            let objects = (0..self.frame.labels.len()).map(|label| (label, self.overlap(index, label)));
            PredictionOutcome::FalsePositive { nearest: largest(objects) }
        }
    }

    fn nearest_prediction(&self, label: usize) -> Option<(usize, f64)> {
        let predictions = self.frame.predictions.iter().enumerate();
        let own =
            predictions.filter(|(_, prediction)| EvaluatedClass::of(&prediction.detection.class) == Some(self.class));
        largest(own.map(|(index, _)| (index, self.overlap(index, label))))
    }

    fn is_small(&self, prediction: usize) -> bool {
        self.difficulty.ignores_detection(&self.frame.predictions[prediction].detection.box2d)
    }

    fn is_below(&self, score: f64) -> bool {
        self.options.min_score.is_some_and(|min| score < min)
    }

    fn overlap(&self, prediction: usize, label: usize) -> f64 {
        let (detection, label) = (&self.frame.predictions[prediction].detection, &self.frame.labels[label]);
        let box3d = || Block::new(&detection.box3d).overlap(&Block::new(&label.box3d));
        match self.options.metric {
            Metric::Image => iou_2d(&detection.box2d, &label.box2d),
            Metric::Bev => box3d().bev,
            Metric::Box3d => box3d().volume,
        }
    }
}

/// The pair with the largest overlap above 0.
fn largest(overlaps: impl Iterator<Item = (usize, f64)>) -> Option<(usize, f64)> {
    overlaps.filter(|(_, overlap)| *overlap > 0.0).max_by(|a, b| a.1.total_cmp(&b.1))
}

impl fmt::Display for IgnoreReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Level(DifficultyLimit::Occluded) => f.pad("occluded"),
            Self::Level(DifficultyLimit::Truncated) => f.pad("truncated"),
            Self::Level(DifficultyLimit::Small) => f.pad("too small"),
            Self::Neighbour(class) => write!(f, "looks like a {class}"),
        }
    }
}

impl fmt::Display for ObjectOutcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Found { prediction, overlap } => write!(f, "found by d{prediction} ({overlap:.3})"),
            Self::Missed { nearest: None } => write!(f, "missed"),
            Self::Missed { nearest: Some((prediction, overlap)) } => {
                write!(f, "missed (nearest d{prediction}, {overlap:.3})")
            }
            Self::MatchedBySmall { prediction } => write!(f, "neither: d{prediction} too small"),
            Self::Ignored { reason, prediction: None } => write!(f, "ignored: {reason}"),
            Self::Ignored { reason, prediction: Some(prediction) } => write!(f, "ignored: {reason} (d{prediction})"),
            Self::DontCare => write!(f, "excuses"),
            Self::NotEvaluated => write!(f, "not evaluated"),
        }
    }
}

impl fmt::Display for PredictionOutcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TruePositive { object, overlap } => write!(f, "true: g{object} ({overlap:.3})"),
            Self::FalsePositive { nearest: None } => write!(f, "false: nothing there"),
            Self::FalsePositive { nearest: Some((object, overlap)) } => write!(f, "false: g{object} ({overlap:.3})"),
            Self::OnIgnored { object } => write!(f, "ignored: on g{object}"),
            Self::TooSmall => write!(f, "ignored: too small"),
            Self::InDontCare => write!(f, "ignored: DontCare"),
            Self::BelowScore => write!(f, "below the score"),
            Self::NotEvaluated => write!(f, "not evaluated"),
        }
    }
}

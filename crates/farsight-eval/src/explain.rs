//! What became of every object and every detection of one frame, and by which rule.

use std::fmt;

use farsight_core::ObjectClass;
use farsight_core::overlap::{Block, iou_2d};

use crate::ap::{Fate, Matching, Metric, OverlapSet, Scene, SceneSet, fates};
use crate::class::Role;
use crate::difficulty::Ignored;
use crate::{Difficulty, EvaluatedClass, Frame};

/// How to look at a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// What overlaps are measured on.
    pub metric: Metric,
    /// How much overlap it takes.
    pub overlaps: OverlapSet,
    /// Detections with a lower score take no part. The curves look at up to 41 such limits; this is one of them.
    pub min_score: Option<f64>,
}

/// The fates of a frame at the three difficulties.
#[derive(Debug, Clone, PartialEq)]
pub struct Explanation {
    /// For each label, in file order: easy, moderate, hard.
    pub objects: Vec<[ObjectFate; 3]>,
    /// For each detection, in file order: easy, moderate, hard.
    pub claims: Vec<[ClaimFate; 3]>,
}

/// What became of a labelled object. Positions count from 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ObjectFate {
    /// A detection found it: a true positive.
    Found {
        /// Position of the detection.
        claim: usize,
        /// How much they overlap.
        overlap: f64,
    },
    /// It counts and nobody found it.
    Missed {
        /// The detection of its class that comes nearest, and their overlap.
        nearest: Option<(usize, f64)>,
    },
    /// Only a detection too small to count lies on it: neither found nor missed (spec rule 14).
    Swallowed {
        /// Position of the detection.
        claim: usize,
    },
    /// It need not be found.
    Ignored {
        /// Why.
        why: WhyIgnored,
        /// The detection on it, which is neither right nor wrong either.
        claim: Option<usize>,
    },
    /// A region that was not labelled; excuses detections in the image.
    DontCare,
    /// Its class is not evaluated: a detection on it is wrong.
    NotEvaluated,
}

/// Why an object need not be found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WhyIgnored {
    /// It does not count at this difficulty.
    Level(Ignored),
    /// It is of a class that looks like an evaluated one.
    Neighbour(EvaluatedClass),
}

/// What became of a detection. Positions count from 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ClaimFate {
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
pub fn explain(frame: &Frame, view: &View) -> Explanation {
    let scenes = EvaluatedClass::ALL.map(|class| SceneSet::scene(frame, class));
    let mut explanation = Explanation {
        objects: frame.labels.iter().map(|label| [unmatched_object(&label.class); 3]).collect(),
        claims: vec![[ClaimFate::NotEvaluated; 3]; frame.claims.len()],
    };
    for (class, scene) in EvaluatedClass::ALL.into_iter().zip(&scenes) {
        for difficulty in Difficulty::ALL {
            Explainer { frame, view, class, difficulty, scene }.explain(&mut explanation);
        }
    }
    explanation
}

fn unmatched_object(class: &ObjectClass) -> ObjectFate {
    if class.is_in_any_case(&ObjectClass::DontCare) { ObjectFate::DontCare } else { ObjectFate::NotEvaluated }
}

/// One frame for one class and difficulty.
struct Explainer<'a> {
    frame: &'a Frame,
    view: &'a View,
    class: EvaluatedClass,
    difficulty: Difficulty,
    scene: &'a Scene,
}

impl Explainer<'_> {
    fn explain(&self, explanation: &mut Explanation) {
        let level = self.difficulty as usize;
        let min_overlap = self.view.overlaps.min_overlap(self.class, self.view.metric);
        let matching = Matching { metric: self.view.metric, difficulty: self.difficulty, min_overlap };
        let mut taken = Vec::new();
        let takes_part = |position: usize| !self.is_below(self.scene.claims[position].score);
        let fates: Vec<_> = fates(self.scene, &matching, &mut taken, takes_part).collect();

        for (index, claim) in self.frame.claims.iter().enumerate() {
            if EvaluatedClass::of(&claim.detection.class) == Some(self.class) {
                explanation.claims[index][level] = self.untaken_claim(index, &matching);
            }
        }
        for (object, fate) in self.scene.objects.iter().zip(fates) {
            let label = object.label.index;
            explanation.objects[label][level] = self.object_fate(label, fate, object);
            let (Fate::Found(position) | Fate::Taken(position)) = fate else { continue };
            let claim = self.scene.claims[position];
            // A small detection of another class can be taken too; its own class explains it.
            if claim.is_own && !self.is_small(claim.index) {
                explanation.claims[claim.index][level] = match fate {
                    Fate::Found(_) => {
                        ClaimFate::TruePositive { object: label, overlap: self.overlap(claim.index, label) }
                    }
                    _ => ClaimFate::OnIgnored { object: label },
                };
            }
        }
    }

    fn object_fate(&self, label: usize, fate: Fate, object: &crate::ap::SceneObject) -> ObjectFate {
        let claim_at = |position: usize| self.scene.claims[position].index;
        let taken_by = match fate {
            Fate::Found(position) | Fate::Taken(position) => Some(claim_at(position)),
            Fate::Missed | Fate::Left => None,
        };
        match (self.why_ignored(label), fate, taken_by) {
            (Some(why), _, claim) => ObjectFate::Ignored { why, claim },
            (None, Fate::Found(_), Some(claim)) => ObjectFate::Found { claim, overlap: self.overlap(claim, label) },
            (None, _, Some(claim)) => ObjectFate::Swallowed { claim },
            (None, _, None) => {
                debug_assert!(object.label.counts_at(self.difficulty));
                ObjectFate::Missed { nearest: self.nearest_claim(label) }
            }
        }
    }

    fn why_ignored(&self, label: usize) -> Option<WhyIgnored> {
        let label = &self.frame.labels[label];
        match self.class.role(&label.class) {
            Role::Neighbour => Some(WhyIgnored::Neighbour(self.class)),
            _ => self.difficulty.reason_to_ignore(label).map(WhyIgnored::Level),
        }
    }

    fn untaken_claim(&self, index: usize, matching: &Matching) -> ClaimFate {
        let is_excused =
            self.scene.claims.iter().any(|claim| claim.index == index && claim.is_own && matching.excuses(claim));
        if self.is_below(self.frame.claims[index].detection.score) {
            ClaimFate::BelowScore
        } else if self.is_small(index) {
            ClaimFate::TooSmall
        } else if is_excused {
            ClaimFate::InDontCare
        } else {
            let objects = (0..self.frame.labels.len()).map(|label| (label, self.overlap(index, label)));
            ClaimFate::FalsePositive { nearest: largest(objects) }
        }
    }

    fn nearest_claim(&self, label: usize) -> Option<(usize, f64)> {
        let claims = self.frame.claims.iter().enumerate();
        let own = claims.filter(|(_, claim)| EvaluatedClass::of(&claim.detection.class) == Some(self.class));
        largest(own.map(|(index, _)| (index, self.overlap(index, label))))
    }

    fn is_small(&self, claim: usize) -> bool {
        self.difficulty.ignores_detection(&self.frame.claims[claim].detection.box2d)
    }

    fn is_below(&self, score: f64) -> bool {
        self.view.min_score.is_some_and(|min| score < min)
    }

    fn overlap(&self, claim: usize, label: usize) -> f64 {
        let (detection, label) = (&self.frame.claims[claim].detection, &self.frame.labels[label]);
        let scene = || Block::new(&detection.box3d).overlap(&Block::new(&label.box3d));
        match self.view.metric {
            Metric::Image => iou_2d(&detection.box2d, &label.box2d),
            Metric::Bev => scene().bev,
            Metric::Space => scene().volume,
        }
    }
}

/// The pair with the largest overlap above 0.
fn largest(overlaps: impl Iterator<Item = (usize, f64)>) -> Option<(usize, f64)> {
    overlaps.filter(|(_, overlap)| *overlap > 0.0).max_by(|a, b| a.1.total_cmp(&b.1))
}

impl fmt::Display for WhyIgnored {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Level(Ignored::Occluded) => f.pad("occluded"),
            Self::Level(Ignored::Truncated) => f.pad("truncated"),
            Self::Level(Ignored::Small) => f.pad("too small"),
            Self::Neighbour(class) => write!(f, "looks like a {class}"),
        }
    }
}

impl fmt::Display for ObjectFate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Found { claim, overlap } => write!(f, "found by d{claim} ({overlap:.3})"),
            Self::Missed { nearest: None } => write!(f, "missed"),
            Self::Missed { nearest: Some((claim, overlap)) } => write!(f, "missed (nearest d{claim}, {overlap:.3})"),
            Self::Swallowed { claim } => write!(f, "neither: d{claim} too small"),
            Self::Ignored { why, claim: None } => write!(f, "ignored: {why}"),
            Self::Ignored { why, claim: Some(claim) } => write!(f, "ignored: {why} (d{claim})"),
            Self::DontCare => write!(f, "excuses"),
            Self::NotEvaluated => write!(f, "not evaluated"),
        }
    }
}

impl fmt::Display for ClaimFate {
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

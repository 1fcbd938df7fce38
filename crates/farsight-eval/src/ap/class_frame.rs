//! What one frame comes down to for one class.

use farsight_core::overlap::{Block, covered_share_2d, iou_2d};
use farsight_core::{Label, ObjectClass};

use super::scores::ScoredDetection;
use super::{Metric, Overlaps};
use crate::class::Role;
use crate::parts::Bins;
use crate::{Difficulty, EvaluatedClass, Frame, Prediction};

/// The objects that matter to a class in one frame, and the detections that overlap them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ClassFrame {
    /// Position of the frame in the set.
    pub(super) frame: u32,
    /// Objects of the class and its neighbours, in file order.
    pub objects: Vec<FrameObject>,
    /// Detections that overlap one of them, or a `DontCare` region, enough to matter; in file order.
    pub predictions: Vec<FramePrediction>,
    /// All detections of the class.
    pub(super) detections: Vec<ScoredDetection>,
}

/// The frames as one class sees them, in their order.
pub(super) type ClassFrames = [ClassFrame];

/// A labelled object.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameObject {
    /// What is known of it.
    pub label: FrameLabel,
    /// Positions in [`ClassFrame::predictions`] of detections that overlap it, in file order, with the overlaps.
    pub overlapping: Vec<(usize, Overlaps)>,
}

/// A label, seen from one class.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameLabel {
    /// Position in the frame's labels.
    pub index: usize,
    /// The easiest level at which it must be found; `None` for neighbours and objects that never count.
    pub difficulty: Option<Difficulty>,
    /// Where it stands in the divisions of the data set.
    pub(crate) bins: Bins,
    /// Observation angle, radians.
    pub alpha_rad: f64,
}

/// A detection, seen from one class.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FramePrediction {
    /// Position in the frame's predictions.
    pub index: usize,
    /// Whether it is of the class.
    pub is_own: bool,
    /// The easiest level at which it is not too small; `None` when it always is.
    pub size: Option<Difficulty>,
    /// Its height and distance.
    pub(crate) bins: Bins,
    /// Its score.
    pub score: f64,
    /// Observation angle, radians.
    pub alpha_rad: f64,
    /// The largest share of it that a `DontCare` region covers.
    pub excuse: Overlaps,
}

/// What a detection counts as at one difficulty (spec rule 9).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum PredictionRole {
    /// Right or wrong.
    Counts,
    /// Too small, of **whatever** class: takes objects, but is neither right nor wrong.
    TooSmall,
    /// Of another class: not there.
    Other,
}

/// The boxes of a frame, prepared once for all classes.
pub(super) struct Prepared<'a> {
    frame: &'a Frame,
    label_blocks: Vec<Block>,
    prediction_blocks: Vec<Block>,
    prediction_sizes: Vec<Option<Difficulty>>,
    prediction_bins: Vec<Bins>,
    /// Positions of the `DontCare` regions.
    dont_care: Vec<usize>,
}

impl FrameLabel {
    /// Whether it must be found at this level.
    pub fn counts_at(&self, difficulty: Difficulty) -> bool {
        self.difficulty.is_some_and(|easiest| easiest <= difficulty)
    }
}

impl FramePrediction {
    pub(crate) fn role_at(&self, difficulty: Difficulty) -> PredictionRole {
        match self.size {
            Some(easiest) if easiest <= difficulty => {
                if self.is_own {
                    PredictionRole::Counts
                } else {
                    PredictionRole::Other
                }
            }
            _ => PredictionRole::TooSmall,
        }
    }
}

impl FramePrediction {
    /// As one of the detections of its class in this frame.
    pub(super) fn scored(&self, frame: u32) -> ScoredDetection {
        ScoredDetection { score: self.score, frame, size: self.size, bins: self.bins }
    }
}

impl<'a> Prepared<'a> {
    pub(super) fn new(frame: &'a Frame) -> Self {
        let size = |prediction: &Prediction| {
            Difficulty::ALL.into_iter().find(|level| !level.ignores_detection(&prediction.detection.box2d))
        };
        let labels = frame.labels.iter().enumerate();
        Self {
            frame,
            label_blocks: frame.labels.iter().map(|label| Block::new(&label.box3d)).collect(),
            prediction_blocks: frame
                .predictions
                .iter()
                .map(|prediction| Block::new(&prediction.detection.box3d))
                .collect(),
            prediction_sizes: frame.predictions.iter().map(size).collect(),
            prediction_bins: frame.predictions.iter().map(|p| Bins::of_detection(&p.detection)).collect(),
            dont_care: labels
                .filter(|(_, label)| label.class.eq_ignore_case(&ObjectClass::DontCare))
                .map(|(index, _)| index)
                .collect(),
        }
    }

    /// The frame as one class sees it; `classes` says what each prediction is.
    pub(super) fn class_frame(&self, class: EvaluatedClass, classes: &[Option<EvaluatedClass>]) -> ClassFrame {
        let mut objects: Vec<_> = self.frame.labels.iter().enumerate().filter_map(|row| object(class, row)).collect();
        let mut class_frame = ClassFrame::default();
        for (index, prediction) in self.frame.predictions.iter().enumerate() {
            let (size, bins) = (self.prediction_sizes[index], self.prediction_bins[index]);
            let (is_own, score) = (classes[index] == Some(class), prediction.detection.score);
            if is_own {
                class_frame.detections.push(ScoredDetection { score, frame: 0, size, bins });
            }
            // Large detections of other classes are not there; the smallest ones are in no level's way but all may be
            // taken by an object.
            if !is_own && size == Some(Difficulty::Easy) {
                continue;
            }
            let position = class_frame.predictions.len();
            let mut matters = false;
            for object in &mut objects {
                let overlaps = self.overlaps(index, object.label.index);
                if overlaps.matter(class) {
                    object.overlapping.push((position, overlaps));
                    matters = true;
                }
            }
            let excuse = if is_own { self.excuse(index) } else { Overlaps::default() };
            if matters || excuse.matter(class) {
                let alpha_rad = prediction.alpha_rad;
                class_frame.predictions.push(FramePrediction { index, is_own, size, bins, score, alpha_rad, excuse });
            }
        }
        // Kept for the whole set.
        class_frame.predictions.shrink_to_fit();
        for object in &mut objects {
            object.overlapping.shrink_to_fit();
        }
        objects.shrink_to_fit();
        class_frame.objects = objects;
        class_frame
    }

    fn overlaps(&self, prediction: usize, label: usize) -> Overlaps {
        let image = iou_2d(&self.frame.predictions[prediction].detection.box2d, &self.frame.labels[label].box2d);
        Overlaps { image, box3d: self.prediction_blocks[prediction].overlap(&self.label_blocks[label]) }
    }

    /// The devkit measures `DontCare` in every metric. Beyond the image its default box is nowhere near a real one,
    /// but coincides with that of a detection without 3D box seen from above (spec rule 16, quirk Q2); in space the
    /// two share no height.
    fn excuse(&self, prediction: usize) -> Overlaps {
        let covered = self.dont_care.iter().map(|&region| Overlaps {
            image: covered_share_2d(
                &self.frame.predictions[prediction].detection.box2d,
                &self.frame.labels[region].box2d,
            ),
            box3d: self.prediction_blocks[prediction].covered(&self.label_blocks[region]),
        });
        covered.fold(Overlaps::default(), Overlaps::largest)
    }
}

fn object(class: EvaluatedClass, (index, label): (usize, &Label)) -> Option<FrameObject> {
    let difficulty = match class.role(&label.class) {
        Role::Own => Difficulty::of(label),
        Role::Neighbour => None,
        Role::Other => return None,
    };
    let label = FrameLabel { index, difficulty, bins: Bins::of_label(label), alpha_rad: label.alpha };
    Some(FrameObject { label, overlapping: Vec::new() })
}

/// Whether a detection lets its class be evaluated in each metric (spec rule 6).
pub(super) fn enabled_metrics(prediction: &Prediction) -> [bool; 3] {
    /// What the devkit takes for "no 3D box".
    const NOWHERE: f64 = -1000.0;
    let detection = &prediction.detection;
    let [x, y, z] = detection.box3d.location;
    let size = detection.box3d.dimensions;
    let on_ground = x != NOWHERE && z != NOWHERE && size.width > 0.0 && size.length > 0.0;
    Metric::ALL.map(|metric| match metric {
        Metric::Image => detection.box2d.x1 >= 0.0,
        Metric::Bev => on_ground,
        Metric::Box3d => on_ground && y != NOWHERE && size.height > 0.0,
    })
}

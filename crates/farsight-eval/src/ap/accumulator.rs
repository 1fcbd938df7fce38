//! What AP needs to know of all frames of a result set.

use rayon::prelude::*;

use super::class_frame::{Prepared, enabled_metrics};
use super::matching::Matching;
use super::report::ApReport;
use super::scores::{Scores, SizedScores};
use super::{ClassFrame, Curve, Metric, OverlapSet};
use crate::{Difficulty, EvaluatedClass, Frame};

/// The devkit's mark for "no angle known", exactly.
const NO_ALPHA: f64 = -10.0;

/// What AP needs to know of a set of frames; grows by a few hundred bytes a frame and eight bytes a detection.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ApAccumulator {
    class_frames: [Vec<ClassFrame>; 3],
    scores: [SizedScores; 3],
    enabled: [[bool; 3]; 3],
    lacks_alpha: bool,
}

impl ApAccumulator {
    /// A set without frames.
    pub fn new() -> Self {
        Self::default()
    }

    /// What `frame` comes down to for `class`.
    pub fn class_frame(frame: &Frame, class: EvaluatedClass) -> ClassFrame {
        Prepared::new(frame).class_frame(class, &classes_of(frame))
    }

    /// Reduces `frame`, alone; the frames of a large set can be observed on many threads.
    pub fn of_frame(frame: &Frame) -> Self {
        let prepared = Prepared::new(frame);
        let classes = classes_of(frame);
        let mut set = Self::new();
        for class in EvaluatedClass::ALL {
            let mut class_frame = prepared.class_frame(class, &classes);
            for (score, size) in std::mem::take(&mut class_frame.scores) {
                if let Some(size) = size {
                    set.scores[class as usize].add(score, size);
                }
            }
            if !class_frame.objects.is_empty() || !class_frame.predictions.is_empty() {
                set.class_frames[class as usize].push(class_frame);
            }
        }
        for (prediction, class) in frame.predictions.iter().zip(&classes) {
            set.lacks_alpha |= prediction.alpha_rad == NO_ALPHA;
            if let Some(class) = class {
                let enabled = &mut set.enabled[*class as usize];
                enabled.iter_mut().zip(enabled_metrics(prediction)).for_each(|(old, new)| *old |= new);
            }
        }
        set
    }

    /// Adds frames after those that are here.
    pub fn append(&mut self, mut other: Self) {
        for class in 0..EvaluatedClass::ALL.len() {
            self.class_frames[class].append(&mut other.class_frames[class]);
            self.scores[class].append(&mut other.scores[class]);
            self.enabled[class].iter_mut().zip(other.enabled[class]).for_each(|(old, new)| *old |= new);
        }
        self.lacks_alpha |= other.lacks_alpha;
    }

    /// Draws all curves.
    pub fn report(&self) -> ApReport {
        let counting: Vec<_> = self.scores.par_iter().map(SizedScores::by_difficulty).collect();
        let mut wanted = Vec::new();
        for set in OverlapSet::ALL {
            for metric in Metric::ALL {
                for class in EvaluatedClass::ALL {
                    for difficulty in Difficulty::ALL {
                        wanted.push((set, metric, class, difficulty));
                    }
                }
            }
        }
        let curves = wanted.into_par_iter().map(|(set, metric, class, difficulty)| {
            // In the image both sets are the same; the report hands out the strict curve.
            let is_copy = set == OverlapSet::Loose && metric == Metric::Image;
            let is_drawn = self.enabled[class as usize][metric as usize] && !is_copy;
            is_drawn.then(|| {
                let matching = Matching::new(set, metric, class, difficulty);
                let class_frames = &self.class_frames[class as usize];
                let counting = &counting[class as usize][difficulty as usize];
                let with_orientation = metric == Metric::Image && !self.lacks_alpha;
                Curve::new(class_frames, &matching, &Scores::new(counting, class_frames, &matching), with_orientation)
            })
        });
        ApReport::new(curves.collect(), self.scores.each_ref().map(SizedScores::range), !self.lacks_alpha)
    }
}

fn classes_of(frame: &Frame) -> Vec<Option<EvaluatedClass>> {
    frame.predictions.iter().map(|prediction| EvaluatedClass::of(&prediction.detection.class)).collect()
}

//! What AP needs to know of all frames of a result set.

use rayon::prelude::*;

use super::class_frame::{Prepared, enabled_metrics};
use super::matching::Matching;
use super::report::ApReport;
use super::scores::{ScoreRange, ScoredDetection, sorted};
use super::{ClassFrame, Curve, CurveOutcomes, CurveSpec, Metric, OverlapSet};
use crate::bootstrap::Bootstrap;
use crate::{Difficulty, EvaluatedClass, Frame};

/// The devkit's mark for "no angle known", exactly.
const NO_ALPHA: f64 = -10.0;

/// What AP needs to know of a set of frames; grows by a few hundred bytes a frame and sixteen bytes a detection.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ApAccumulator {
    frames: u32,
    class_frames: [Vec<ClassFrame>; 3],
    detections: [Vec<ScoredDetection>; 3],
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
        let mut set = Self { frames: 1, ..Self::new() };
        for class in EvaluatedClass::ALL {
            let mut class_frame = prepared.class_frame(class, &classes);
            set.detections[class as usize] = std::mem::take(&mut class_frame.detections);
            set.detections[class as usize].retain(|detection| detection.size.is_some());
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
    pub fn append(&mut self, other: Self) {
        let first = self.frames;
        self.frames += other.frames;
        for (here, later) in self.class_frames.iter_mut().zip(other.class_frames) {
            here.extend(later.into_iter().map(|frame| ClassFrame { frame: first + frame.frame, ..frame }));
        }
        for (here, later) in self.detections.iter_mut().zip(other.detections) {
            here.extend(later.into_iter().map(|found| ScoredDetection { frame: first + found.frame, ..found }));
        }
        for (here, later) in self.enabled.iter_mut().zip(other.enabled) {
            here.iter_mut().zip(later).for_each(|(old, new)| *old |= new);
        }
        self.lacks_alpha |= other.lacks_alpha;
    }

    /// The outcomes of each of these curves, in their order; `None` where no detection of the class has what the metric
    /// needs (spec rule 6).
    pub fn outcomes(&self, curves: &[CurveSpec]) -> Vec<Option<CurveOutcomes>> {
        let sorted: Vec<_> = EvaluatedClass::ALL
            .into_par_iter()
            .map(|class| {
                let is_wanted = curves.iter().any(|curve| curve.class == class);
                if is_wanted { sorted(&self.detections[class as usize]) } else { Vec::new() }
            })
            .collect();
        let outcomes = curves.par_iter().map(|curve| {
            let class = curve.class as usize;
            self.enabled[class][curve.metric as usize]
                .then(|| CurveOutcomes::new(&self.class_frames[class], &sorted[class], &Matching::new(curve)))
        });
        outcomes.collect()
    }

    /// Draws all curves, with intervals where a bootstrap is given.
    pub fn report(&self, bootstrap: Option<&Bootstrap>) -> ApReport {
        let (mut curves, mut intervals) = (vec![None; ApReport::CURVES], vec![None; ApReport::CURVES]);
        // Class by class, as what the curves are made of takes memory.
        for class in EvaluatedClass::ALL {
            let wanted = devkit_curves(class);
            let outcomes = self.outcomes(&wanted);
            let drawn: Vec<Option<Curve>> = outcomes
                .par_iter()
                .zip(&wanted)
                .map(|(outcomes, curve)| {
                    let with_orientation = curve.metric == Metric::Image && !self.lacks_alpha;
                    outcomes.as_ref().map(|outcomes| outcomes.curve(with_orientation))
                })
                .collect();
            for (curve, spec) in drawn.into_iter().zip(&wanted) {
                curves[ApReport::place(spec)] = curve;
            }
            let Some(bootstrap) = bootstrap else { continue };
            let found = CurveOutcomes::intervals(&outcomes, self.frames as usize, bootstrap);
            for (interval, spec) in found.into_iter().zip(&wanted) {
                intervals[ApReport::place(spec)] = interval;
            }
        }
        let scores = self.detections.each_ref().map(|detections| ScoreRange::of(detections));
        ApReport::new(curves, intervals, scores, !self.lacks_alpha)
    }
}

/// The curves of one class that the devkit draws, and the loose ones. In the image both sets of overlaps are the same;
/// only the strict curve is made.
fn devkit_curves(class: EvaluatedClass) -> Vec<CurveSpec> {
    let mut curves = Vec::new();
    for set in OverlapSet::ALL {
        for metric in Metric::ALL.into_iter().filter(|metric| set == OverlapSet::Strict || *metric != Metric::Image) {
            let levels = Difficulty::ALL.into_iter();
            curves.extend(levels.map(|difficulty| CurveSpec::new(set, metric, class, difficulty)));
        }
    }
    curves
}

fn classes_of(frame: &Frame) -> Vec<Option<EvaluatedClass>> {
    frame.predictions.iter().map(|prediction| EvaluatedClass::of(&prediction.detection.class)).collect()
}

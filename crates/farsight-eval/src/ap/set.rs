//! All frames of a result set, boiled down.

use rayon::prelude::*;

use super::matching::Matching;
use super::report::ApReport;
use super::scene::{Prepared, enabled_metrics};
use super::scores::{Scores, SizedScores};
use super::{Curve, Metric, OverlapSet, Scene};
use crate::{Difficulty, EvaluatedClass, Frame};

/// The devkit's mark for "no angle known", exactly.
const NO_ALPHA: f64 = -10.0;

/// What AP needs to know of a set of frames; grows by a few hundred bytes a frame and eight bytes a detection.
#[derive(Debug, Clone, Default)]
pub struct SceneSet {
    scenes: [Vec<Scene>; 3],
    scores: [SizedScores; 3],
    enabled: [[bool; 3]; 3],
    lacks_alpha: bool,
}

impl SceneSet {
    /// A set without frames.
    pub fn new() -> Self {
        Self::default()
    }

    /// What `frame` comes down to for `class`.
    pub fn scene(frame: &Frame, class: EvaluatedClass) -> Scene {
        Prepared::new(frame).scene(class, &classes_of(frame))
    }

    /// Boils `frame` down, alone; the frames of a large set can be observed on many threads.
    pub fn observe(frame: &Frame) -> Self {
        let prepared = Prepared::new(frame);
        let classes = classes_of(frame);
        let mut set = Self::new();
        for class in EvaluatedClass::ALL {
            let mut scene = prepared.scene(class, &classes);
            for (score, size) in std::mem::take(&mut scene.scores) {
                if let Some(size) = size {
                    set.scores[class as usize].add(score, size);
                }
            }
            if !scene.objects.is_empty() || !scene.claims.is_empty() {
                set.scenes[class as usize].push(scene);
            }
        }
        for (claim, class) in frame.claims.iter().zip(&classes) {
            set.lacks_alpha |= claim.alpha_rad == NO_ALPHA;
            if let Some(class) = class {
                let enabled = &mut set.enabled[*class as usize];
                enabled.iter_mut().zip(enabled_metrics(claim)).for_each(|(old, new)| *old |= new);
            }
        }
        set
    }

    /// Adds frames after those that are here.
    pub fn append(&mut self, mut other: Self) {
        for class in 0..EvaluatedClass::ALL.len() {
            self.scenes[class].append(&mut other.scenes[class]);
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
                let scenes = &self.scenes[class as usize];
                let counting = &counting[class as usize][difficulty as usize];
                let with_orientation = metric == Metric::Image && !self.lacks_alpha;
                Curve::new(scenes, &matching, &Scores::new(counting, scenes, &matching), with_orientation)
            })
        });
        ApReport::new(curves.collect(), !self.lacks_alpha)
    }
}

fn classes_of(frame: &Frame) -> Vec<Option<EvaluatedClass>> {
    frame.claims.iter().map(|claim| EvaluatedClass::of(&claim.detection.class)).collect()
}

//! What a user gets who takes detections from some score on: how much is found, how much is made up, how far off it is.

use std::collections::BTreeMap;

use serde::{Serialize, Serializer};

use farsight_core::statistics::quantile;

use super::matching::{FalseAlarm, Target};
use crate::{Difficulty, EvaluatedClass};

/// The limits of score that are looked at: multiples of one twentieth.
const STEPS: u32 = 20;
const LIMITS: usize = STEPS as usize - 1;

/// The detector with detections from one score on, on objects of one class that count at Moderate.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OperatingPoint {
    /// The lowest score that takes part.
    pub score: f64,
    /// How many objects there are.
    pub objects: usize,
    /// How many were found.
    pub found: usize,
    /// Detections a frame that are none of anything ([`FalseAlarm`]).
    pub false_alarms_per_frame: f64,
    /// Frames with objects of the class, whatever their difficulty, and those in which the nearest of them was not
    /// found.
    pub frames_with_objects: usize,
    /// See `frames_with_objects`.
    pub nearest_missed: usize,
    /// Mean absolute error of z of the found, metres.
    pub mae_z: Option<f64>,
    /// Median of the absolute error of z over the true z.
    pub median_abs_rel_z: Option<f64>,
}

fn limits() -> impl Iterator<Item = f64> {
    (1..STEPS).map(|step| f64::from(step) / f64::from(STEPS))
}

fn counts(target: &Target) -> bool {
    target.difficulty.is_some_and(|level| level <= Difficulty::Moderate)
}

/// The operating points of every class with objects, lowest score first; in JSON a map from class to rows.
#[derive(Debug, Clone, PartialEq)]
pub struct OperatingPoints {
    /// Class and rows.
    pub classes: Vec<(EvaluatedClass, Vec<OperatingPoint>)>,
}

impl Serialize for OperatingPoints {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.classes.iter().map(|(class, rows)| (class.name(), rows)))
    }
}

impl OperatingPoints {
    /// Those of `targets` and `false_alarms` from `frames` frames.
    pub fn new(targets: &[Target], false_alarms: &[FalseAlarm], frames: usize) -> Self {
        let classes = EvaluatedClass::ALL.into_iter().filter_map(|class| {
            let objects: Vec<&Target> = targets.iter().filter(|t| t.class == class && counts(t)).collect();
            let alarms: Vec<f64> = false_alarms.iter().filter(|a| a.class == class).map(|a| a.score).collect();
            let nearest = nearest_of_frames(targets.iter().filter(|t| t.class == class));
            let rows = limits().map(|score| OperatingPoint::new(score, &objects, &nearest, &alarms, frames)).collect();
            (!objects.is_empty()).then_some((class, rows))
        });
        Self { classes: classes.collect() }
    }
}

impl OperatingPoint {
    fn new(score: f64, objects: &[&Target], nearest: &[&Target], alarms: &[f64], frames: usize) -> Self {
        let is_found = |target: &Target| target.found.is_some_and(|found| found.score >= score);
        // Higher scores choose first, so dropping the lower ones leaves the other matches as they are.
        let found = objects.iter().filter_map(|t| Some((t.depth_m, t.found.filter(|f| f.score >= score)?.depth_m)));
        let errors: Vec<(f64, f64)> = found.map(|(truth, told)| ((told - truth).abs(), truth)).collect();
        let mut relative: Vec<f64> = errors.iter().map(|(error, truth)| error / truth.abs()).collect();
        relative.sort_unstable_by(f64::total_cmp);
        Self {
            score,
            objects: objects.len(),
            found: errors.len(),
            false_alarms_per_frame: alarms.iter().filter(|&&alarm| alarm >= score).count() as f64
                / frames.max(1) as f64,
            frames_with_objects: nearest.len(),
            nearest_missed: nearest.iter().filter(|target| !is_found(target)).count(),
            mae_z: (!errors.is_empty()).then(|| errors.iter().map(|(e, _)| e).sum::<f64>() / errors.len() as f64),
            median_abs_rel_z: (!relative.is_empty()).then(|| quantile(&relative, 0.5)),
        }
    }
}

/// What is found of a class at the lowest limit of score with at most so many false alarms a frame; by frame, so that
/// frames can be drawn.
pub(crate) struct AlarmLimit {
    frames: Vec<FrameCounts>,
    most_per_frame: f64,
}

/// What is in one frame; of each limit, what is found and made up from it on.
#[derive(Debug, Clone, Copy, Default)]
struct FrameCounts {
    objects: u32,
    found: [u32; LIMITS],
    alarms: [u32; LIMITS],
}

impl AlarmLimit {
    /// Of `targets` and `false_alarms` from `frames` frames.
    pub(crate) fn new(
        targets: &[Target],
        false_alarms: &[FalseAlarm],
        frames: usize,
        class: EvaluatedClass,
        most_per_frame: f64,
    ) -> Self {
        let mut counted = vec![FrameCounts::default(); frames];
        let reached = |score: f64| limits().map(move |limit| u32::from(score >= limit));
        for target in targets.iter().filter(|target| target.class == class && counts(target)) {
            let frame = &mut counted[target.frame as usize];
            frame.objects += 1;
            let found = target.found.map(|found| reached(found.score)).into_iter().flatten();
            frame.found.iter_mut().zip(found).for_each(|(sum, one)| *sum += one);
        }
        for alarm in false_alarms.iter().filter(|alarm| alarm.class == class) {
            let sums = counted[alarm.frame as usize].alarms.iter_mut();
            sums.zip(reached(alarm.score)).for_each(|(sum, one)| *sum += one);
        }
        Self { frames: counted, most_per_frame }
    }

    /// The share of the objects, 0 where every limit has more false alarms; NaN without objects. `drawn` says how often
    /// each frame counts, `None` that each counts once.
    pub(crate) fn share(&self, drawn: Option<&[u32]>) -> f64 {
        let weights = (0..self.frames.len()).map(|place| drawn.map_or(1, |drawn| u64::from(drawn[place])));
        let (mut frames, mut objects, mut found, mut alarms) = (0, 0, [0; LIMITS], [0; LIMITS]);
        for (frame, weight) in self.frames.iter().zip(weights) {
            frames += weight;
            objects += weight * u64::from(frame.objects);
            for limit in 0..LIMITS {
                found[limit] += weight * u64::from(frame.found[limit]);
                alarms[limit] += weight * u64::from(frame.alarms[limit]);
            }
        }
        let most = self.most_per_frame * frames as f64;
        let lowest = alarms.iter().position(|alarms| *alarms as f64 <= most);
        lowest.map_or(0, |limit| found[limit]) as f64 / objects as f64
    }
}

/// The nearest object of each frame that has one.
fn nearest_of_frames<'a>(targets: impl Iterator<Item = &'a Target>) -> Vec<&'a Target> {
    let mut nearest: BTreeMap<u32, &Target> = BTreeMap::new();
    for target in targets {
        let known = nearest.entry(target.frame).or_insert(target);
        if target.ground_m < known.ground_m {
            *known = target;
        }
    }
    nearest.into_values().collect()
}

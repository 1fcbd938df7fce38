//! How soon objects are told of, for how long, and how long they are lost: nuScenes' track initialization duration
//! (TID) and longest gap duration (LGD), in seconds, and the lengths of tracks.

use std::collections::BTreeMap;

use serde::Serialize;

use super::errors::{Sample, mean};
use crate::tracking::TrackedFrame;

/// One object of the truth from the first frame in which it counts to the last one.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Lifetime {
    /// Its identity.
    pub id: u64,
    /// Seconds from its first frame to its last one.
    pub present_s: f64,
    /// Seconds until it is told of; none if it never is.
    pub told_after_s: Option<f64>,
    /// Seconds until its closing speed is told.
    pub speed_after_s: Option<f64>,
    /// The longest time for which it was not told of, from its first frame to its last one.
    pub longest_gap_s: f64,
    /// From the first to the last frame in which the identity that it had longest was told.
    pub track_s: f64,
}

impl Lifetime {
    /// Those of a sequence, by identity: its frames, their times, and the matches in them.
    pub(super) fn all(frames: &[TrackedFrame], times_s: &[f64], samples: &[Sample]) -> Vec<Self> {
        let mut present: BTreeMap<u64, [usize; 2]> = BTreeMap::new();
        for (number, frame) in frames.iter().enumerate() {
            for id in &frame.truth {
                present.entry(*id).or_insert([number, number])[1] = number;
            }
        }
        let mut matches: BTreeMap<u64, Vec<&Sample>> = BTreeMap::new();
        for one in samples {
            matches.entry(one.ids[0]).or_default().push(one);
        }
        let of_object = |(id, [first, last]): (u64, [usize; 2])| {
            let matches = matches.get(&id).map(Vec::as_slice).unwrap_or_default();
            let since = |frame: usize| times_s[frame] - times_s[first];
            let told_after_s = matches.first().map(|one| since(one.frame));
            // From the first frame without it to the next one with it.
            let between = matches.windows(2).map(|two| since(two[1].frame) - since(two[0].frame + 1));
            let after = matches.last().map_or(since(last), |one| since(last) - since(one.frame));
            let mut told: BTreeMap<u64, [f64; 2]> = BTreeMap::new();
            for one in matches {
                let now = since(one.frame);
                told.entry(one.ids[1]).or_insert([now, now])[1] = now;
            }
            Self {
                id,
                present_s: since(last),
                told_after_s,
                speed_after_s: matches.iter().find(|one| one.closing.is_some()).map(|one| since(one.frame)),
                longest_gap_s: between.chain(told_after_s).chain([after]).fold(0.0, f64::max),
                track_s: told.values().map(|[from, to]| to - from).fold(0.0, f64::max),
            }
        };
        present.into_iter().map(of_object).collect()
    }
}

/// Means over objects, seconds; none where there are none.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Lifetimes {
    /// Objects, and those of them that are told of.
    pub objects: usize,
    /// See `objects`.
    pub told: usize,
    /// Seconds from the first frame in which an object counts to the last one, of all.
    pub present_s: Option<f64>,
    /// Seconds for which it has one identity, the longest; 0 of what is never told of.
    pub track_s: Option<f64>,
    /// Track initialization duration: seconds until an object is told of, of those that are.
    pub told_after_s: Option<f64>,
    /// Seconds until its closing speed is told, of those of which one is.
    pub speed_after_s: Option<f64>,
    /// Longest gap duration, of those that are told of.
    pub longest_gap_s: Option<f64>,
}

impl Lifetimes {
    /// Of these objects.
    pub fn of<'a>(lifetimes: impl IntoIterator<Item = &'a Lifetime>) -> Self {
        let all: Vec<&Lifetime> = lifetimes.into_iter().collect();
        let told: Vec<&Lifetime> = all.iter().copied().filter(|one| one.told_after_s.is_some()).collect();
        let mean = |of: &[&Lifetime], value: &dyn Fn(&Lifetime) -> Option<f64>| {
            mean(&of.iter().filter_map(|one| value(one)).collect::<Vec<f64>>())
        };
        Self {
            objects: all.len(),
            told: told.len(),
            present_s: mean(&all, &|one| Some(one.present_s)),
            track_s: mean(&all, &|one| Some(one.track_s)),
            told_after_s: mean(&told, &|one| one.told_after_s),
            speed_after_s: mean(&told, &|one| one.speed_after_s),
            longest_gap_s: mean(&told, &|one| Some(one.longest_gap_s)),
        }
    }
}

/// The times of `count` frames, seconds: as they are told, and even steps where nothing is told of a frame (those of
/// KITTI's cameras where hardly a frame is told of).
pub(super) fn times_s(count: usize, told_s: impl IntoIterator<Item = (usize, f64)>) -> Vec<f64> {
    /// Between KITTI's frames.
    const USUAL_STEP_S: f64 = 0.1;
    let told: BTreeMap<usize, f64> = told_s.into_iter().collect();
    let step = match (told.first_key_value(), told.last_key_value()) {
        (Some((first, from)), Some((last, to))) if last > first => (to - from) / (last - first) as f64,
        _ => USUAL_STEP_S,
    };
    let time = |number: usize| {
        let before = told.range(..=number).next_back().or_else(|| told.first_key_value());
        before.map_or(step * number as f64, |(known, time_s)| time_s + step * (number as f64 - *known as f64))
    };
    (0..count).map(time).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(frame: usize, ids: [u64; 2], has_speed: bool) -> Sample {
        Sample {
            frame,
            ids,
            age_s: 0.0,
            depth_m: 20.0,
            depth: [Some(0.0), None],
            closing: has_speed.then_some([0.0, 1.0]),
            true_closing_mps: None,
            speed: None,
            true_ttc_s: None,
            ttc_s: None,
            ttc_interval_s: None,
        }
    }

    #[test]
    fn what_is_lost_and_renamed_is_told_late() {
        // Object 1 is there in frames 0 to 9, told of in 2 to 4 as 7 and in 8 as 8; object 2 never.
        let frame = |number: u64| TrackedFrame {
            truth: if number < 10 { vec![1, 2] } else { vec![2] },
            ..TrackedFrame::default()
        };
        let frames: Vec<TrackedFrame> = (0..12).map(frame).collect();
        let samples = [(2, 7, false), (3, 7, false), (4, 7, true), (8, 8, true)]
            .map(|(frame, told, has_speed)| sample(frame, [1, told], has_speed));
        let times: Vec<f64> = (0..12).map(|frame| 5.0 + 0.5 * f64::from(frame)).collect();
        let all = Lifetime::all(&frames, &times, &samples);
        let [one, two] = all[..] else { panic!("{all:?}") };
        let expected = Lifetime {
            id: 1,
            present_s: 4.5,
            told_after_s: Some(1.0),
            speed_after_s: Some(2.0),
            longest_gap_s: 1.5,
            track_s: 1.0,
        };
        assert_eq!(one, expected);
        let expected = Lifetime {
            id: 2,
            present_s: 5.5,
            told_after_s: None,
            speed_after_s: None,
            longest_gap_s: 5.5,
            track_s: 0.0,
        };
        assert_eq!(two, expected);
        let mean = Lifetimes::of(&all);
        assert_eq!([mean.objects, mean.told], [2, 1]);
        assert_eq!([mean.present_s, mean.track_s], [Some(5.0), Some(0.5)]);
        assert_eq!([mean.told_after_s, mean.speed_after_s, mean.longest_gap_s], [Some(1.0), Some(2.0), Some(1.5)]);
        assert_eq!(Lifetimes::of([]).told_after_s, None);
    }

    #[test]
    fn frames_that_nothing_is_told_of_lie_between() {
        assert_eq!(times_s(5, [(1, 2.0), (3, 3.0)]), [1.5, 2.0, 2.5, 3.0, 3.5]);
        assert_eq!(times_s(3, [(1, 2.0)]), [1.9, 2.0, 2.1]);
        assert_eq!(times_s(2, []), [0.0, 0.1]);
    }
}

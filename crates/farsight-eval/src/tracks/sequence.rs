//! Who is whom in each frame of a sequence.

use std::collections::BTreeMap;

use farsight_core::overlap::{covered_share_2d, iou_2d};
use farsight_core::{Box2d, ObjectClass};
use farsight_track::assigned;

use super::errors::Sample;
use super::lifetimes::{Lifetime, times_s};
use super::{GroundTruthFrame, GroundTruthTrack, PredictedFrame, PredictedTrack};
use crate::difficulty::Difficulty;
use crate::tracking::TrackedFrame;

/// Least overlap in the image of a track with what it is, for errors and for what is left out.
const SAME_OVERLAP: f64 = 0.5;

/// A track of which a region without labels covers more than this share is left out.
const DONT_CARE_SHARE: f64 = 0.5;

/// Two metres apart, somebody is half as like in space as in one place: matches of CLEAR and identity metrics are no
/// farther apart.
const APART_M: f64 = 4.0;

/// What is found of a sequence.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct JudgedSequence {
    /// Its name.
    pub name: String,
    /// Frames with overlaps of boxes in the image.
    pub image: Vec<TrackedFrame>,
    /// Frames with nearness on the ground: 1 in the same place, 0.5 at 2 m, 0 at 4 m.
    pub space: Vec<TrackedFrame>,
    /// Errors of each match in the image.
    pub samples: Vec<Sample>,
    /// How soon each object is told of in the image, and for how long.
    pub lifetimes: Vec<Lifetime>,
}

/// Compares what is told of a sequence with what is true. Frames of the truth beyond those that are told of count.
pub fn judge(
    name: &str,
    class: &ObjectClass,
    truth: &[GroundTruthFrame],
    told: &[Option<PredictedFrame>],
) -> JudgedSequence {
    let (mut image_frames, mut space_frames, mut samples) = (Vec::new(), Vec::new(), Vec::new());
    // Since when each track is told of.
    let mut born_s: BTreeMap<u64, f64> = BTreeMap::new();
    let nothing = PredictedFrame::default();
    for (number, frame) in truth.iter().enumerate() {
        let told = told.get(number).and_then(Option::as_ref).unwrap_or(&nothing);
        for track in &told.tracks {
            born_s.entry(track.id).or_insert(told.time_s);
        }
        let (counted, ignored): (Vec<&GroundTruthTrack>, Vec<&GroundTruthTrack>) =
            frame.tracks.iter().partition(|track| track.label.class == *class && is_moderate(track));
        let of_class: Vec<&PredictedTrack> = told.tracks.iter().filter(|track| track.class == *class).collect();
        let kept = kept(&counted, &ignored, &frame.dont_care, &of_class);
        let overlap = |truth: &GroundTruthTrack, told: &PredictedTrack| iou_2d(&truth.label.box2d, &told.box2d);
        let image = tracked(&counted, &kept, overlap);
        space_frames.push(tracked(&counted, &kept, nearness));
        for (row, column) in matches(&image.similarities) {
            let (truth, told_track) = (counted[row], kept[column]);
            let age_s = told.time_s - born_s.get(&told_track.id).copied().unwrap_or(told.time_s);
            samples.push(Sample::new(number, truth, told_track, age_s));
        }
        image_frames.push(image);
    }
    let told_s = told.iter().enumerate().filter_map(|(number, told)| Some((number, told.as_ref()?.time_s)));
    let lifetimes = Lifetime::all(&image_frames, &times_s(truth.len(), told_s), &samples);
    JudgedSequence { name: name.to_owned(), image: image_frames, space: space_frames, samples, lifetimes }
}

fn is_moderate(track: &GroundTruthTrack) -> bool {
    let (label, level) = (&track.label, Difficulty::Moderate);
    label.box2d.height() > level.min_height_px()
        && label.occlusion <= level.max_occlusion()
        && label.truncation <= level.max_truncation()
}

/// The tracks that count: those that are nothing which is to be left out.
fn kept<'a>(
    counted: &[&GroundTruthTrack],
    ignored: &[&GroundTruthTrack],
    dont_care: &[Box2d],
    told: &[&'a PredictedTrack],
) -> Vec<&'a PredictedTrack> {
    let all: Vec<&GroundTruthTrack> = counted.iter().chain(ignored).copied().collect();
    let overlap = |truth: &GroundTruthTrack, told: &PredictedTrack| iou_2d(&truth.label.box2d, &told.box2d);
    let partners: BTreeMap<usize, usize> =
        matches(&tracked(&all, told, overlap).similarities).into_iter().map(|(row, column)| (column, row)).collect();
    let is_kept = |(place, track): &(usize, &&PredictedTrack)| match partners.get(place) {
        Some(row) => *row < counted.len(),
        None => dont_care.iter().all(|area| covered_share_2d(&track.box2d, area) <= DONT_CARE_SHARE),
    };
    told.iter().enumerate().filter(is_kept).map(|(_, track)| *track).collect()
}

fn tracked(
    truth: &[&GroundTruthTrack],
    told: &[&PredictedTrack],
    similarity: impl Fn(&GroundTruthTrack, &PredictedTrack) -> f64,
) -> TrackedFrame {
    TrackedFrame {
        truth: truth.iter().map(|track| track.id).collect(),
        told: told.iter().map(|track| track.id).collect(),
        similarities: truth.iter().map(|a| told.iter().map(|b| similarity(a, b)).collect()).collect(),
    }
}

fn nearness(truth: &GroundTruthTrack, told: &PredictedTrack) -> f64 {
    let [a, b] = [truth.label.box3d.location, told.box3d.location];
    (1.0 - (a[0] - b[0]).hypot(a[2] - b[2]) / APART_M).max(0.0)
}

/// The pairs (row, column) that overlap enough, and most in all.
fn matches(similarities: &[Vec<f64>]) -> Vec<(usize, usize)> {
    let cost = |similarity: &f64| if *similarity >= SAME_OVERLAP { 1.0 - similarity } else { f64::INFINITY };
    let costs: Vec<Vec<f64>> = similarities.iter().map(|row| row.iter().map(cost).collect()).collect();
    assigned(&costs).into_iter().enumerate().filter_map(|(row, column)| Some((row, column?))).collect()
}

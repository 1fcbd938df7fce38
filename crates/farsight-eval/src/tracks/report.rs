//! Several sequences together, and against others.

use std::collections::BTreeMap;

use serde::Serialize;

use super::errors::Errors;
use super::lifetimes::Lifetimes;
use super::sequence::JudgedSequence;
use crate::bootstrap::{Bootstrap, Interval};
use crate::tracking::{TrackedFrame, TrackingMetrics, tracking_metrics};

/// The figures of all sequences together.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct TracksReport {
    /// With overlaps of boxes in the image.
    pub image: TrackingMetrics,
    /// With nearness on the ground.
    pub space: TrackingMetrics,
    /// Errors of all samples.
    pub errors: Errors,
    /// How soon objects are told of in the image, and for how long.
    pub lifetimes: Lifetimes,
    /// Name, HOTA in the image and in space, switches and distance error of each sequence.
    pub sequences: Vec<(String, TrackingMetrics, TrackingMetrics, Errors)>,
}

/// Identities of different sequences are different.
const IDS_OF_SEQUENCE: u64 = 1 << 32;

impl TracksReport {
    /// Of sequences.
    pub fn new(sequences: &[JudgedSequence]) -> Self {
        let each: Vec<&JudgedSequence> = sequences.iter().collect();
        let of_one = |one: &JudgedSequence| {
            (one.name.clone(), tracking_metrics(&one.image), tracking_metrics(&one.space), Errors::of(&one.samples))
        };
        Self {
            image: tracking_metrics(&together(&each, |one| &one.image)),
            space: tracking_metrics(&together(&each, |one| &one.space)),
            errors: Errors::of(sequences.iter().flat_map(|one| &one.samples)),
            lifetimes: Lifetimes::of(sequences.iter().flat_map(|one| &one.lifetimes)),
            sequences: sequences.iter().map(of_one).collect(),
        }
    }
}

/// The figures of a report for machines.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Figures {
    /// With overlaps of boxes in the image: names and values.
    pub image: BTreeMap<&'static str, f64>,
    /// With nearness on the ground.
    pub space: BTreeMap<&'static str, f64>,
    /// Errors of distance, speed and time to collision.
    pub errors: Errors,
    /// How soon objects are told of, and for how long.
    pub lifetimes: Lifetimes,
}

impl TracksReport {
    /// The figures of all sequences together.
    pub fn figures(&self) -> Figures {
        Figures {
            image: named(&self.image),
            space: named(&self.space),
            errors: self.errors.clone(),
            lifetimes: self.lifetimes.clone(),
        }
    }
}

fn named(metrics: &TrackingMetrics) -> BTreeMap<&'static str, f64> {
    let TrackingMetrics { hota, det_a, ass_a, loc_a, mota, motp, idf1, .. } = *metrics;
    let counts = [
        ("switches", metrics.switches as f64),
        ("fragments", metrics.fragments as f64),
        ("mostly_tracked", metrics.mostly_tracked as f64),
        ("partially_tracked", metrics.partially_tracked as f64),
        ("mostly_lost", metrics.mostly_lost as f64),
    ];
    let shares = [
        ("hota", hota),
        ("det_a", det_a),
        ("ass_a", ass_a),
        ("loc_a", loc_a),
        ("mota", mota),
        ("motp", motp),
        ("idf1", idf1),
        ("id_recall", metrics.id_recall),
        ("id_precision", metrics.id_precision),
    ];
    shares.into_iter().chain(counts).collect()
}

/// The frames of sequences as one, with identities of their own: HOTA, CLEAR and identity metrics then are those that
/// `TrackEval` gives for all sequences together.
fn together(
    sequences: &[&JudgedSequence],
    frames: impl Fn(&JudgedSequence) -> &Vec<TrackedFrame>,
) -> Vec<TrackedFrame> {
    let mut all = Vec::new();
    for (place, sequence) in sequences.iter().enumerate() {
        let renamed = |ids: &[u64]| ids.iter().map(|id| id + place as u64 * IDS_OF_SEQUENCE).collect();
        all.extend(frames(sequence).iter().map(|frame| TrackedFrame {
            truth: renamed(&frame.truth),
            told: renamed(&frame.told),
            similarities: frame.similarities.clone(),
        }));
    }
    all
}

/// How far one set of tracks differs from another, of the same sequences.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Difference {
    /// Of what.
    pub name: &'static str,
    /// The first set's mean over the sequences, and the second's.
    pub means: [f64; 2],
    /// 95% interval of the first less the second; sequences are drawn.
    pub interval: Option<Interval>,
}

/// Differences of figures that both have, paired by sequence.
pub fn differences(ours: &TracksReport, theirs: &TracksReport) -> Vec<Difference> {
    type Figure = fn(&(String, TrackingMetrics, TrackingMetrics, Errors)) -> Option<f64>;
    let figures: [(&'static str, Figure); 7] = [
        ("HOTA in the image", |one| Some(one.1.hota)),
        ("HOTA in space", |one| Some(one.2.hota)),
        ("IDF1 in space", |one| Some(one.2.idf1)),
        ("identity switches", |one| Some(one.1.switches as f64)),
        ("distance MAE, m", |one| one.3.depth_mae_m),
        ("closing speed MAE below 30 m, m/s", |one| one.3.closing_mae_mps[0]),
        ("closing speed MAE, 30 to 60 m, m/s", |one| one.3.closing_mae_mps[1]),
    ];
    let difference = |(name, figure): (&'static str, Figure)| {
        let pairs: Vec<[f64; 2]> = ours
            .sequences
            .iter()
            .filter_map(|one| {
                let other = theirs.sequences.iter().find(|other| other.0 == one.0)?;
                Some([figure(one)?, figure(other)?])
            })
            .collect();
        let mean = |place: usize| pairs.iter().map(|pair| pair[place]).sum::<f64>() / pairs.len() as f64;
        let of_drawn = |times: &[u32]| {
            let (mut sum, mut count) = (0.0, 0.0);
            for (pair, times) in pairs.iter().zip(times) {
                sum += f64::from(*times) * (pair[0] - pair[1]);
                count += f64::from(*times);
            }
            vec![sum / count]
        };
        let interval = Bootstrap::default().intervals(pairs.len(), of_drawn).pop().flatten();
        (!pairs.is_empty()).then(|| Difference { name, means: [mean(0), mean(1)], interval })
    };
    figures.into_iter().filter_map(difference).collect()
}

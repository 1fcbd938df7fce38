//! What the tracker's options are worth on labelled sequences, beside single images and two other ways to associate:
//! `cargo run --release -p farsight --example tune_tracks DATA DETECTIONS [NAME=VALUE ...]`.
//!
//! DATA is what `farsight synth --sequence` wrote; DETECTIONS has one file a sequence (0000.json), which
//! `farsight range DATA/training/image_02/0000 --calib DATA/training/calib/0000.txt --min-score 0.2 --json` wrote.
//!
//! `tune_tracks --fit DATA DETECTIONS [DATA DETECTIONS ...]` looks for options of motion and noise that make the truth
//! of all these sequences likelier.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::format_push_string, reason = "an example")]

mod baselines;
mod data;
mod fit;
mod settings;

use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

use farsight::{Detection, ObjectClass, Tracker, TrackerOptions};
use farsight_eval::tracks::{JudgedSequence, PredictedFrame, PredictedTrack, Sample, TracksReport, text};

use baselines::{Baseline, Kind};
use data::{BIRTH, Sequence, judged, options, sequences, told, update};
use settings::set;

fn main() -> std::io::Result<()> {
    let mut arguments = std::env::args().skip(1).peekable();
    if arguments.next_if_eq("--fit").is_some() {
        let (settings, folders): (Vec<String>, Vec<String>) = arguments.partition(|one| one.contains('='));
        let mut start = options();
        for setting in &settings {
            set(&mut start, setting);
        }
        let mut all = Vec::new();
        for pair in folders.chunks(2) {
            let [data, folder] = pair else { panic!("expected DATA DETECTIONS") };
            all.extend(sequences(Path::new(data), Path::new(folder))?);
        }
        return fit::fit(&all, &start).map(drop);
    }
    let (data, folder) = arguments.next().zip(arguments.next()).expect("expected DATA DETECTIONS");
    let mut options = options();
    arguments.for_each(|setting| set(&mut options, &setting));
    let sequences = sequences(Path::new(&data), Path::new(&folder))?;
    let ours: Vec<JudgedSequence> = sequences.iter().map(|one| judged(one, &tracked(one, &options, true))).collect();
    let seen: Vec<JudgedSequence> = sequences.iter().map(|one| judged(one, &tracked(one, &options, false))).collect();
    let single: Vec<JudgedSequence> = sequences.iter().map(|one| judged(one, &single(one))).collect();
    let mut out = text(&TracksReport::new(&ours));
    out += &against_single(&ours, &single);
    out += &short("ours without coasting", &seen);
    for (name, kind) in [("AB3DMOT-style", Kind::Ab3dMot), ("ByteTrack-style", Kind::ByteTrack)] {
        let judged: Vec<JudgedSequence> = sequences.iter().map(|one| judged(one, &baseline(one, kind))).collect();
        out += &short(name, &judged);
    }
    std::io::stdout().write_all(out.as_bytes())
}

/// HOTA with its parts in the image and in space, in one line.
fn short(name: &str, judged: &[JudgedSequence]) -> String {
    let report = TracksReport::new(judged);
    let share = |value: f64| format!("{:.1}%", 100.0 * value);
    let [image, space] = [&report.image, &report.space].map(|one| {
        let [hota, detection, association] = [one.hota, one.det_a, one.ass_a].map(share);
        format!("HOTA {hota} (DetA {detection}, AssA {association})")
    });
    let (idf1, switches) = (share(report.space.idf1), report.image.switches);
    format!("{name}: in the image {image}, in space {space}, IDF1 in space {idf1}, switches {switches}\n")
}

fn tracked(sequence: &Sequence, options: &TrackerOptions, coasts: bool) -> Vec<Option<PredictedFrame>> {
    let mut tracker = Tracker::new(options.clone());
    let frame = |number: usize| {
        let mut tracks = update(&mut tracker, sequence, number);
        tracks.retain(|track| coasts || !track.coasting);
        Some(told(sequence, number, &tracks))
    };
    (0..sequence.detections.len()).map(frame).collect()
}

/// Each detection a track of its own.
fn single(sequence: &Sequence) -> Vec<Option<PredictedFrame>> {
    let mut next = 0;
    let mut frame = |(number, detections): (usize, &Vec<Detection>)| {
        let tracks = detections.iter().filter(|one| one.score >= BIRTH).map(|one| {
            next += 1;
            PredictedTrack {
                id: next,
                class: one.class.clone(),
                box2d: one.box2d,
                box3d: one.box3d,
                range_sigma_m: one.range_sigma_m,
                closing_mps: None,
                ttc_s: None,
                ttc_interval_s: None,
                speed_mps: None,
            }
        });
        Some(PredictedFrame { time_s: number as f64 / sequence.fps, tracks: tracks.collect() })
    };
    sequence.detections.iter().enumerate().map(&mut frame).collect()
}

fn baseline(sequence: &Sequence, kind: Kind) -> Vec<Option<PredictedFrame>> {
    let mut baseline = Baseline::new(kind);
    let mut frame = |(number, detections): (usize, &Vec<Detection>)| {
        let tracks = baseline.update(1.0 / sequence.fps, detections, &ObjectClass::Car, BIRTH);
        Some(PredictedFrame { time_s: number as f64 / sequence.fps, tracks })
    };
    sequence.detections.iter().enumerate().map(&mut frame).collect()
}

/// Distances of tracks and of single images, of the same objects in the same frames.
fn against_single(tracked: &[JudgedSequence], single: &[JudgedSequence]) -> String {
    let [ours, theirs] = distances(tracked, single);
    format!(
        "\nsame objects in the same frames: distance MAE {ours:.3} m, single images {theirs:.3} m ({:+.1}%)\n",
        100.0 * (ours / theirs - 1.0)
    )
}

/// Mean absolute errors of the distances of tracks and of single images, metres, of the same objects in the same
/// frames.
fn distances(tracked: &[JudgedSequence], single: &[JudgedSequence]) -> [f64; 2] {
    let (mut ours, mut theirs) = (Vec::new(), Vec::new());
    for (a, b) in tracked.iter().zip(single) {
        let key = |one: &Sample| (one.frame, one.ids[0]);
        let known: BTreeMap<_, f64> = b.samples.iter().filter_map(|one| Some((key(one), one.depth[0]?))).collect();
        for one in &a.samples {
            if let (Some(off), Some(single)) = (one.depth[0], known.get(&key(one))) {
                ours.push(off.abs());
                theirs.push(single.abs());
            }
        }
    }
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    [mean(&ours), mean(&theirs)]
}

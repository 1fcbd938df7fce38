//! Tracking metrics: laws, and the answers of `TrackEval` and `motrics` where they are installed
//! (`pip install trackeval motrics`).

use std::io::Write;
use std::process::{Command, Stdio};

use farsight_eval::tracking::{TrackedFrame, TrackingMetrics, tracking_metrics};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// A street of `objects`, told with misses, false tracks, switches and errors of place.
fn sequence(seed: u64, objects: u64) -> Vec<TrackedFrame> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut share = move || f64::from(random.next_u32()) / f64::from(u32::MAX);
    let mut names: Vec<u64> = (0..objects).map(|id| 100 + id).collect();
    let mut next = 1000;
    (0..40)
        .map(|frame| {
            let truth: Vec<u64> = (0..objects).filter(|id| (frame + id * 7) % 31 > 4).collect();
            let mut told = Vec::new();
            let mut of = Vec::new();
            for &id in &truth {
                if share() < 0.05 {
                    next += 1;
                    names[id as usize] = next;
                }
                if share() < 0.03 {
                    names.swap(id as usize, (id as usize + 1) % objects as usize);
                }
                if share() > 0.15 && !told.contains(&names[id as usize]) {
                    told.push(names[id as usize]);
                    of.push(Some(id));
                }
            }
            if share() < 0.3 {
                told.push(50 + frame % 3);
                of.push(None);
            }
            let mut similarity = |truth: u64, of: Option<u64>| match of {
                Some(id) if id == truth => 0.3 + 0.7 * share(),
                _ => (0.7 * share() - 0.3).max(0.0),
            };
            let similarities =
                truth.iter().map(|&truth| of.iter().map(|&of| similarity(truth, of)).collect()).collect();
            TrackedFrame { truth, told, similarities }
        })
        .collect()
}

fn numbers(metrics: &TrackingMetrics) -> [f64; 14] {
    let TrackingMetrics { hota, det_a, ass_a, loc_a, mota, motp, switches, fragments, idf1, .. } = *metrics;
    let TrackingMetrics { mostly_tracked, partially_tracked, mostly_lost, id_recall, id_precision, .. } = *metrics;
    let [switches, fragments, mt, pt, ml] =
        [switches, fragments, mostly_tracked, partially_tracked, mostly_lost].map(|count| count as f64);
    [hota, det_a, ass_a, loc_a, mota, motp, switches, fragments, idf1, id_recall, id_precision, mt, pt, ml]
}

/// Reads sequences, writes `TrackEval`'s numbers for each.
const TRACKEVAL: &str = r#"
import json, sys
import numpy as np
for name, kind in (("float", float), ("int", int), ("bool", bool)):
    if name not in np.__dict__:
        setattr(np, name, kind)
from trackeval.metrics import CLEAR, HOTA, Identity

def quiet(metric):
    try:
        return metric({"PRINT_CONFIG": False, "THRESHOLD": 0.5})
    except TypeError:
        return metric()

for line in sys.stdin:
    frames = json.loads(line)
    truth = {name: place for place, name in enumerate(sorted({name for frame in frames for name in frame[0]}))}
    told = {name: place for place, name in enumerate(sorted({name for frame in frames for name in frame[1]}))}
    data = {
        "num_timesteps": len(frames),
        "num_gt_ids": len(truth),
        "num_tracker_ids": len(told),
        "num_gt_dets": sum(len(frame[0]) for frame in frames),
        "num_tracker_dets": sum(len(frame[1]) for frame in frames),
        "gt_ids": [np.array([truth[name] for name in frame[0]], int) for frame in frames],
        "tracker_ids": [np.array([told[name] for name in frame[1]], int) for frame in frames],
        "similarity_scores": [np.array(frame[2], float).reshape(len(frame[0]), len(frame[1])) for frame in frames],
    }
    hota, clear, identity = HOTA().eval_sequence(data), quiet(CLEAR).eval_sequence(data), quiet(Identity).eval_sequence(data)
    mean = lambda name: float(np.mean(hota[name]))
    print(json.dumps([
        mean("HOTA"), mean("DetA"), mean("AssA"), mean("LocA"),
        float(clear["MOTA"]), float(clear["MOTP"]), float(clear["IDSW"]), float(clear["Frag"]),
        float(identity["IDF1"]), float(identity["IDR"]), float(identity["IDP"]),
        float(clear["MT"]), float(clear["PT"]), float(clear["ML"]),
    ]))
"#;

/// The same from `motrics`, an independent implementation.
const MOTRICS: &str = r"
import json, sys
import motrics

for line in sys.stdin:
    frames = json.loads(line)
    data = [[frame[part] for frame in frames] for part in range(3)]
    hota = motrics.compute_hota_from_similarity(*data)
    clear = motrics.compute_clear_from_similarity(*data)
    identity = motrics.compute_identity_from_similarity(*data)
    print(json.dumps([
        hota.hota, hota.deta, hota.assa, hota.loca, clear.mota, clear.motp, clear.num_switches, clear.frag,
        identity.idf1, identity.idr, identity.idp, clear.mt, clear.pt, clear.ml,
    ]))
";

#[test]
fn the_metrics_are_those_of_trackeval() {
    compare_with("trackeval", TRACKEVAL);
}

#[test]
fn the_metrics_are_those_of_motrics() {
    compare_with("motrics", MOTRICS);
}

/// Compares with what a script that uses this Python package says of the same sequences.
fn compare_with(package: &str, script: &str) {
    let import = format!("import {package}");
    let installed = Command::new("python3").args(["-c", &import]).stderr(Stdio::null()).status();
    if !installed.is_ok_and(|status| status.success()) {
        eprintln!("skipped: python3 with {package} is not there (pip install {package})");
        return;
    }
    let mut cases: Vec<Vec<TrackedFrame>> = (0..30).map(|seed| sequence(seed, 1 + seed % 8)).collect();
    // Nothing there in some frames, nothing told in others.
    for (place, frame) in cases[7].iter_mut().enumerate() {
        if place % 5 == 0 {
            *frame = TrackedFrame { truth: Vec::new(), similarities: Vec::new(), ..frame.clone() };
        } else if place % 7 == 0 {
            let similarities = vec![Vec::new(); frame.truth.len()];
            *frame = TrackedFrame { told: Vec::new(), similarities, ..frame.clone() };
        }
    }
    let mut python =
        Command::new("python3").args(["-c", script]).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
    let text: String = cases
        .iter()
        .map(|frames| {
            let frames: Vec<_> = frames.iter().map(|f| (&f.truth, &f.told, &f.similarities)).collect();
            serde_json::to_string(&frames).unwrap() + "\n"
        })
        .collect();
    python.stdin.take().unwrap().write_all(text.as_bytes()).unwrap();
    let output = python.wait_with_output().unwrap();
    assert!(output.status.success());
    let answers = String::from_utf8(output.stdout).unwrap();
    let lines: Vec<&str> = answers.lines().filter(|line| line.starts_with("[0") || line.starts_with("[1")).collect();
    assert_eq!(lines.len(), cases.len(), "{answers}");
    for (place, (line, frames)) in lines.into_iter().zip(&cases).enumerate() {
        let expected: [f64; 14] = serde_json::from_str(line).unwrap();
        let found = numbers(&tracking_metrics(frames));
        for (what, (found, expected)) in found.into_iter().zip(expected).enumerate() {
            assert!((found - expected).abs() < 1e-9, "case {place}, number {what}: {found}, not {expected}");
        }
    }
}

#[test]
fn truth_told_as_it_is_has_full_marks() {
    let frames: Vec<TrackedFrame> = sequence(3, 6)
        .into_iter()
        .map(|TrackedFrame { truth, .. }| {
            let similarity = |a: &u64, b: &u64| f64::from(u8::from(a == b));
            let similarities = truth.iter().map(|a| truth.iter().map(|b| similarity(a, b)).collect()).collect();
            TrackedFrame { told: truth.clone(), truth, similarities }
        })
        .collect();
    let metrics = tracking_metrics(&frames);
    for value in [metrics.hota, metrics.det_a, metrics.ass_a, metrics.loc_a, metrics.mota, metrics.motp, metrics.idf1] {
        assert!((value - 1.0).abs() < 1e-9, "{metrics:?}");
    }
    assert_eq!(metrics.switches, 0);
    assert_eq!([metrics.mostly_tracked, metrics.partially_tracked, metrics.mostly_lost], [6, 0, 0]);
}

#[test]
fn a_switch_costs_association_and_no_detection() {
    let frame = |told: u64| TrackedFrame { truth: vec![1], told: vec![told], similarities: vec![vec![1.0]] };
    let metrics = tracking_metrics(&(0..10).map(|place| frame(u64::from(place >= 5))).collect::<Vec<_>>());
    assert_eq!((metrics.switches, metrics.fragments), (1, 0));
    assert!((metrics.det_a - 1.0).abs() < 1e-12);
    // Half of the truth's frames for each of its two tracks.
    assert!((metrics.ass_a - 0.5).abs() < 1e-12 && (metrics.idf1 - 0.5).abs() < 1e-12, "{metrics:?}");
    assert!((metrics.mota - 0.9).abs() < 1e-12);
}

#[test]
fn nothing_at_all_is_no_error() {
    let metrics = tracking_metrics(&[]);
    assert_eq!((metrics.hota, metrics.mota, metrics.idf1), (0.0, 0.0, 0.0));
}

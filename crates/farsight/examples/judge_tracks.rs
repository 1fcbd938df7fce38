//! Compares the lines of `farsight track --json` with what is known of one vehicle:
//! `cargo run --release -p farsight --example judge_tracks TRACKS.jsonl FOLDER`.
//!
//! FOLDER holds `lead.csv` (frame, track, `z_center_m`, `z_rear_m`, `vz_mps`, `ttc_s` in each frame) with
//! `label_02.txt` (KITTI's tracking labels), or `truth.csv` (frame, u1, v1, u2, v2, `near_z_m`, `near_x_m`, `vz_mps` of
//! one frame).
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::format_push_string, reason = "an example")]

use std::collections::{BTreeMap, BTreeSet};
use std::fs::read_to_string;
use std::io::Write;
use std::path::Path;

use farsight::Box2d;
use farsight::json::{FrameRecord, TrackRecord};
use farsight_core::overlap::iou_2d;

/// So many frames at the end are judged, as the figures in `docs/video.md` are.
const LAST_FRAMES: usize = 15;

fn main() -> std::io::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let (tracks, folder) = arguments.next().zip(arguments.next()).expect("expected TRACKS.jsonl FOLDER");
    let lines = read_to_string(tracks)?;
    let frames: Vec<FrameRecord> = lines.lines().map(|line| serde_json::from_str(line).expect("a frame")).collect();
    let folder = Path::new(&folder);
    let text = if folder.join("lead.csv").is_file() { lead(&frames, folder)? } else { single(&frames, folder)? };
    std::io::stdout().write_all(text.as_bytes())
}

/// Rows of numbers below a header.
fn rows(path: &Path) -> std::io::Result<Vec<Vec<f64>>> {
    let numbers = |line: &str| line.split(',').map(|field| field.parse().unwrap()).collect();
    Ok(read_to_string(path)?.lines().skip(1).map(numbers).collect())
}

/// The track whose box covers this one best, by half at least.
fn at<'a>(frame: &'a FrameRecord, area: &Box2d) -> Option<&'a TrackRecord> {
    let overlap = |track: &TrackRecord| {
        let [x1, y1, x2, y2] = track.box2d;
        iou_2d(&Box2d::new(x1, y1, x2, y2), area)
    };
    let best = frame.tracks.iter().max_by(|a, b| overlap(a).total_cmp(&overlap(b)))?;
    (overlap(best) > 0.5).then_some(best)
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Share of the true values inside.
fn held(cases: &[bool]) -> String {
    format!("{} of {}", cases.iter().filter(|case| **case).count(), cases.len())
}

fn lead(frames: &[FrameRecord], folder: &Path) -> std::io::Result<String> {
    let truth = rows(&folder.join("lead.csv"))?;
    let mut boxes = BTreeMap::new();
    for line in read_to_string(folder.join("label_02.txt"))?.lines() {
        let fields: Vec<&str> = line.split_ascii_whitespace().collect();
        if fields[1].parse() == Ok(truth[0][1]) {
            let [x1, y1, x2, y2] = [6, 7, 8, 9].map(|place| fields[place].parse::<f64>().unwrap());
            boxes.insert(fields[0].parse::<u64>().unwrap(), Box2d::new(x1, y1, x2, y2));
        }
    }
    let mut text = "frame    z    true  sigma  closing  true  sigma   ttc   true  interval\n".to_owned();
    let mut found = Vec::new();
    for row in &truth {
        let number = row[0] as u64;
        let Some(frame) = frames.iter().find(|frame| frame.frame == number) else { continue };
        let Some(track) = at(frame, &boxes[&number]) else { continue };
        let word = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.2}"));
        let interval =
            track.ttc_interval_s.map_or_else(String::new, |(low, high)| format!("{low:.1} to {}", word(high)));
        text += &format!(
            "{number:>5}  {:>5.2}  {:>5.2}  {:>5.2}  {:>7}  {:>4.2}  {:>5}  {:>5}  {:>5.2}  {interval}\n",
            track.range_m,
            row[2],
            track.range_sigma_m,
            word(track.closing_mps),
            -row[4],
            word(track.closing_sigma_mps),
            word(track.ttc_s),
            row[5],
        );
        found.push((row, track));
    }
    let identities: BTreeSet<u64> = found.iter().map(|(_, track)| track.id).collect();
    text += &format!("identities {identities:?}, found in {} of {} frames\n", found.len(), truth.len());
    let errors: Vec<f64> = found.iter().map(|(row, track)| track.range_m / row[2] - 1.0).collect();
    text += &format!("distance: mean error {:+.1}%\n", 100.0 * mean(&errors));
    // What changes from frame to frame beside what truly does.
    let jitter: Vec<f64> = found
        .windows(2)
        .map(|pair| ((pair[1].1.range_m - pair[0].1.range_m) - (pair[1].0[2] - pair[0].0[2])).abs())
        .collect();
    text += &format!("jitter of the distance from frame to frame: mean {:.3} m\n", mean(&jitter));
    let last = &found[found.len().saturating_sub(LAST_FRAMES)..];
    let closing: Vec<(f64, f64)> =
        last.iter().filter_map(|(row, track)| Some((track.closing_mps? + row[4], track.closing_sigma_mps?))).collect();
    let off: Vec<f64> = closing.iter().map(|(off, _)| off.abs()).collect();
    let inside: Vec<bool> = closing.iter().map(|(off, sigma)| off.abs() <= 1.645 * sigma).collect();
    text += &format!(
        "last {} frames: closing speed known in {}, mean error {:.2} m/s, inside 90% intervals {}\n",
        last.len(),
        closing.len(),
        mean(&off),
        held(&inside)
    );
    let ttc: Vec<f64> = last.iter().filter_map(|(row, track)| Some((track.ttc_s? / row[5] - 1.0).abs())).collect();
    let inside: Vec<bool> = last
        .iter()
        .filter_map(|(row, track)| Some((row, track.ttc_interval_s?)))
        .map(|(row, (low, high))| low <= row[5] && high.is_none_or(|high| row[5] <= high))
        .collect();
    text += &format!(
        "last {} frames: time to collision told in {}, mean error {:.0}%, inside 90% intervals {}\n",
        last.len(),
        ttc.len(),
        100.0 * mean(&ttc),
        held(&inside)
    );
    Ok(text)
}

fn single(frames: &[FrameRecord], folder: &Path) -> std::io::Result<String> {
    let mut text = String::new();
    for row in rows(&folder.join("truth.csv"))? {
        let frame = frames.iter().find(|frame| frame.frame == row[0] as u64).expect("the frame");
        let Some(track) = at(frame, &Box2d::new(row[1], row[2], row[3], row[4])) else {
            text += "not found\n";
            continue;
        };
        // The truth is of the nearest point; the track's distance is of the centre.
        let [_, _, length] = track.dimensions_hwl;
        let [_, width, _] = track.dimensions_hwl;
        let (sin, cos) = track.rotation_y.sin_cos();
        let near_m = track.range_m - f64::midpoint(sin.abs() * length, cos.abs() * width);
        let seen = frames.iter().filter(|frame| frame.tracks.iter().any(|other| other.id == track.id)).count();
        text += &format!(
            "frame {}: track {}, {} of {} frames\n  nearest face {near_m:.2} ±{:.2} m, true {:.2} m ({:+.1}%)\n",
            row[0],
            track.id,
            seen,
            frames.len(),
            track.range_sigma_m,
            row[5],
            100.0 * (near_m / row[5] - 1.0),
        );
        if let (Some([_, _, velocity]), Some([_, _, sigma])) = (track.velocity_mps, track.velocity_sigma_mps) {
            text += &format!("  velocity ahead {:.2} ±{:.2} m/s, true {:.2} m/s\n", velocity, sigma, row[7]);
        }
    }
    Ok(text)
}

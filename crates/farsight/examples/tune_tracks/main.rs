//! What the tracker's options are worth on labelled sequences, beside single images and two other ways to associate:
//! `cargo run --release -p farsight --example tune_tracks DATA DETECTIONS [NAME=VALUE ...]`.
//!
//! DATA is what `farsight synth --sequence` wrote; DETECTIONS has one file a sequence (0000.json), which
//! `farsight range DATA/training/image_02/0000 --calib DATA/training/calib/0000.txt --min-score 0.2 --json` wrote.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::format_push_string, reason = "an example")]

mod baselines;

use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

use farsight::json::ImageRecord;
use farsight::video::EgoFile;
use farsight::{Box2d, Box3d, Camera, Detection, Frame, ObjectClass, Track, Tracker, TrackerOptions};
use farsight_core::Dimensions;
use farsight_eval::tracks::{
    GroundTruthFrame, JudgedSequence, PredictedFrame, PredictedTrack, Sample, TracksReport, judge, read_sequence, text,
};

use baselines::{Baseline, Kind};

/// One sequence with its detections.
struct Sequence {
    name: String,
    truth: Vec<GroundTruthFrame>,
    camera: Camera,
    image_size: [usize; 2],
    detections: Vec<Vec<Detection>>,
    ego: EgoFile,
    fps: f64,
}

const BIRTH: f64 = 0.5;

fn main() -> std::io::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let (data, folder) = arguments.next().zip(arguments.next()).expect("expected DATA DETECTIONS");
    let mut options = TrackerOptions { birth_score: BIRTH, low_score: 0.2, ..TrackerOptions::default() };
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

fn set(options: &mut TrackerOptions, setting: &str) {
    let (name, value) = setting.split_once('=').expect("expected NAME=VALUE");
    let value: f64 = value.parse().expect("a number");
    let noise = &mut options.noise;
    let place = match name {
        "birth_score" => &mut options.birth_score,
        "low_score" => &mut options.low_score,
        "min_overlap" => &mut options.min_overlap,
        "gate_sigmas" => &mut options.gate_sigmas,
        "even_psd" => &mut options.motion[0].acceleration_psd,
        "even_lasts_s" => &mut options.motion[0].lasts_s,
        "pushed_psd" => &mut options.motion[1].acceleration_psd,
        "pushed_lasts_s" => &mut options.motion[1].lasts_s,
        "max_coast_s" => &mut options.max_coast_s,
        "prior_along" => &mut options.prior_speed_mps[1],
        "prior_across" => &mut options.prior_speed_mps[0],
        "persistent_share" => &mut noise.persistent_share,
        "persistent_s" => &mut noise.persistent_s,
        "least_white" => &mut noise.least_white,
        "height_share" => &mut noise.height_share,
        "height_px" => &mut noise.height_px,
        "height_s" => &mut noise.height_s,
        "white_height_share" => &mut noise.white_height_share,
        "white_height_px" => &mut noise.white_height_px,
        "size_drift" => &mut noise.size_drift,
        "place_px" => &mut noise.place_px,
        "place_share" => &mut noise.place_share,
        _ => panic!("no option {name}"),
    };
    *place = value;
}

fn sequences(data: &Path, folder: &Path) -> std::io::Result<Vec<Sequence>> {
    let plan: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(data.join("synth.json"))?).unwrap();
    let fps = plan["source"]["fps"].as_f64().unwrap();
    let root = data.join("training");
    let mut names: Vec<String> = std::fs::read_dir(root.join("label_02"))?
        .map(|entry| Path::new(&entry.unwrap().file_name()).file_stem().unwrap().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names.retain(|name| folder.join(format!("{name}.json")).is_file());
    let sequence = |name: &String| {
        let velocities = root.join(format!("velocity_02/{name}.csv"));
        let truth = read_sequence(&root.join(format!("label_02/{name}.txt")), Some(&velocities)).unwrap();
        let answers = std::fs::read_to_string(folder.join(format!("{name}.json")))?;
        let records: Vec<ImageRecord> = serde_json::from_str(&answers).unwrap();
        let camera = Camera { projection: records[0].camera.as_ref().unwrap().projection };
        let image_size = [records[0].width, records[0].height].map(|side| side as usize);
        let detections = records.iter().map(detections).collect();
        let ego = EgoFile::read(&root.join(format!("oxts/{name}.txt"))).unwrap();
        Ok(Sequence { name: name.clone(), truth, camera, image_size, detections, ego, fps })
    };
    names.iter().map(sequence).collect()
}

fn detections(record: &ImageRecord) -> Vec<Detection> {
    let detection = |one: &farsight::json::DetectionRecord| {
        let [x1, y1, x2, y2] = one.box2d;
        let [height, width, length] = one.dimensions_hwl;
        let box3d =
            Box3d { dimensions: Dimensions { height, width, length }, location: one.location, yaw: one.rotation_y };
        Detection {
            class: ObjectClass::from_name(&one.class),
            score: one.score,
            box2d: Box2d::new(x1, y1, x2, y2),
            box3d,
            range_sigma_m: one.range_sigma_m,
        }
    };
    let is_whole = |one: &Detection| one.box2d.width() > 0.0 && one.box2d.height() > 0.0 && one.box3d.depth_m() > 0.0;
    record.detections.iter().map(detection).filter(is_whole).collect()
}

fn judged(sequence: &Sequence, told: &[Option<PredictedFrame>]) -> JudgedSequence {
    judge(&sequence.name, &ObjectClass::Car, &sequence.truth, told)
}

fn tracked(sequence: &Sequence, options: &TrackerOptions, coasts: bool) -> Vec<Option<PredictedFrame>> {
    let mut tracker = Tracker::new(options.clone());
    let frame = |(number, detections): (usize, &Vec<Detection>)| {
        let time_s = number as f64 / sequence.fps;
        let (camera, image_size) = (&sequence.camera, sequence.image_size);
        let ego = sequence.ego.motion(number as u64, time_s);
        let frame = Frame { time_s, image_size, camera, detections, ego, looks_cut: false };
        let tracks = tracker.update(&frame).unwrap();
        let told = |track: &Track| PredictedTrack {
            id: track.id,
            class: track.class.clone(),
            box2d: track.box2d,
            box3d: track.box3d,
            range_sigma_m: Some(track.range_sigma_m),
            closing_mps: track.closing.map(|closing| [closing.mps, closing.sigma_mps]),
            ttc_s: track.closing.and_then(|closing| closing.ttc_s),
            ttc_interval_s: track.closing.and_then(|closing| closing.ttc_interval_s),
            speed_mps: ego.and_then(|ego| track.speed_mps(&ego)),
        };
        Some(PredictedFrame {
            time_s,
            tracks: tracks.iter().filter(|track| coasts || !track.coasting).map(told).collect(),
        })
    };
    sequence.detections.iter().enumerate().map(frame).collect()
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
    let (ours, theirs) = (mean(&ours), mean(&theirs));
    format!(
        "\nsame objects in the same frames: distance MAE {ours:.3} m, single images {theirs:.3} m ({:+.1}%)\n",
        100.0 * (ours / theirs - 1.0)
    )
}
